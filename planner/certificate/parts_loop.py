"""The walk down two trees of `parts` with the directions known, in a loop of C, and in Python for machines without a
compiler: pairs of nodes that the directions settle, and pairs of single parts that they do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.distance.compiled.loops import C, Record, twin_of
from hdplan.planner.certificate.parts import GROUP_SIZE, Parts
from hdplan.scenes.array_types import Array, Rows

KEPT_DIRECTIONS = 64  # directions kept when more are found: the walk continues near where they were found


@dataclass
class Side:
    """One of two bodies: its parts, and along directions n (k, 3) and s = 0, 1, −1 what `walk` needs."""

    parts: Parts | None
    ways: Array  # (k, 3, 3) n + s n × Ω in the body's frame
    offsets: Array  # (k, 3) of the frame's origin along them, with its motion; of the whole body, if it has no parts

    def more(self, other: Side) -> Side:
        """The side with the directions of another, and the latest of its own."""
        pairs = (self.ways, other.ways), (self.offsets, other.offsets)
        return Side(self.parts, *(np.concatenate([own[-KEPT_DIRECTIONS:], new]) for own, new in pairs))

    def reach(self, nodes: Rows) -> Array:
        """Return max n·(x + s x') over the points x of nodes (i,): (k, 3, i)."""
        if self.parts is None:
            return np.repeat(self.offsets[:, :, None], len(nodes), axis=2)
        found = self.parts.support(nodes, self.ways.reshape(-1, 3)).reshape(*self.offsets.shape, -1)
        return np.asarray(found + self.offsets[:, :, None])

    @property
    def root(self) -> int:
        """The node of the whole body."""
        return 0 if self.parts is None else len(self.parts.first) - 1

    @property
    def depth(self) -> int:
        """The number of levels below it."""
        return 0 if self.parts is None else self.parts.depth - 1

    def single(self, node: int) -> bool:
        """True if a node is a part, and not a group."""
        return self.parts is None or bool(self.parts.first[node] == node)

    @property
    def record(self) -> Record:
        """The C struct of that name."""
        return Record("side", None if self.parts is None else self.parts.record, self.ways, self.offsets)


def _go_on(walk: Walk, open_ones: Rows) -> int:
    state = np.array([walk.least, walk.proven, walk.known, walk.within, walk.enough, *walk.moved])
    place = np.array([walk.height, walk.newest])
    left: int = C.walk(walk.a.record.struct, walk.b.record.struct, state, walk.stack, place, open_ones)
    walk.least, walk.proven = state[:2].tolist()
    walk.height, walk.newest = place.tolist()
    return left


class Walk:
    """A walk through all pairs of nodes of two bodies, and the least that is known of those behind it."""

    def __init__(self, a: Side, b: Side, moved: tuple[float, float], within: float, enough: float) -> None:
        """Begin at the roots. Pairs count as settled when their distance is larger than `within` [m] and their bound at
        least `enough`; the bodies are `moved` by this much at most, and by this much beyond a straight line [m]."""
        self.a, self.b, self.moved = a, b, moved
        self.within, self.enough = within, enough
        self.least = self.proven = self.known = np.inf  # [m] distance and bound of pairs settled, and what limits both
        self.stack = np.empty((1 + GROUP_SIZE * (a.depth + b.depth), 2), np.int64)
        self.stack[0], self.height, self.newest = (a.root, b.root), 1, 0

    def ask(self, a: Side, b: Side, pairs: Rows) -> tuple[Array, Array]:
        """Take more directions in place of the oldest, and return the best distances and bounds (i,) of pairs of
        nodes (i, 2)."""
        self.newest = max(self.newest - max(len(self.a.ways) - KEPT_DIRECTIONS, 0), 0)
        self.a, self.b = self.a.more(a), self.b.more(b)
        distances, bounds = self.bounds(*pairs.T)
        return distances.max(axis=0), bounds.max(axis=0)

    def bounds(self, one: Rows, other: Rows) -> tuple[Array, Array]:
        """Return the distances of pairs of nodes (k, i) by each direction, and the bounds."""
        gaps = -self.a.reach(one) - self.b.reach(other)  # (k, 3, i)
        straight = np.minimum(gaps[:, 1], gaps[:, 2]) - self.moved[1]
        return gaps[:, 0], np.maximum(straight, gaps[:, 0] - self.moved[0])

    def settle(self, distance: float, bound: float) -> None:
        """Record the bounds of a pair."""
        self.least, self.proven = min(self.least, distance), min(self.proven, bound)

    def go_on(self, most: int) -> Rows:
        """Settle pairs by the directions, until it is finished or `most` pairs of parts (i, 2) cannot be settled."""
        open_ones = np.empty((most, 2), np.int64)
        return open_ones[: self._go_on(open_ones)]

    @twin_of(_go_on)
    def _go_on(self, open_ones: Rows) -> int:
        left = 0
        while self.height > 0 and left < len(open_ones):
            self.height -= 1
            i, j = self.stack[self.height].tolist()
            distances, bounds = self.bounds(np.array([i]), np.array([j]))
            distance, bound = float(distances.max()), float(bounds.max())
            far = distance > self.within or distance >= self.known
            if far and (bound >= self.enough or not self.proven >= self.enough):
                self.settle(distance, bound)
            elif self.a.single(i) and self.b.single(j):
                open_ones[left], left = (i, j), left + 1
            else:
                one, other = self._children(i, j)
                far = self.bounds(one, other)[0][distances.argmax()]
                order = np.argsort(-far, kind="stable")  # the closest is examined first
                self.stack[self.height : self.height + len(one)] = np.stack([one, other], axis=1)[order]
                self.height += len(one)
        return left

    def _children(self, i: int, j: int) -> tuple[Rows, Rows]:
        """Return the pairs of the children of the larger of two nodes with the other one."""
        a, b = self.a.parts, self.b.parts
        if a is not None and (b is None or a.size[i] > b.size[j]):
            one = np.arange(a.first[i], a.last[i])
            return one, np.full(len(one), j)
        assert b is not None
        other = np.arange(b.first[j], b.last[j])
        return np.full(len(other), i), other
