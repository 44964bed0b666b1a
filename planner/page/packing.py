"""Meshes in a page: thinned where there are too many triangles, quantized, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.planner.view.drawing.skins import Skin
from hdplan.scenes.array_types import Array

MOST_TRIANGLES, MOST_OF_GHOSTS = 140_000, 30_000  # of what is drawn of a robot: about 1.4 and 0.3 MB
FINEST, CELL_FACTOR = 0.0005, 1.3  # [m] edge of the cells in which points are merged at first, and by how much it grows
FACINGS = 2.0  # steps between a normal's numbers -1 and 1, halved, of points that are merged: edges stay sharp


class Packed:
    """Meshes as one string of bytes: of each the differences between its indices, then its points as whole numbers."""

    def __init__(self) -> None:
        """Begin without any."""
        self.meshes: list[dict[str, Any]] = []  # where each is among the bytes, and what it is
        self._parts: list[bytes] = []
        self._size = 0

    def add_all(self, skins: Sequence[Skin], most: int = MOST_TRIANGLES) -> list[int]:
        """Add skins, of at most so many triangles together, and return their numbers."""
        return [self.add(skin.vertices, skin.triangles, skin.color, skin.joint) for skin in thinned(skins, most)]

    def add(self, vertices: NDArray[Any], triangles: NDArray[Any], color: Color, joint: int = 0) -> int:
        """Add a mesh, and return its number."""
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        places = np.rint(65535.0 * (vertices - low) / np.maximum(high - low, 1e-12)).astype("<u2")
        indices = np.diff(triangles.ravel().astype(np.int64), prepend=0).astype("<i4")
        at = {"indices": self._take(indices.tobytes()), "points": self._take(places.tobytes())}
        sizes = {"corners": len(vertices), "triangles": len(triangles)}
        self.meshes.append({**at, **sizes, "low": low, "high": high, "color": color, "joint": joint})
        return len(self.meshes) - 1

    def data(self) -> bytes:
        """Return the bytes."""
        return b"".join(self._parts)

    def _take(self, data: bytes) -> int:
        at = self._size
        padded = data + bytes(-len(data) % 4)
        self._parts.append(padded)
        self._size += len(padded)
        return at


def thinned(skins: Sequence[Skin], most: int) -> Sequence[Skin]:
    """Return skins with at most so many triangles together, or as they are if they have no more: points in one cell
    that face alike become one."""
    found, cell = skins, FINEST
    while sum(len(skin.triangles) for skin in found) > most:
        found = [_merged(skin, cell) for skin in skins]
        cell *= CELL_FACTOR
    return found


def _merged(skin: Skin, cell: float) -> Skin:
    """Return a skin whose points of one cell (edge [m]) and about one normal are their mean; its triangles that are
    left, at least one."""
    points, triangles = np.asarray(skin.vertices, dtype=np.float64), np.asarray(skin.triangles)
    facing = np.rint(FACINGS * _normals(points, triangles) / 2.0)
    keys = np.column_stack([np.floor(points / cell), facing]).astype(np.int64)
    _, merged = np.unique(keys, axis=0, return_inverse=True)
    merged = merged.ravel()
    counts = np.bincount(merged)
    means = np.column_stack([np.bincount(merged, axis) / counts for axis in points.T])
    corners = merged[triangles]
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    if not whole.any():
        return replace(skin, triangles=skin.triangles[:1])
    _, first = np.unique(np.sort(corners[whole], axis=1), axis=0, return_index=True)
    kept = corners[whole][np.sort(first)]
    used, renamed = np.unique(kept, return_inverse=True)
    return replace(skin, vertices=means[used].astype(np.float32), triangles=renamed.reshape(-1, 3).astype(np.uint32))


def _normals(points: Array, triangles: NDArray[Any]) -> Array:
    """Return the normals (n, 3) of the faces around each point, by their areas."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    sums = [np.bincount(triangles.ravel(), np.repeat(axis, 3), len(points)) for axis in faces.T]
    summed = np.column_stack(sums)
    return np.asarray(summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-300))
