"""Files of points: PLY, PCD, XYZ, NumPy's npz and npy, LAS. A file is complete, or it is refused."""

from __future__ import annotations

import io
import logging
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from hdplan.planner.geometry.data_files import numpy_readers, read_by_ending
from hdplan.planner.geometry.mesh_formats.ply import read_ply_points
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError


def read_points(path: Path) -> Array:
    """Read the points (m, 3) of a file by its ending, in the file's unit and as they are: some may be NaN.

    Raises InputError for a file that is missing, too large, of an unknown format, or damaged.
    """
    points = np.asarray(read_by_ending(path, FORMATS))
    if points.dtype.kind not in "iuf" or points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"holds an array of shape {points.shape} and type {points.dtype}; points (m, 3) are needed")
    return points.astype(np.float64)


def _ply(data: bytes, path: Path) -> Array:
    return read_ply_points(data)


def _xyz(data: bytes, path: Path) -> Array:
    """Three numbers a line, or more, of which the first three count: colours and normals follow them."""
    lines = data.decode("utf-8").splitlines()
    rows = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        return np.empty((0, 3))
    if rows and not data.endswith((b"\n", b"\r")) and len(rows) > 1 and len(rows[-1].split()) != len(rows[0].split()):
        raise InputError(f"is cut short: its last line is {rows[-1][:40]!r}")
    return np.loadtxt(rows, usecols=(0, 1, 2), ndmin=2, delimiter="," if "," in rows[0] else None)


def _pcd(data: bytes, path: Path) -> Array:
    pypcd4 = _needed("pypcd4", path)
    cloud = pypcd4.PointCloud.from_fileobj(io.BytesIO(data))
    if any(axis not in cloud.fields for axis in "xyz"):
        raise InputError(f"has the fields {', '.join(cloud.fields)}; x, y and z are needed")
    if len(points := cloud.numpy(("x", "y", "z"))) != cloud.points:
        raise InputError(f"is cut short: its header says {cloud.points} points, and it holds {len(points)}")
    return np.asarray(points)


def _las(data: bytes, path: Path) -> Array:
    """laspy believes the numbers of the header, whatever they make it do, so they are held against the size."""
    logging.getLogger("laspy").addHandler(logging.NullHandler())  # its warnings would go to stderr
    laspy = _needed("laspy", path)
    if data[:4] != b"LASF" or len(data) < _LAS_HEADER:
        raise InputError("has no header of a las file")
    begin, records, _, length, count = struct.unpack_from("<IIBHI", data, 96)
    if data[25] >= 4 and len(data) >= _LAS_14_HEADER:  # minor version
        extra, count = struct.unpack_from("<IQ", data, 243)
        records += extra
    if records * _LAS_RECORD > len(data) or begin + count * length > len(data):
        raise InputError(f"is cut short: its header says {count} points of {length} bytes after {records} records")
    cloud = laspy.read(io.BytesIO(data))
    if len(cloud.points) != cloud.header.point_count:
        raise InputError(f"is cut short: its header says {cloud.header.point_count} points")
    return np.asarray(cloud.xyz)


_LAS_HEADER, _LAS_14_HEADER, _LAS_RECORD = 227, 375, 54  # [bytes] of headers, and of a record before the points


def _needed(name: str, path: Path) -> Any:
    try:
        return __import__(name)
    except ImportError:
        raise InputError(f"{path.suffix} files need {name}, which is not installed: pip install {name}") from None


FORMATS: Mapping[str, Callable[[bytes, Path], Array]] = MappingProxyType(
    {"ply": _ply, "pcd": _pcd, "xyz": _xyz, **numpy_readers("points", "points"), "las": _las}
)
