"""Trajectories as CSV: a row per waypoint, under a header with the names of the joints.

Times are in the column `time`; velocities and accelerations have columns of their own, `JOINT.velocity` and
`JOINT.acceleration`. Of a job, the last column `stage` names the stage of each row; where two meet, the one that
begins. Locked joints are not in the file.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.scenes.errors import InputError
from hdplan.scenes.number_text import read_number

if TYPE_CHECKING:
    from hdplan.planner.motion.trajectory import Trajectory

TIME, STAGE = "time", "stage"
COLUMNS = {"velocities": ".velocity", "accelerations": ".acceleration"}  # suffixes of the joints' names


def write_csv(trajectory: Trajectory, _: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Return the file's content. Raises InputError for a job whose stages or joints have names that it cannot hold."""
    stages = [name for name in trajectory.stage_names if name is not None]
    if stages and (STAGE in trajectory.joint_names or all(map(_is_number, stages))):
        raise InputError(f"{STAGE}: holds stages, not numbers of a joint: write .json")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names, rows = trajectory.joint_names, trajectory.positions
    for key, ending in COLUMNS.items():
        if (values := getattr(trajectory, key)) is not None:
            names = (*names, *(name + ending for name in trajectory.joint_names))
            rows = np.column_stack([rows, values])
    if trajectory.times is not None:
        names, rows = (TIME, *names), np.column_stack([trajectory.times, rows])
    writer.writerow([*names, *([STAGE] if stages else [])])
    written = ([repr(value) for value in row] for row in rows.tolist())
    writer.writerows(written if not stages else ([*row, x] for row, x in zip(written, stages, strict=True)))
    return text.getvalue().encode()


def read_csv(data: bytes) -> dict[str, Any]:
    """Return the fields of the trajectory in a file. Raises InputError saying what is wrong."""
    try:
        reader = csv.reader(io.StringIO(data.decode("utf-8-sig")))
        rows = [(reader.line_num, row) for row in reader if row]
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"not CSV ({error})") from error
    if not rows:
        raise InputError("empty; a header with the joint names and one row per waypoint are expected")
    (line, header), *rows = rows
    names = tuple(name.strip() for name in header)
    check_commas(line, header)
    if any(_is_number(name) for name in names):
        raise InputError(f"line {line}: {', '.join(names[:3])}, … are numbers; the header must hold the joint names")
    for line, row in rows:
        if len(row) != len(names):
            raise InputError(f"line {line}: {len(row)} values, expected {len(names)} as in the header")
    names, rows, stages = _without_stages(names, rows)
    for line, row in rows:
        if wrong := [value for value in row if not _is_number(value)]:
            raise InputError(f"line {line}: '{wrong[0]}' is not a number")
    values = np.array([[float(value) for value in row] for _, row in rows]).reshape(-1, len(names))
    columns = dict(zip(names, values.T, strict=True))
    if len(columns) < len(names):
        raise InputError(f"line 1: '{next(name for i, name in enumerate(names) if name in names[:i])}' appears twice")
    times = columns.pop(TIME, None)
    joints = tuple(name for name in columns if not name.endswith(tuple(COLUMNS.values())))
    rates = {}
    for key, ending in COLUMNS.items():
        given = [name for name in columns if name.endswith(ending)]
        if given and (lacking := [name for name in joints if name + ending not in columns]):
            raise InputError(f"line 1: column '{lacking[0]}{ending}' is missing beside '{given[0]}'")
        if unknown := [name for name in given if name.removesuffix(ending) not in joints]:
            raise InputError(f"line 1: column '{unknown[0]}' belongs to no joint with positions")
        rates[key] = np.column_stack([columns[name + ending] for name in joints]) if given else None
    positions = np.column_stack([columns[name] for name in joints]) if joints else values[:, :0]
    return {"joint_names": joints, "positions": positions, "times": times, "stages": stages, **rates}


Lines = list[tuple[int, list[str]]]


def _without_stages(names: tuple[str, ...], rows: Lines) -> tuple[tuple[str, ...], Lines, list[dict[str, Any]]]:
    """Return columns and rows without that of a job's stages, if there is one: in words, as a joint's is in numbers;
    and where each stage begins."""
    if names.count(STAGE) != 1:
        return names, rows, []
    column = names.index(STAGE)
    stages = [row[column] for _, row in rows]
    if all(map(_is_number, stages)):
        return names, rows, []
    marks = [{"name": name, "row": i} for i, name in enumerate(stages) if i == 0 or name != stages[i - 1]]
    left = [(line, [*row[:column], *row[column + 1 :]]) for line, row in rows]
    return (*names[:column], *names[column + 1 :]), left, marks


def check_commas(line: int, header: Sequence[str]) -> None:
    """Raise InputError for a header that other marks than commas divide."""
    if len(header) == 1 and (mark := next((each for each in ";\t" if each in header[0]), None)):
        kind = "semicolons" if mark == ";" else "tabs"
        raise InputError(
            f"line {line}: has {kind} between its values; commas are expected there, and points in decimals"
        )


def _is_number(text: str) -> bool:
    try:
        read_number(text.strip(" \t"))
    except ValueError:
        return text.strip(" \t").lower().lstrip("+-") in ("nan", "inf", "infinity")  # refused by name, as a value
    return True
