"""Files that hold a scene: meshes, each placed by nodes, once or many times, as one mesh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hdplan.planner.geometry.mesh_formats.triangles import Triangles
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

MOST_TRIANGLES = 1_000_000  # more would take minutes to prepare for a proof
MOST_PARTS = 100_000
DEEPEST_NODE = 100  # nodes within nodes


def joined(parts: Sequence[tuple[Array, Triangles]]) -> Triangles:
    """Return placed meshes as one: `parts` holds affine placements (4, 4) and meshes. The triangles of a mesh that its
    placement mirrors are reversed, so that what was outside stays outside."""
    count = sum(len(corners) for _, (_, corners) in parts)
    if count > MOST_TRIANGLES:
        raise InputError(f"has {count} triangles; at most {MOST_TRIANGLES} are used: simplify it")
    vertices, triangles, first = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
    for place, (points, corners) in parts:
        with np.errstate(all="ignore"):  # values that are not finite are refused where they are used
            mirrored = np.linalg.det(place[:3, :3]) < 0.0
            vertices.append(points @ place[:3, :3].T + place[:3, 3])
        triangles.append(first + (corners[:, ::-1] if mirrored else corners))
        first += len(points)
    return np.concatenate(vertices), np.concatenate(triangles)


def rotation(axis: Array, angle: float) -> Array:
    """Return the matrix (4, 4) of a rotation by `angle` [rad] about the unit vector `axis` (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return matrix
