"""Points grouped by the cubes of a grid, each group with axes of its own: flat for points on a surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.once import ReadOnly, made_once

LINE_SHARE = 0.05  # share of a group's largest spread; with the second one below it, the points lie on a line
MOST_CELLS = 2**20  # along an axis, so that a cell's three numbers fit into one


@dataclass(frozen=True, eq=False)
class Cells(ReadOnly):
    """c groups of m points: the points `order[first[k]:first[k + 1]]` make cell k."""

    order: Rows  # (m,) a permutation
    first: Rows  # (c,)
    rotation: Array  # (c, 3, 3) axes of each group as columns, that of the least spread first; right-handed

    @property
    def sizes(self) -> Rows:
        """The number of points in each cell (c,)."""
        return np.diff(np.append(self.first, len(self.order)))


class CellBoxes(NamedTuple):
    """Boxes around the points of c cells."""

    rotation: Array  # (c, 3, 3) axes as columns
    low: Array  # (c, 3) of the points along these [m]
    high: Array  # (c, 3)
    radius: Array  # (c,) the largest of a point in each [m]


@made_once(8)
def cells_of(points: FixedArray, edge: float) -> Cells:
    """Return the cells of the points (m, 3 or more) by a grid of this edge [m], with axes from their first three
    columns."""
    places = points.array[:, :3]
    order, first = grouped(places, edge)
    return Cells(order, first, axes_of(places[order], first))


def axes_of(found: Array, first: Rows) -> Array:
    """Return axes (c, 3, 3) as columns, right-handed, for the groups of points (m, 3) that begin at `first` (c,)."""
    sizes = np.diff(np.append(first, len(found)))
    away = found - np.repeat(np.add.reduceat(found, first) / sizes[:, None], sizes, axis=0)
    products = np.stack([away[:, i] * away[:, j] for i, j in _UPPER], axis=1)
    spread = np.add.reduceat(products, first)
    return _axes(*np.linalg.eigh(spread[:, _WHOLE].reshape(-1, 3, 3)))


def _axes(spread: Array, principal: Array) -> Array:
    """Return axes (c, 3, 3) as columns, right-handed, from eigenvalues, ascending, and eigenvectors: principal axes for
    points on a line. On a surface the cube has cut the group, so that its box is tightest along the cube's edges: the
    normal, and the edge that is closest to the surface."""
    normal = principal[:, :, 0]
    edge = np.eye(3)[np.abs(normal).argmin(axis=1)]
    along = edge - np.einsum("ci,ci->c", edge, normal)[:, None] * normal
    along /= np.linalg.norm(along, axis=1, keepdims=True)  # at least √(2/3): the edge is the least along the normal
    axes = np.stack([normal, along, np.cross(normal, along)], axis=2)
    line = spread[:, 1] < LINE_SHARE * spread[:, 2]
    axes[line] = principal[line]
    axes[line, :, 0] *= np.sign(np.linalg.det(axes[line]))[:, None]
    return axes


def grouped(points: Array, edge: float) -> tuple[Rows, Rows]:
    """Sort points (m, 3) by the cubes of a grid of this edge [m]: their order (m,), and where in it each cube that
    holds any begins (c,)."""
    low, high = points.min(axis=0), points.max(axis=0)
    edge = max(edge, float((high - low).max()) / (MOST_CELLS - 1))
    _, rows, columns = (int(length / edge) + 1 for length in (high - low).tolist())
    x, y, z = (((points[:, i] - low[i]) / edge).astype(np.int64) for i in range(3))
    key = (x * rows + y) * columns + z
    bits = len(points).bit_length()
    if int(key.max()) < 2 ** (63 - bits):  # one number with that of the point: to sort it is twice as fast
        key = np.sort((key << bits) | np.arange(len(points)))
        order, key = key & (2**bits - 1), key >> bits
    else:
        order = np.argsort(key, kind="stable")
        key = key[order]
    return order, np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))


_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_WHOLE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # of a symmetric matrix
