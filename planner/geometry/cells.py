"""Points grouped by the cubes of a grid, each group with axes of its own: flat for points on a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.once import freeze, made_once

EDGE = 0.04  # [m] of the cubes: less than a link is thick, with some tens of points of a surface
MOST_CELLS = 2**20  # along an axis, so that a cell's three numbers fit into one


@dataclass(frozen=True, eq=False)
class Cells:
    """c groups of m points: the points `order[first[k]:first[k + 1]]` make cell k."""

    order: Rows  # (m,) a permutation
    first: Rows  # (c,)
    rotation: Array  # (c, 3, 3) principal axes of each group as columns, that of the least spread first; right-handed

    def __post_init__(self) -> None:
        """Share its arrays read-only."""
        freeze(self)

    @property
    def sizes(self) -> Rows:
        """The number of points in each cell (c,)."""
        return np.diff(np.append(self.first, len(self.order)))


@made_once(8)
def cells_of(points: FixedArray, edge: float = EDGE) -> Cells:
    """Return the cells of the points (m, 3 or more) by a grid of this edge [m], with axes from their first three
    columns."""
    places = points.array[:, :3]
    order, first = grouped(places, edge)
    return Cells(order, first, principal_axes(places[order], first))


def principal_axes(points: Array, first: Rows) -> Array:
    """Return axes (c, 3, 3) as `Cells` has them, of groups of points (m, 3) that begin in the rows `first` (c,)."""
    sizes = np.diff(np.append(first, len(points)))
    away = points - np.repeat(np.add.reduceat(points, first) / sizes[:, None], sizes, axis=0)
    products = np.stack([away[:, i] * away[:, j] for i, j in _UPPER], axis=1)
    spread = np.add.reduceat(products, first)[:, _WHOLE].reshape(-1, 3, 3)
    rotation = np.linalg.eigh(spread)[1]
    rotation[:, :, 0] *= np.sign(np.linalg.det(rotation))[:, None]
    return np.asarray(rotation)


def grouped(points: Array, edge: float) -> tuple[Rows, Rows]:
    """Sort points (m, 3) by the cubes of a grid of this edge [m]: their order (m,), and where in it each cube that
    holds any begins (c,)."""
    low = points.min(axis=0)
    edge = max(edge, float((points.max(axis=0) - low).max()) / (MOST_CELLS - 1))
    place = ((points - low) / edge).astype(np.int64)
    key = (place[:, 0] * MOST_CELLS + place[:, 1]) * MOST_CELLS + place[:, 2]
    order = np.argsort(key, kind="stable")
    key = key[order]
    return order, np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))


_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_WHOLE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # of a symmetric matrix
