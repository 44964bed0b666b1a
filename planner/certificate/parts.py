"""The parts that make up a piece's exact shape, triangles or balls, and ever larger groups of them, each enclosed.

A node is a point, triangle or rectangle, swept by a ball: a part itself, or the rectangle of a group's principal axes,
swept by what sticks out of its plane. So the support of any node, exact for the parts, comes from four points and a
radius, for all nodes and directions in one product.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import coal
import numpy as np

from hdplan.distance.compiled.c_library import Record
from hdplan.planner.geometry.cells import axes_of
from hdplan.planner.geometry.coal_shapes import triangle
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import freeze, read_only

BRANCH = 8  # nodes in a group
MOST = 64  # so few parts are one group: the balls of a cell
ROOM = 1e-12  # share by which groups are larger, for rounding


@dataclass(frozen=True, eq=False)
class Parts:
    """n nodes: the parts themselves first, then groups of them, groups of groups, and at last one of all."""

    corners: Array  # (n, 4, 3) [m] of the rectangle, triangle or point in the piece's frame, some of them repeated
    radius: Array  # (n,) [m] of the sweeping ball
    size: Array  # (n,) [m] of a group; 0 for a part
    first: Rows  # (n,) the node's children, or itself
    last: Rows  # (n,)
    depth: int  # the number of levels
    _shapes: dict[int, tuple[Any, Array | None]] = field(default_factory=dict)  # made on first use

    def __post_init__(self) -> None:
        """Share its arrays read-only."""
        freeze(self)

    @classmethod
    def of(cls, corners: Array, radius: Array) -> Parts:
        """Group parts: the hulls of corners (m, 1 or 3, 3), swept by balls of these radii (m,)."""
        if (count := len(corners)) > MOST:
            order = np.concatenate(_near_one_another(corners.mean(axis=1), np.arange(count)))
            corners, radius = corners[order], radius[order]
        corners = corners[:, np.minimum(np.arange(4), corners.shape[1] - 1)]
        levels, first, last = [(corners, radius)], [np.arange(count)], [np.arange(1, count + 1)]
        begin = 0  # of the last level
        while (size := len(levels[-1][0])) > 1:
            groups = np.arange(0, size, BRANCH if count > MOST else MOST)
            levels.append(_enclosed(*levels[-1], groups))
            first.append(begin + groups)
            last.append(begin + np.append(groups[1:], size))
            begin += size
        corners, radius = (np.concatenate(each) for each in zip(*levels, strict=True))
        sizes = np.linalg.norm(corners[:, 2] - corners[:, 0], axis=1) + 2.0 * radius
        sizes[:count] = 0.0
        return cls(corners, radius, sizes, np.concatenate(first), np.concatenate(last), len(levels))

    @cached_property
    def record(self) -> Record:
        """The C struct of that name in `parts_loop`."""
        return Record(self.first, self.last, self.corners, self.radius, self.size)

    def support(self, nodes: Rows, directions: Array) -> Array:
        """Return max d·x over each node's points x (k, nodes) for directions (k, 3) of any length, in the piece's
        frame."""
        along = (self.corners[nodes].reshape(-1, 3) @ directions.T).reshape(len(nodes), 4, -1).max(axis=1)
        return np.asarray(along.T + np.linalg.norm(directions, axis=1)[:, None] * self.radius[nodes])

    def shape(self, part: int) -> tuple[Any, Array | None]:
        """Return a part for coal, and its origin in the piece's frame, if it is another."""
        if part not in self._shapes:
            if radius := float(self.radius[part]):
                self._shapes[part] = coal.Sphere(radius), self.corners[part, 0]
            else:
                self._shapes[part] = triangle(self.corners[part, :3]), None
        return self._shapes[part]


def _near_one_another(places: Array, rows: Rows) -> list[Rows]:
    """Sort places (m, 3) so that any BRANCH, any BRANCH² of them … in a row are near one another."""
    if len(rows) <= BRANCH:
        return [rows]
    first = BRANCH * 2 ** int(np.log2((len(rows) - 1) // BRANCH))  # at least half of them
    axis = np.ptp(places[rows], axis=0).argmax()
    rows = rows[np.argsort(places[rows, axis], kind="stable")]
    return _near_one_another(places, rows[:first]) + _near_one_another(places, rows[first:])


def _enclosed(corners: Array, radius: Array, first: Rows) -> tuple[Array, Array]:
    """Return the rectangles (c, 4, 3), and the radii (c,) of the balls that sweep them, which contain groups of
    nodes."""
    points = corners.reshape(-1, 3)
    axes = axes_of(points, 4 * first)
    sizes = np.diff(np.append(first, len(corners)))
    local = np.einsum("mki,mij->mkj", corners, np.repeat(axes, sizes, axis=0))
    low, high = np.minimum.reduceat(local.min(axis=1), first), np.maximum.reduceat(local.max(axis=1), first)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    flat = middle[:, None] + half[:, None] * _RECTANGLE
    around = np.maximum.reduceat(radius, first) + half[:, 0] + ROOM * np.abs(points).max()
    return np.einsum("ckj,cij->cki", flat, axes), around


_RECTANGLE = read_only(np.array([[0.0, -1.0, -1.0], [0.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 1.0]]))
