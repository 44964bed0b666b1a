"""Mesh files as vertices and triangles, read strictly: a file is complete, or it is refused.

STL, OBJ, OFF and PLY are read by `mesh_formats`, where everything in a file is understood, known to be harmless, or
refused by name; COLLADA (dae) and glTF (glb, gltf) by trimesh, after a check for what it would silently skip. The size
of a file bounds what reading it may cost.
"""

from __future__ import annotations

import io
import json
import logging
import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.geometry.mesh_formats.obj import read_obj
from hdplan.planner.geometry.mesh_formats.off import read_off
from hdplan.planner.geometry.mesh_formats.ply import read_ply
from hdplan.planner.geometry.mesh_formats.stl import read_stl
from hdplan.planner.geometry.mesh_formats.text import shown
from hdplan.planner.geometry.mesh_formats.triangles import Triangles
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.lazy_imports import LazyModule
from hdplan.scenes.once import ForkSafeLock

if TYPE_CHECKING:
    import trimesh
else:
    trimesh = LazyModule("trimesh")

MOST_BYTES = 100_000_000
MOST_TRIANGLES = 1_000_000  # more would take minutes to prepare for a proof
FAN = 6  # mode of a glTF primitive that trimesh skips

_reading = ForkSafeLock()  # warnings and trimesh's log belong to the whole process


def read_mesh_file(path: Path) -> Triangles:
    """Read a mesh file by its ending.

    Raises InputError for a file that is missing, not a regular file, too large, of an unknown format, or damaged.
    """
    if not os.path.exists(path):  # unlike Path.exists, no error for names that are too long
        raise InputError("no such file")
    if not os.path.isfile(path):
        raise InputError("is not a regular file")
    ending = path.suffix.lower().lstrip(".")
    if ending not in FORMATS:
        raise InputError(f"format '{path.suffix}' is not known{nearest(ending, FORMATS)}")
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"has {path.stat().st_size / 1e6:.0f} MB; at most {MOST_BYTES / 1e6:.0f} MB are read")
    try:
        vertices, triangles = FORMATS[ending](path.read_bytes(), path)
        points, corners = np.array(vertices, dtype=np.float64), np.array(triangles, dtype=np.int64)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}") from None
    except Exception as error:  # each reader fails in its own way, none in words for the user
        words = " ".join(str(error).split())[:100]
        raise InputError(f"cannot be read, its content is not that of a {ending} file ({words})") from error
    if len(corners) == 0:
        raise InputError("is empty, it holds no triangles")
    if len(corners) > MOST_TRIANGLES:
        raise InputError(f"has {len(corners)} triangles; at most {MOST_TRIANGLES} are used: simplify it")
    if points.shape[1:] != (3,) or corners.shape[1:] != (3,):
        raise InputError(f"its vertices have {points.shape[-1]} coordinates; 3 are needed")
    _check_range(points, corners)
    return points, corners


def _check_range(vertices: Sequence[Any] | Array, triangles: Rows) -> None:
    """Check that the triangles' vertices exist: a negative index would count from the end."""
    for wrong in (int(triangles.min(initial=0)), int(triangles.max(initial=-1))):
        if not 0 <= wrong < len(vertices) and len(triangles):
            raise InputError(f"a triangle has vertex {wrong} (counted from 0); there are {len(vertices)} vertices")


# --- formats that trimesh reads ---------------------------------------------------------------------------------------


def _beside(path: Path) -> Any:
    """Return what finds the files that a mesh file refers to; regular ones only."""

    class Beside(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]
        def get(self, name: str) -> bytes:
            found = Path(self.parent) / name
            if not os.path.isfile(found) or found.stat().st_size > MOST_BYTES:
                raise InputError(f"names the file {shown(name)}, which is missing, no regular file, or too large")
            return bytes(super().get(name))

    return Beside(str(path))


def _gltf(data: bytes, path: Path) -> Triangles:
    text = data
    if data[:4] == b"glTF":
        text = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    header = json.loads(text)
    if any("bufferView" not in accessor or "sparse" in accessor for accessor in header.get("accessors", ())):
        raise InputError("holds compressed or sparse data, which is not read: export it without")
    modes = [primitive.get("mode") for mesh in header.get("meshes", ()) for primitive in mesh["primitives"]]
    if FAN in modes:
        raise InputError("holds a triangle fan, which is not read: export it as triangles")
    return _by_trimesh(data, path)


def read_scene(data: bytes, path: Path) -> trimesh.Scene:
    """Return what trimesh reads from a mesh file's content, without warnings: its parts with their placements and
    colours.

    Only for drawing a file that `read_mesh_file` has accepted, as trimesh overlooks much damage.
    """
    log = logging.getLogger("trimesh")
    quiet = logging.NullHandler()  # without a handler, complaints about colours and the like would go to stderr
    with _reading, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", message="string or file could not be read")  # numbers left out
        log.addHandler(quiet)
        try:
            kind = path.suffix.lower().lstrip(".")
            return trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=_beside(path), process=False)
        finally:
            log.removeHandler(quiet)


def _by_trimesh(data: bytes, path: Path) -> Triangles:
    scene = read_scene(data, path)
    parts = [(place, scene.geometry[name]) for place, name in map(scene.graph.get, scene.graph.nodes_geometry)]
    parts = [(place, part) for place, part in parts if hasattr(part, "faces")]  # points and lines enclose nothing
    count = sum(len(part.faces) for _, part in parts)
    if count > MOST_TRIANGLES:
        raise InputError(f"has {count} triangles; at most {MOST_TRIANGLES} are used: simplify it")
    vertices, triangles, first = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
    for place, part in parts:
        points, corners = np.array(part.vertices, dtype=np.float64), np.array(part.faces, dtype=np.int64)
        _check_range(points, corners)
        mirrored = np.linalg.det(place[:3, :3]) < 0
        with np.errstate(invalid="ignore"):  # values that are not finite are refused where they are used
            vertices.append(points @ place[:3, :3].T + place[:3, 3])
        triangles.append(first + (corners[:, ::-1] if mirrored else corners))
        first += len(points)
    return np.concatenate(vertices), np.concatenate(triangles)


FORMATS: dict[str, Callable[[bytes, Path], Triangles]] = {
    "stl": lambda data, _: read_stl(data),
    "obj": lambda data, _: read_obj(data),
    "off": lambda data, _: read_off(data),
    "ply": lambda data, _: read_ply(data),
    "dae": _by_trimesh,
    "glb": _gltf,
    "gltf": _gltf,
}
