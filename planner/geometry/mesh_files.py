"""Mesh files as vertices and triangles, read strictly: a file is complete, or it is refused.

STL, OBJ and OFF are read here, as they are simple and other readers accept half of a file; PLY, COLLADA (dae) and glTF
(glb, gltf) are read by trimesh, after a check for what it would silently skip. The size of a file bounds what reading
it may cost.
"""

from __future__ import annotations

import io
import itertools
import json
import logging
import os
import re
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.lazy_imports import LazyModule
from hdplan.scenes.once import ForkSafeLock

if TYPE_CHECKING:
    import trimesh
else:
    trimesh = LazyModule("trimesh")

Triangles = tuple[Array, Rows]  # vertices (m, 3) in the file's unit, corners (F, 3): rows of vertices

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


# --- formats that are read here ---------------------------------------------------------------------------------------


def _numbers(words: Sequence[str], line: int) -> tuple[float, ...]:
    try:
        return tuple(map(float, words))
    except ValueError:
        raise InputError(f"line {line}: {_shown(' '.join(words))}: numbers are expected") from None


def _shown(text: str) -> str:
    """Return a line's content, fit to be printed."""
    text = text.strip()
    return repr(text if len(text) <= 60 else f"{text[:57]}...")


def _stl(data: bytes, path: Path) -> Triangles:
    length = 84 + 50 * int.from_bytes(data[80:84], "little")
    if len(data) == length:
        row = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
        corners = np.frombuffer(data, dtype=np.dtype(row), offset=84)["corners"].reshape(-1, 3).astype(np.float64)
        return corners, np.arange(len(corners)).reshape(-1, 3)
    if data.lstrip()[:5].lower() != b"solid":
        raise InputError(f"is no STL file, or damaged: binary, it would have {length} bytes; it has {len(data)}")
    found: list[tuple[float, ...]] = []
    facets, last = 0, ""
    for number, line in enumerate(data.decode("utf-8", errors="replace").lower().splitlines(), start=1):
        match line.split():
            case ["vertex", *words] if len(words) == 3:
                found.append(_numbers(words, number))
            case ["facet", "normal", *words] if len(words) == 3:
                _numbers(words, number)
                facets += 1
            case ["endfacet"] if len(found) != 3 * facets:
                raise InputError(f"line {number}: a facet ends that has not 3 vertices")
            case ["vertex" | "facet", *_]:
                raise InputError(f"line {number}: {_shown(line)}: 3 numbers are expected")
            case [first, *_]:
                last = first
    if last != "endsolid" or len(found) != 3 * facets:
        raise InputError("is cut short: it does not end with 'endsolid'")
    return np.array(found).reshape(-1, 3), np.arange(len(found)).reshape(-1, 3)


def _obj(data: bytes, path: Path) -> Triangles:
    vertices: list[tuple[float, ...]] = []
    triangles: list[tuple[int, int, int]] = []
    text = data.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        match line.partition("#")[0].split():
            case ["v", x, y, z, *_]:  # further numbers are a weight or a colour
                vertices.append(_numbers((x, y, z), number))
            case ["f", *corners] if len(corners) >= 3:
                try:
                    told = [int(corner.partition("/")[0]) for corner in corners]
                except ValueError:
                    raise InputError(f"line {number}: {_shown(line)}: vertices are whole numbers") from None
                rows = [row - 1 if row > 0 else len(vertices) + row for row in told]  # from 1, or backwards
                if 0 in told or not all(row >= 0 for row in rows):
                    raise InputError(f"line {number}: {_shown(line)}: there is no such vertex")
                triangles += [(rows[0], a, b) for a, b in itertools.pairwise(rows[1:])]
            case ["v", *_]:
                raise InputError(f"line {number}: {_shown(line)}: a vertex has 3 coordinates")
            case ["f", *_]:
                raise InputError(f"line {number}: {_shown(line)}: a face has 3 vertices at least")
    return np.array(vertices).reshape(-1, 3), np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _off(data: bytes, path: Path) -> Triangles:
    text = data.decode("utf-8", errors="replace")
    lines = [(i, line.partition("#")[0].split()) for i, line in enumerate(text.splitlines(), start=1)]
    lines = [(i, words) for i, words in lines if words]
    if not lines or lines[0][1][0].upper() not in ("OFF", "COFF", "NOFF", "CNOFF"):
        raise InputError("is no OFF file: its first word is not OFF")
    lines[0] = (lines[0][0], lines[0][1][1:])  # the counts may follow on the same line
    (at, counts), *rest = lines if lines[0][1] else lines[1:]
    if len(counts) < 2 or not all(re.fullmatch(r"\d{1,12}", count) for count in counts[:2]):
        raise InputError(f"line {at}: {_shown(' '.join(counts))}: the numbers of vertices and faces are expected")
    points, faces = map(int, counts[:2])
    if len(rest) < points + faces:
        raise InputError(f"is cut short: it says {points} vertices and {faces} faces, and holds {len(rest)} lines")
    vertices = [_numbers(words[:3], i) for i, words in rest[:points]]
    triangles: list[tuple[int, int, int]] = []
    for i, words in rest[points : points + faces]:
        try:
            count, *rows = map(int, words[: int(words[0]) + 1])
        except ValueError:
            raise InputError(f"line {i}: {_shown(' '.join(words))}: vertices are whole numbers") from None
        if count != len(rows):
            raise InputError(f"line {i}: says {count} vertices and holds {len(rows)}")
        triangles += [(rows[0], a, b) for a, b in itertools.pairwise(rows[1:])]
    return np.array(vertices), np.array(triangles, dtype=np.int64).reshape(-1, 3)


# --- formats that trimesh reads ---------------------------------------------------------------------------------------


def _beside(path: Path) -> Any:
    """Return what finds the files that a mesh file refers to; regular ones only."""

    class Beside(trimesh.resolvers.FilePathResolver):  # type: ignore[misc]
        def get(self, name: str) -> bytes:
            found = Path(self.parent) / name
            if not os.path.isfile(found) or found.stat().st_size > MOST_BYTES:
                raise InputError(f"names the file {_shown(name)}, which is missing, no regular file, or too large")
            return bytes(super().get(name))

    return Beside(str(path))


def _ply(data: bytes, path: Path) -> Triangles:
    header, _, body = data.partition(b"end_header")
    if b"format ascii" in header:
        rows = sum(int(count) for count in re.findall(rb"^\s*element\s+\S+\s+(\d+)", header, flags=re.MULTILINE))
        if (held := sum(bool(line.strip()) for line in body.splitlines())) < rows:
            raise InputError(f"is cut short: its header says {rows} rows, and it holds {held}")
    return _by_trimesh(data, path)


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
    "stl": _stl,
    "obj": _obj,
    "off": _off,
    "ply": _ply,
    "dae": _by_trimesh,
    "glb": _gltf,
    "gltf": _gltf,
}
