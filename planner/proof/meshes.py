"""Meshes that are not convex, in groups of triangles, and clouds, in groups of balls: for any groups, their hulls
contain every triangle, and every ball."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdplan.planner.geometry.cells import grouped
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.scenes.array_types import Array, Rows

CELL = 0.08  # [m] edge of the cubes whose balls make a group
MOST_SURFACES = 64  # into which a mesh is divided at once
MOST_GROUPS = 1 << 16  # as a proof writes their numbers


def groups_of(shape: dict[str, Any]) -> Rows | None:
    """Return the group of each ball of a world's cloud, those in one cube of a grid, or of each box of a map, which is
    alone. None for other shapes, which are divided only where that is needed."""
    if shape["parts"] is None or len(shape["parts"][0]) == 3:
        return None
    if len(shape["parts"][0]) > 1:
        return np.arange(len(shape["parts"])) % MOST_GROUPS
    order, first = grouped(np.array(shape["points"]), CELL)
    found = np.empty(len(order), dtype=np.int64)
    found[order] = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(order)))) % MOST_GROUPS
    return found


def fills_its_hull(triangles: Array) -> bool:
    """True if triangles (F, 3, 3) bound a convex solid, so that groups of them would be no tighter than their hull."""
    if triangles.shape[1] != 3:
        return False
    return TriangleMesh.merged(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)).convex


def divided(groups: Rows, group: int, triangles: Array) -> Rows | None:
    """Return the groups (F,) of triangles (F, 3, 3), or other parts (F, c, 3), with one of them divided: into the
    surfaces that it has, if there are several, such as the bars of a cage, or else in two across its longest extent.
    None where that would be of no use: for a single triangle, and for triangles that bound a convex solid."""
    rows = np.flatnonzero(groups == group)
    if len(rows) < 2 or fills_its_hull(triangles[rows]):
        return None
    result, surface = groups.copy(), _surfaces(triangles[rows])
    if 1 < (count := int(surface.max()) + 1) <= MOST_SURFACES:
        result[rows] = np.where(surface == 0, group, groups.max() + surface)
        return result
    centers = triangles[rows].mean(axis=1)
    if count > MOST_SURFACES:  # which stay whole
        centers = (
            np.array([np.bincount(surface, x) for x in centers.T]).T[surface] / np.bincount(surface)[surface, None]
        )
    spread = centers - centers.mean(axis=0)
    heights = spread @ np.linalg.svd(spread, full_matrices=False)[2][0]
    upper = heights > 0.5 * (heights.min() + heights.max())
    if upper.all() or not upper.any():
        upper = np.arange(len(rows)) >= len(rows) // 2
    result[rows[upper]] = groups.max() + 1
    return result


def _surfaces(triangles: Array) -> Rows:
    """Number the surfaces of triangles (F, c, 3), which are connected where they share corners: (F,), counted from
    0."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count, corners = triangles.shape[:2]
    corner = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)[1].ravel()
    row = np.repeat(np.arange(count), corners)
    has = coo_array((np.ones(len(corner)), (row, corner)), (count, int(corner.max()) + 1))
    return np.asarray(connected_components(has @ has.T)[1], dtype=np.int64)
