"""How far two pieces are apart by their parts, triangles or balls: branch and bound over pairs of nodes of `parts`.

For every pair of nodes that together contain all pairs of parts, and every unit n, gap(n) of `exact_proximity` and the
bound of `interval_bounds` hold, with the motion of the bodies that the nodes belong to. Each direction that coal
proposes for the most critical pair is tried for all others too, in one product: mostly few are enough. Pairs that it
does not settle are opened, down to single parts. The least over all pairs is a lower bound of the distance; it is
exact, up to rounding, where coal proposes the best directions.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from hdplan.planner.certificate.exact_proximity import DOUBTFUL, Piece, best_direction, directions, transform
from hdplan.planner.certificate.rounding import ROUNDING
from hdplan.planner.motion.motion_bounds import Array, cross
from hdplan.scenes.array_types import Mask, Rows
from hdplan.scenes.once import read_only

MOST_AT_ONCE = 64  # pairs of nodes that coal is asked about before it is seen what their directions settle
KEPT = 8  # directions that are tried first next time


@dataclass(frozen=True, eq=False)
class Placed:
    """A piece at the midpoint of an interval, and its motion within it; by default it stands."""

    piece: Piece
    rotation: Array  # (3, 3)
    origin: Array  # (3,)
    omega: Array = field(default_factory=lambda: np.zeros(3))  # Ω of `motion_bounds`
    velocity: Array = field(default_factory=lambda: np.zeros(3))  # U

    @classmethod
    def at(cls, piece: Piece, pose: Array) -> Placed:
        """Return a piece that stands at a pose (4, 4)."""
        return cls(piece, pose[:3, :3], pose[:3, 3])

    @property
    def nodes(self) -> Rows:
        """The nodes that contain all of its parts."""
        return _WHOLE if self.piece.parts is None else self.piece.parts.top

    def reach(self, nodes: Rows, directions: Array) -> Array:
        """Return max n·(x + s x') over the points x of nodes, for directions n (k, 3) and s = 0, 1, −1: (3, k, nodes),
        or (3, k, 1) of a piece without parts."""
        n, parts = directions, self.piece.parts
        turn, slide = cross(n, self.omega[None]), n @ self.velocity
        ways = np.stack([n, n + turn, n - turn])  # (3, k, 3)
        offset = ways @ self.origin
        offset[1] += slide
        offset[2] -= slide
        local = (ways @ self.rotation).reshape(-1, 3)
        found = self.piece.support(local)[:, None] if parts is None else parts.support(nodes, local)
        return np.asarray(found.reshape(3, len(n), -1) + offset[:, :, None])

    def single(self, nodes: Rows) -> Mask:
        """Which nodes are parts, and not groups."""
        parts = self.piece.parts
        return np.ones(len(nodes), dtype=bool) if parts is None else parts.single(nodes)

    def size(self, node: int) -> float:
        """How large a group is [m]; 0 for a part."""
        return 0.0 if self.piece.parts is None else float(self.piece.parts.size[node])

    def children(self, node: int) -> Rows:
        """The nodes of a group."""
        assert self.piece.parts is not None
        return np.arange(self.piece.parts.first[node], self.piece.parts.last[node])

    def shape(self, node: int) -> tuple[Any, Any]:
        """Return a node and its place for coal."""
        if self.piece.parts is None:
            return self.piece.shape, self._place
        shape, rotation, origin = self.piece.parts.shape(node)
        return shape, transform(self.rotation @ rotation, self.rotation @ origin + self.origin)

    @cached_property
    def _place(self) -> Any:
        return transform(self.rotation, self.origin)

    def part(self, node: int) -> tuple[Piece, Array]:
        """Return a node as a piece, and its pose (4, 4)."""
        pose, local = np.eye(4), np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rotation, self.origin
        if (parts := self.piece.parts) is None:
            return self.piece, pose
        shape, local[:3, :3], local[:3, 3] = parts.shape(node)
        vertices = (parts.corners[node] - local[:3, 3]) @ local[:3, :3]
        return Piece(vertices, shape, ball=float(parts.radius[node])), pose @ local


@dataclass(frozen=True, eq=False)
class Found:
    """What was found for two pieces."""

    distance: float  # [m] lower bound of the signed distance at the midpoint
    bound: float  # [m] of the distance over the interval
    normals: Array  # (k, 3) directions to try first at a place near by


def distance(a: Piece, pose_a: Array, b: Piece, pose_b: Array) -> float:
    """Return the signed distance [m] of two pieces' parts, at poses (4, 4): negative in contact, minus the depth of the
    deepest pair. One piece wholly inside the other is not seen: see `containment`."""
    return part_distance(Placed.at(a, pose_a), Placed.at(b, pose_b)).distance


def closest_parts(a: Piece, pose_a: Array, b: Piece, pose_b: Array) -> tuple[Piece, Array, Piece, Array]:
    """Return the two parts that are closest, each with its pose (4, 4)."""
    one, other = Placed.at(a, pose_a), Placed.at(b, pose_b)
    search = _Search(one, other, (0.0, 0.0), _UP, np.inf, -np.inf)
    search.run()
    return *one.part(search.closest[0]), *other.part(search.closest[1])


def part_distance(
    a: Placed,
    b: Placed,
    moved: tuple[float, float] = (0.0, 0.0),
    normals: Array | None = None,
    within: float = np.inf,
    enough: float = -np.inf,
) -> Found:
    """Return what can be said about the distance of two pieces' parts.

    moved: by how much the two move against each other, to first order and beyond it [m] (`Motion`).
    normals: unit directions (k, 3) from b to a to try first.
    within: a distance larger than this need not be exact [m].
    enough: a bound over the interval need not be larger than this [m].
    """
    search = _Search(a, b, moved, _UP if normals is None else normals, within, enough)
    search.run()
    return Found(search.least, search.proven, search.normals[-KEPT:])


class _Search:
    """Pairs of nodes that may still matter, and the least that is known of all others."""

    def __init__(
        self, a: Placed, b: Placed, moved: tuple[float, float], normals: Array, within: float, enough: float
    ) -> None:
        self.a, self.b, self.moved = a, b, moved
        self.within, self.enough = within, enough
        self.normals = normals  # tried last
        self.one, self.other = np.repeat(a.nodes, len(b.nodes)), np.tile(b.nodes, len(a.nodes))
        self.distance, self.bound = self._bounds(self.one, self.other, normals)
        self.least = self.proven = np.inf  # of the pairs set aside
        self.known, self.closest = np.inf, (int(self.one[0]), int(self.other[0]))  # of single parts

    def run(self) -> None:
        """Refine the pairs that matter, the closest first, until none does."""
        size = 1
        while True:
            settled = ~self._matters()
            self._set_aside(settled)
            self._replace(settled, ())
            if not len(self.one):
                return
            self._refine(np.argsort(self.distance, kind="stable")[:size])
            size = min(2 * size, MOST_AT_ONCE)

    def _matters(self) -> Mask:
        """Which pairs may come closer than what is known, or have to be proven."""
        closer = (self.distance <= self.within) & (self.distance < self.known - ROUNDING)
        return closer | (self.bound < self.enough) if self.proven >= self.enough else closer

    def _set_aside(self, rows: Mask | Rows) -> None:
        self.least = min(self.least, float(self.distance[rows].min(initial=np.inf)))
        self.proven = min(self.proven, float(self.bound[rows].min(initial=np.inf)))

    def _replace(self, gone: Mask, children: Sequence[tuple[Rows, Rows]]) -> None:
        """Put other pairs in the place of some."""
        kept = ~gone
        one, other, distance, bound = self.one[kept], self.other[kept], self.distance[kept], self.bound[kept]
        if children:
            more, others = (np.concatenate(each) for each in zip(*children, strict=True))
            one, other = np.append(one, more), np.append(other, others)
            low, proven = self._bounds(more, others, self.normals)
            distance, bound = np.append(distance, low), np.append(bound, proven)
        self.one, self.other, self.distance, self.bound = one, other, distance, bound

    def _refine(self, rows: Rows) -> None:
        """Ask coal about pairs; set aside those of single parts, and open the others."""
        pairs = list(zip(self.one[rows].tolist(), self.other[rows].tolist(), strict=True))
        single = self.a.single(self.one[rows]) & self.b.single(self.other[rows])
        normals, said = directions((*self.a.shape(i), *self.b.shape(j)) for i, j in pairs)
        self._ask(normals)
        doubtful = single & ~((said > 0.0) & (np.abs(self.distance[rows] - said) < DOUBTFUL))
        if doubtful.any():
            asked = [(*self.a.part(i), *self.b.part(j)) for i, j in itertools.compress(pairs, doubtful)]
            self._ask(np.array([best_direction(*each)[0] for each in asked]))
        if single.any():
            parts = rows[single]
            row = parts[self.distance[parts].argmin()]
            if self.distance[row] < self.known:
                self.known, self.closest = float(self.distance[row]), (int(self.one[row]), int(self.other[row]))
            self._set_aside(parts)
        opened = ~single & self._matters()[rows]
        gone = np.zeros(len(self.one), dtype=bool)
        gone[rows[single | opened]] = True
        self._replace(gone, [self._children(i, j) for i, j in itertools.compress(pairs, opened)])

    def _children(self, one: int, other: int) -> tuple[Rows, Rows]:
        """Return the pairs of the children of the larger of two nodes with the other one."""
        if self.a.size(one) > self.b.size(other):
            found = self.a.children(one)
            return found, np.full(len(found), other)
        found = self.b.children(other)
        return np.full(len(found), one), found

    def _ask(self, normals: Array) -> None:
        """Raise all bounds by these directions (k, 3)."""
        distance, bound = self._bounds(self.one, self.other, normals)
        self.distance, self.bound = np.maximum(self.distance, distance), np.maximum(self.bound, bound)
        self.normals = np.concatenate([self.normals[-KEPT:], normals])

    def _bounds(self, one: Rows, other: Rows, normals: Array) -> tuple[Array, Array]:
        """Return the bounds of pairs, the best by any of these directions (k, 3): at the midpoint, over the interval."""
        gaps = -_each(self.a, one, -normals) - _each(self.b, other, normals)  # (3, k, pairs)
        bound = np.maximum(np.minimum(gaps[1], gaps[2]) - self.moved[1], gaps[0] - self.moved[0])
        return gaps[0].max(axis=0), bound.max(axis=0) - ROUNDING


def _each(placed: Placed, nodes: Rows, directions: Array) -> Array:
    """Return how far each of these nodes reaches, some of which may be the same."""
    if placed.piece.parts is None:
        return placed.reach(nodes, directions)
    different, which = np.unique(nodes, return_inverse=True)
    return placed.reach(different, directions)[:, :, which]


_WHOLE = read_only(np.zeros(1, dtype=np.int64))  # the only node of a piece without parts
_UP = read_only(np.array([[0.0, 0.0, 1.0]]))
