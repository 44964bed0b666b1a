"""Meshes that are not convex, in groups of triangles: whatever the groups, their hulls contain every triangle."""

from __future__ import annotations

import numpy as np

from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.scenes.array_types import Array, Rows


def fills_its_hull(triangles: Array) -> bool:
    """Whether triangles (F, 3, 3) bound a convex solid, so that groups of them would be no tighter than their hull."""
    return TriangleMesh.merged(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)).convex


def divided(groups: Rows, group: int, triangles: Array) -> Rows | None:
    """Return the groups (F,) of triangles (F, 3, 3) with one of them cut in two across its longest extent; None if it
    is a single triangle."""
    rows = np.flatnonzero(groups == group)
    if len(rows) < 2:
        return None
    centers = triangles[rows].mean(axis=1)
    spread = centers - centers.mean(axis=0)
    heights = spread @ np.linalg.svd(spread, full_matrices=False)[2][0]
    upper = heights > 0.5 * (heights.min() + heights.max())
    if upper.all() or not upper.any():
        upper = np.arange(len(rows)) >= len(rows) // 2
    result = groups.copy()
    result[rows[upper]] = groups.max() + 1
    return result
