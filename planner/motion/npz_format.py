"""Trajectories as NPZ: an archive of plain NumPy arrays, named like the fields of a trajectory."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.errors import InputError
from hdplan.scenes.files import MOST_BYTES

if TYPE_CHECKING:
    from hdplan.planner.motion.trajectory import Trajectory

TIMED = ("times", "velocities", "accelerations")  # optional, beside positions


def write_npz(trajectory: Trajectory, _: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Return the file's content."""
    data = io.BytesIO()
    np.savez(
        data,
        joint_names=np.array(trajectory.joint_names),
        positions=trajectory.positions,
        locked_names=np.array(list(trajectory.locked), dtype=str),
        locked_values=np.array(list(trajectory.locked.values()), dtype=np.float64),
        **_marks(trajectory),
        **{key: values for key in TIMED if (values := getattr(trajectory, key)) is not None},
    )
    return data.getvalue()


def _marks(trajectory: Trajectory) -> dict[str, Any]:
    names, rows = [mark.name for mark in trajectory.stages], [mark.row for mark in trajectory.stages]
    return {"stage_names": np.array(names), "stage_rows": np.array(rows)} if names else {}


def read_npz(data: bytes) -> dict[str, Any]:
    """Return the fields of the trajectory in a file. Raises InputError saying what is wrong."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            arrays = {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in archive.infolist()}
    except InputError:
        raise
    except Exception as error:  # zip, its compressions, NumPy's headers: each raises exceptions of its own
        raise InputError("not an NPZ archive of plain arrays") from error
    for key in ("joint_names", "positions"):
        if key not in arrays:
            raise InputError(f"{key}: missing (the archive holds {', '.join(arrays) or 'nothing'})")
    names, values = arrays.get("locked_names", np.array([], dtype=str)), arrays.get("locked_values", np.array([]))
    locked = dict(zip(names.ravel().tolist(), values.ravel().tolist(), strict=False))
    if len(locked) != values.size:
        raise InputError(f"locked_names: {names.size} names for {values.size} locked_values")
    joints = tuple(arrays["joint_names"].ravel().tolist())
    timed = {key: arrays.get(key) for key in TIMED}
    marks = [arrays.get(key, np.array([])).ravel().tolist() for key in ("stage_names", "stage_rows")]
    if len(marks[0]) != len(marks[1]):
        raise InputError(f"stage_names: {len(marks[0])} names for {len(marks[1])} stage_rows")
    stages = [{"name": name, "row": row} for name, row in zip(*marks, strict=True)]
    return {"joint_names": joints, "positions": arrays["positions"], "locked": locked, "stages": stages, **timed}


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """Read one array of an archive, after checking that it is as large as its header says, and not too large."""
    if entry.file_size > MOST_BYTES:
        size, most = (f"{count / 1e6:.0f} MB" for count in (entry.file_size, MOST_BYTES))
        raise InputError(f"{entry.filename}: {size} large when unpacked; at most {most} are read")
    with archive.open(entry) as file:
        data = io.BytesIO(file.read(MOST_BYTES + 1))
    header = (
        np.lib.format.read_array_header_1_0
        if np.lib.format.read_magic(data) == (1, 0)
        else (np.lib.format.read_array_header_2_0)
    )
    shape, _, dtype = header(data)
    if dtype.hasobject:
        raise ValueError("objects")
    if math.prod(shape) * dtype.itemsize != len(data.getbuffer()) - data.tell():
        raise InputError(f"{entry.filename}: does not hold the array that its header says")
    data.seek(0)
    return np.asarray(np.lib.format.read_array(data, allow_pickle=False))
