"""Points grouped by the cubes of a grid, each group with a box along axes of its own, in loops of C: without sorting,
and without the points that nothing reaches.

The same as `cells.grouped`, `axes_of` and the extents along them, but for rounding, where the cubes begin and the order
of the cells.
"""

from __future__ import annotations

import numpy as np

from hdplan.distance.compiled.loops import C
from hdplan.planner.geometry.cells import CellBoxes
from hdplan.scenes.array_types import Array


def cell_boxes(points: Array, radii: Array, edge: float, balls: Array) -> CellBoxes:
    """Enclose those balls about points (m, 3) with radii (m,) [m] that touch any of the other balls (k, 4)."""
    points, radii, count = np.ascontiguousarray(points), np.ascontiguousarray(radii), len(points)
    near, cell, sums = np.empty(count, np.int64), np.empty(count, np.int64), np.empty((count, 11))
    cells = C.gather_cells(points, radii, edge, np.ascontiguousarray(balls), near, cell, sums)
    sums = sums[:cells].copy()
    found = int(sums[:, 0].sum())  # of the points, those in a cell
    rotation, low, high = np.empty((cells, 3, 3)), *np.empty((2, cells, 3))
    C.turn_cells(sums, rotation)
    C.extend_cells(points, rotation, near[:found], cell[:found], low, high)
    return CellBoxes(rotation, low, high, sums[:, 1])
