"""The parts that make up a piece's exact shape, triangles or balls, and ever larger groups of them, each enclosed.

A node is a point, triangle or rectangle, swept by a ball: a part itself, or the rectangle of a group's longer sides,
swept by what sticks out of its plane. So the support of any node, exact for the parts, comes from four points and a
radius, for all nodes and directions in one product.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import coal
import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.geometry.coal_shapes import triangle
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import ReadOnly, read_only

BRANCH = 8  # nodes in a group
GROUP_SIZE = 64  # so few parts are one group: the balls of a cell
ROUNDING_SHARE = 1e-12  # share by which groups are larger, for rounding


@dataclass(frozen=True, eq=False)
class Parts(ReadOnly):
    """n nodes: the parts themselves first, then groups of them, groups of groups, and at last one of all."""

    corners: Array  # (n, 4, 3) [m] of the rectangle, triangle or point in the piece's frame, some of them repeated
    radius: Array  # (n,) [m] of the sweeping ball
    size: Array  # (n,) [m] of a group; 0 for a part
    first: Rows  # (n,) the node's children, or itself
    last: Rows  # (n,)
    depth: int  # the number of levels
    _shapes: dict[int, tuple[Any, Array | None]] = field(default_factory=dict)  # made on first use

    @classmethod
    def of(cls, corners: Array, radius: Array) -> Parts:
        """Group parts: the hulls of corners (m, 1 or 3, 3), swept by balls of these radii (m,)."""
        if (count := len(corners)) > GROUP_SIZE:
            order = _near_one_another(corners.mean(axis=1))
            corners, radius = corners[order], radius[order]
        corners = corners[:, np.minimum(np.arange(4), corners.shape[1] - 1)]
        levels, first, last = [(corners, radius)], [np.arange(count)], [np.arange(1, count + 1)]
        begin = 0  # of the last level
        while (size := len(levels[-1][0])) > 1:
            groups = np.arange(0, size, BRANCH if count > GROUP_SIZE else GROUP_SIZE)
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
        return Record("parts", self.corners, self.radius, self.size, self.first, self.last)

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


def _near_one_another(places: Array) -> Rows:
    """Return an order of places (m, 3) in which those in a row are near one another: along a Morton curve."""
    low, high = places.min(axis=0), places.max(axis=0)
    cells = ((places - low) * (1023.0 / max(float((high - low).max()), 1e-300))).astype(np.int64)  # ten bits
    for shift, kept in _SPREAD:
        cells = (cells | cells << shift) & kept
    return np.argsort(cells @ np.array([1, 2, 4]), kind="stable")


def _enclosed(corners: Array, radius: Array, first: Rows) -> tuple[Array, Array]:
    """Return the rectangles (c, 4, 3), and the radii (c,) of the balls that sweep them, which contain groups of nodes:
    the two longer sides of their boxes, swept by half of the third."""
    low, high = np.minimum.reduceat(corners.min(axis=1), first), np.maximum.reduceat(corners.max(axis=1), first)
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    flat = middle[:, None] + half[:, None] * _RECTANGLES[half.argmin(axis=1)]
    around = (
        np.maximum.reduceat(radius, first)
        + half.min(axis=1)
        + ROUNDING_SHARE * max(np.abs(low).max(), np.abs(high).max())
    )
    return flat, around


_SPREAD = ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249))  # puts two zeros between ten bits
_RECTANGLES = read_only(  # normal to each axis
    np.array([np.insert([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]], axis, 0.0, axis=1) for axis in range(3)])
)
