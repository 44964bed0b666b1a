"""Mesh files with their colours, for pictures alone.

Each file is read by two readers: the strict one says what its geometry is, trimesh adds colours. What they find is kept
in the cache on disk by the files' content, as they take most of the time until a robot is first seen.
"""

from __future__ import annotations

import base64
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.compiled.cache import content_key, load, store
from hdplan.planner.geometry.mesh_files import files_beside, mesh_stamps, read_mesh_file, read_scene
from hdplan.planner.geometry.meshes import LARGEST_COORDINATE
from hdplan.planner.view.drawing.creases import creased
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import Stamps, read_file
from hdplan.scenes.lazy_imports import trimesh
from hdplan.scenes.once import ReadOnly

Color = tuple[int, int, int]  # red, green, blue, 0 to 255

VERSION = "2"  # to be changed with anything that changes what is read, so that old cache entries are not used
SAME_REACH = 1e-5  # part of its size by which a mesh may reach farther, or less far, as another reader has it


@dataclass(frozen=True, eq=False)
class Part(ReadOnly):
    """A part of a mesh file that has one colour, as browsers light it (`creases`)."""

    vertices: NDArray[np.float32]  # (m, 3)
    triangles: NDArray[np.uint32]  # (F, 3)
    color: Color | None  # None: the file says none

    @classmethod
    def of(cls, vertices: Array, triangles: Rows, color: Color | None = None) -> Part:
        """Take triangles as they come."""
        return cls(*creased(vertices, triangles), color)


@functools.lru_cache(maxsize=256)
def mesh_parts(path: Path, stamps: Stamps) -> tuple[Part, ...]:
    """Return the parts of a mesh file, read once as long as it, by `stamps`, stays as it is; one part without a colour
    where trimesh reads another geometry. Raises InputError for a file that is not a mesh, or is damaged."""
    data = read_file(path)
    key = content_key(VERSION, path.suffix.lower(), data)
    known = load("mesh_parts", key, lambda value: _unpacked(value, path.parent))
    if known is not None:
        return known
    parts, named = _read(path, data)
    beside = {name: _content(path.parent / name) for name in named}
    if mesh_stamps([path]) == stamps:  # what was read has this content
        store("mesh_parts", key, {"beside": beside, "parts": [_packed(part) for part in parts]})
    return parts


def rgb(color: Any) -> Color:
    """Return a colour whose parts are 0 to 1."""
    red, green, blue = (round(255 * float(np.clip(value, 0.0, 1.0))) for value in list(color)[:3])
    return red, green, blue


def _content(beside: Path) -> str | None:
    """Return the digest of a file's content; None for a file that cannot be read."""
    try:
        return content_key(read_file(beside))
    except InputError:
        return None


def _read(path: Path, data: bytes) -> tuple[tuple[Part, ...], Sequence[str]]:
    """Return the parts of a mesh file, and the names of the files beside it that were read."""
    vertices, triangles = read_mesh_file(path)
    if not np.isfinite(vertices).all() or np.abs(vertices).max() > LARGEST_COORDINATE:
        raise InputError(f"holds coordinates that are not finite, or beyond {LARGEST_COORDINATE:g}")
    named = [str(beside.relative_to(path.parent)) for beside in files_beside(path)]
    try:
        meshes = [
            mesh
            for mesh in read_scene(data, path, named.append).dump()
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)
        ]
    except Exception:  # each fails in its own way; what it would add is colours
        meshes = []
    if _same(meshes, vertices[triangles]):
        return tuple(Part.of(mesh.vertices, mesh.faces, _color_of(mesh.visual)) for mesh in meshes), named
    return (Part.of(vertices, triangles),), named


def _same(meshes: Sequence[Any], corners: Array) -> bool:
    """True if trimesh's meshes hold as many triangles as `corners` (F, 3, 3), and reach as far."""
    found = np.concatenate([np.empty((0, 3, 3)), *(mesh.vertices[mesh.faces] for mesh in meshes)])
    if len(found) != len(corners):
        return False
    one, other = (np.concatenate([each.min(axis=(0, 1)), each.max(axis=(0, 1))]) for each in (found, corners))
    return bool(np.abs(one - other).max() <= SAME_REACH * np.abs(other).max())


def _color_of(visual: Any) -> Color | None:
    if getattr(visual, "defined", False) and hasattr(visual, "material"):
        return rgb(np.asarray(visual.material.main_color) / 255.0)
    return None


# --- as JSON ----------------------------------------------------------------------------------------------------------


def _packed(part: Part) -> tuple[str, str, Color | None]:
    vertices, triangles = part.vertices.astype("<f4"), part.triangles.astype("<u4")
    return base64.b64encode(vertices.tobytes()).decode(), base64.b64encode(triangles.tobytes()).decode(), part.color


def _unpacked(value: Any, folder: Path) -> tuple[Part, ...] | None:
    """Return the parts as they were kept; None where a file beside them has changed."""
    if any(_content(folder / name) != content for name, content in value["beside"].items()):
        return None
    return tuple(_part(*each) for each in value["parts"])


def _part(vertices: str, triangles: str, color: Sequence[int] | None) -> Part:
    points = np.frombuffer(base64.b64decode(vertices), "<f4").reshape(-1, 3).astype(np.float32)
    corners = np.frombuffer(base64.b64decode(triangles), "<u4").reshape(-1, 3).astype(np.uint32)
    return Part(points, corners, None if color is None else (color[0], color[1], color[2]))
