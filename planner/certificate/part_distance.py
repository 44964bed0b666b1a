"""How far two pieces are apart by their parts, triangles or balls: branch and bound over pairs of nodes of `parts`.

For every pair of nodes that together contain all pairs of parts, and every unit n, gap(n) of `exact_proximity` and the
bound of `interval_bounds` hold, with the motion of the bodies that the nodes belong to. Each direction that coal
proposes for the most critical pair is tried for all others too, in one product: mostly few are enough. Pairs that it
does not settle are opened, down to single parts. The least over all pairs is a lower bound of the distance; it is
exact, up to rounding, where coal proposes the best directions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hdplan.planner.certificate.exact_proximity import DOUBTFUL, Piece, best_direction, directions, transform
from hdplan.planner.certificate.parts import Parts
from hdplan.planner.certificate.rounding import ROUNDING
from hdplan.planner.motion.motion_bounds import Array, cross
from hdplan.scenes.array_types import Mask, Rows

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
    search = _searched(Placed.at(a, pose_a), Placed.at(b, pose_b))
    row = int(search.distance.argmin())
    return *search.a.part(int(search.one[row])), *search.b.part(int(search.other[row]))


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
    search = _searched(a, b, moved, normals, within, enough)
    return Found(float(search.distance.min()), float(search.bound.min()), search.normals[-KEPT:])


def _searched(
    a: Placed,
    b: Placed,
    moved: tuple[float, float] = (0.0, 0.0),
    normals: Array | None = None,
    within: float = np.inf,
    enough: float = -np.inf,
) -> _Search:
    search = _Search(a, b, moved)
    search.ask(np.array([[0.0, 0.0, 1.0]]) if normals is None or not len(normals) else normals)
    size = 1
    while len(rows := search.critical(within, enough)):
        search.refine(rows[:size])
        size = min(2 * size, MOST_AT_ONCE)
    return search


class _Search:
    def __init__(self, a: Placed, b: Placed, moved: tuple[float, float]) -> None:
        self.a, self.b, self.moved = _Side(a, -1.0), _Side(b, 1.0), moved
        count = len(self.b.nodes)
        self.one = np.repeat(np.arange(len(self.a.nodes)), count)  # pairs of places in the two sides' nodes
        self.other = np.tile(np.arange(count), len(self.a.nodes))
        self.distance, self.bound = np.full((2, len(self.one)), -np.inf)
        self.exact = np.zeros(len(self.one), dtype=bool)  # parts that coal was asked about
        self.normals = np.empty((0, 3))

    def ask(self, normals: Array) -> None:
        """Raise all bounds by these directions (k, 3)."""
        before, self.normals = len(self.normals), np.concatenate([self.normals, normals])
        self.a.ask(normals)
        self.b.ask(normals)
        distance, bound = self._bounds(self.one, self.other, before)
        self.distance, self.bound = np.maximum(self.distance, distance), np.maximum(self.bound, bound)

    def _bounds(self, one: Rows, other: Rows, before: int = 0) -> tuple[Array, Array]:
        """Return the bounds of pairs, by all directions but those `before`: at the midpoint, and over the interval."""
        gaps = -self.a.reach[:, before:, one] - self.b.reach[:, before:, other]  # (3, k, pairs)
        bound = np.maximum(np.minimum(gaps[1], gaps[2]) - self.moved[1], gaps[0] - self.moved[0])
        return gaps[0].max(axis=0), bound.max(axis=0) - ROUNDING

    def critical(self, within: float, enough: float) -> Rows:
        """Return the pairs that have to be looked at, the closest first."""
        known, proven = self.distance[self.exact].min(initial=np.inf), self.bound[self.exact].min(initial=np.inf)
        open_ones = (self.distance <= within) & (self.distance < known - ROUNDING)
        if proven >= enough:
            open_ones |= self.bound < enough
        rows = np.flatnonzero(open_ones & ~self.exact)
        return rows[np.argsort(self.distance[rows], kind="stable")]

    def refine(self, rows: Rows) -> None:
        """Ask coal about pairs, and open those that are not single parts."""
        one, other = self.one[rows], self.other[rows]
        single = self.a.single(one) & self.b.single(other)
        normals, said = directions(
            (*self.a.shape(i), *self.b.shape(j)) for i, j in zip(one.tolist(), other.tolist(), strict=True)
        )
        self.ask(normals)
        doubtful = single & ~((said > 0.0) & (np.abs(self.distance[rows] - said) < DOUBTFUL))
        if doubtful.any():
            pairs = zip(one[doubtful].tolist(), other[doubtful].tolist(), strict=True)
            self.ask(np.array([best_direction(*self.a.part(i), *self.b.part(j))[0] for i, j in pairs]))
        self.exact[rows[single]] = True
        if not single.all():
            self._open(rows[~single])

    def _open(self, rows: Rows) -> None:
        """Put in the place of pairs those of the children of the larger node."""
        pairs = []
        for i, j in zip(self.one[rows].tolist(), self.other[rows].tolist(), strict=True):
            if self.a.size(i) > self.b.size(j):
                children = self.a.open(i)
                pairs.append((children, np.full(len(children), j)))
            else:
                children = self.b.open(j)
                pairs.append((np.full(len(children), i), children))
        one, other = (np.concatenate(each) for each in zip(*pairs, strict=True))
        distance, bound = self._bounds(one, other)
        kept = np.ones(len(self.one), dtype=bool)
        kept[rows] = False
        self.one, self.other = np.append(self.one[kept], one), np.append(self.other[kept], other)
        self.distance, self.bound = np.append(self.distance[kept], distance), np.append(self.bound[kept], bound)
        self.exact = np.append(self.exact[kept], np.zeros(len(one), dtype=bool))


class _Side:
    """One of the two pieces: the nodes looked at so far, and how far they reach along all directions tried."""

    def __init__(self, placed: Placed, sign: float) -> None:
        self.placed, self.sign = placed, sign
        self.parts: Parts | None = placed.piece.parts
        self.nodes = np.zeros(1, dtype=np.int64) if self.parts is None else self.parts.top
        self.tried = np.empty((3, 0, 3))  # directions in the piece's frame, for s = 0, 1, −1
        self.offset = np.empty((3, 0))  # of the piece's origin along them, at s
        self.reach = np.empty((3, 0, len(self.nodes)))  # max n·(x + s x') over each node's points x
        self.children: dict[int, Rows] = {}  # the places of those of a node, by its own

    def ask(self, normals: Array) -> None:
        """Compute how far all nodes reach."""
        n, place = self.sign * normals, self.placed
        turn, slide = cross(n, place.omega[None]), n @ place.velocity
        ways = np.stack([n, n + turn, n - turn])  # (3, k, 3)
        offset = ways @ place.origin
        offset[1] += slide
        offset[2] -= slide
        tried = ways @ place.rotation
        self.reach = np.concatenate([self.reach, self._support(self.nodes, tried, offset)], axis=1)
        self.tried, self.offset = np.concatenate([self.tried, tried], axis=1), np.concatenate([self.offset, offset], 1)

    def _support(self, nodes: Rows, tried: Array, offset: Array) -> Array:
        flat = tried.reshape(-1, 3)
        found = self.placed.piece.support(flat)[:, None] if self.parts is None else self.parts.support(nodes, flat)
        return np.asarray(found.reshape(*offset.shape, -1) + offset[:, :, None])

    def open(self, place: int) -> Rows:
        """Return the places of a node's children."""
        if place not in self.children:
            assert self.parts is not None
            node, begin = int(self.nodes[place]), len(self.nodes)
            more = np.arange(self.parts.first[node], self.parts.last[node])
            self.nodes = np.append(self.nodes, more)
            self.reach = np.concatenate([self.reach, self._support(more, self.tried, self.offset)], axis=2)
            self.children[place] = np.arange(begin, len(self.nodes))
        return self.children[place]

    def single(self, places: Rows) -> Mask:
        """Which nodes are parts, and not groups."""
        return np.ones(len(places), dtype=bool) if self.parts is None else self.parts.single(self.nodes[places])

    def size(self, place: int) -> float:
        """How large a group is [m]; 0 for a part, which is not opened."""
        return 0.0 if self.parts is None else float(self.parts.size[self.nodes[place]])

    def shape(self, place: int) -> tuple[Any, Any]:
        """Return a node and its place for coal."""
        if self.parts is None:
            return self.placed.piece.shape, transform(self.placed.rotation, self.placed.origin)
        shape, rotation, origin = self.parts.shape(int(self.nodes[place]))
        turned = self.placed.rotation
        return shape, transform(turned @ rotation, turned @ origin + self.placed.origin)

    def part(self, place: int) -> tuple[Piece, Array]:
        """Return a node as a piece, and its pose (4, 4)."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.placed.rotation, self.placed.origin
        if self.parts is None:
            return self.placed.piece, pose
        node = int(self.nodes[place])
        shape, rotation, origin = self.parts.shape(node)
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = rotation, origin
        vertices = (self.parts.corners[node] - origin) @ rotation
        return Piece(vertices, shape, ball=float(self.parts.radius[node])), pose @ local
