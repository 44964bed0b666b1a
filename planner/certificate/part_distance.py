"""Distance of two pieces by their parts, triangles or balls: branch and bound over pairs of nodes of `parts`.

For every pair of nodes that together contain all pairs of parts, and every unit n, gap(n) of `exact_proximity` and the
bound of `interval_bounds` hold, with the motion of the nodes' bodies. Each direction that coal
proposes for the most critical pair is tried for all others too, in one product: mostly few are enough. Pairs that it
does not settle are opened, down to single parts. The least over all pairs is a lower bound of the distance; it is
exact, up to rounding, where coal proposes the best directions.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import coal
import numpy as np

from hdplan.planner.certificate.exact_proximity import DOUBTFUL_DIFFERENCE, TURNS, Piece, directions
from hdplan.planner.certificate.parts_loop import Side, Walk
from hdplan.planner.certificate.rounding import ROUNDING
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import check_time
from hdplan.scenes.once import read_only

MOST_AT_ONCE = 64  # pairs of parts in one query of coal, before their directions are used
KEPT_DIRECTIONS = 8  # directions that are tried first next time
EQUAL_SHARE = 1e-7  # share of a distance by which another pair of parts must be closer to be sought


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

    def along(self, directions: Array) -> Side:
        """Return the supports of the piece along directions n (k, 3)."""
        turned, centers = self._turned
        ways, offsets = (directions @ turned).reshape(-1, 3, 3), directions @ centers
        if self.piece.parts is None:
            offsets += self.piece.support(ways.reshape(-1, 3)).reshape(offsets.shape)
        return Side(self.piece.parts, ways, offsets)

    @cached_property
    def _turned(self) -> tuple[Array, Array]:
        """Matrices (3, 9), (3, 3) that turn n into n + s n × Ω in the piece's frame, and into how far the piece's
        origin is along it with its motion, for s = 0, 1, −1."""
        x, y, z = self.omega.tolist()
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])  # n @ across = n × Ω
        ways = _EYE + _SIGNS[:, None, None] * across  # (3, 3, 3)
        turned = (ways @ self.rotation).transpose(1, 0, 2).reshape(3, 9)
        return turned, (ways @ self.origin + _SIGNS[:, None] * self.velocity).T

    def shape(self, node: int, turn: Array | None = None) -> tuple[Any, Any]:
        """Return a part and its place for coal, slightly turned by a rotation (3, 3) if one is given."""
        shape, origin = (self.piece.shape, None) if self.piece.parts is None else self.piece.parts.shape(node)
        if turn is None and origin is None:
            return shape, self._place
        rotation = self.rotation if turn is None else self.rotation @ turn
        return shape, coal.Transform3s(rotation, self.origin if origin is None else rotation @ origin + self.origin)

    @cached_property
    def _place(self) -> Any:
        return coal.Transform3s(self.rotation, self.origin)

    def part(self, node: int) -> tuple[Piece, Array]:
        """Return a part as a piece, and its pose (4, 4)."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rotation, self.origin
        if (parts := self.piece.parts) is None:
            return self.piece, pose
        shape, origin = parts.shape(node)
        vertices = parts.corners[node]
        if origin is not None:
            vertices, pose[:3, 3] = vertices - origin, pose[:3, 3] + self.rotation @ origin
        return Piece(vertices, shape, ball=float(parts.radius[node])), pose


@dataclass(frozen=True, eq=False)
class Found:
    """Findings for two pieces."""

    distance: float  # [m] lower bound of the signed distance at the midpoint
    bound: float  # [m] of the distance over the interval
    normals: Array  # (k, 3) directions to try first at a nearby place
    closest: tuple[int, int]  # the two parts that are, if their distance was requested


def distance(a: Piece, pose_a: Array, b: Piece, pose_b: Array, within: float = np.inf) -> float:
    """Return the signed distance [m] of two pieces' parts, at poses (4, 4): 0 where triangles are in contact, minus the
    depth where balls are. One larger than `within` [m] is a lower bound, larger, too. One piece wholly inside the other
    is not seen: see `containment`."""
    return part_distance(Placed.at(a, pose_a), Placed.at(b, pose_b), within=within).distance


def closest_parts(a: Piece, pose_a: Array, b: Piece, pose_b: Array) -> tuple[Piece, Array, Piece, Array]:
    """Return the two parts that are closest, each with its pose (4, 4)."""
    one, other = Placed.at(a, pose_a), Placed.at(b, pose_b)
    i, j = part_distance(one, other).closest
    return *one.part(i), *other.part(j)


def part_distance(
    a: Placed,
    b: Placed,
    moved: tuple[float, float] = (0.0, 0.0),
    normals: Array | None = None,
    within: float = np.inf,
    enough: float = -np.inf,
) -> Found:
    """Return bounds of the distance between two pieces' parts. Raises TimeLimitError.

    moved: by how much the two move against each other, to first order and beyond it [m] (`Motion`).
    normals: unit directions (k, 3) from b to a to try first.
    within: a distance larger than this need not be exact [m].
    enough: a bound over the interval need not be larger than this [m].
    """
    tried = _UP if normals is None else normals
    moved = moved[0] + ROUNDING, moved[1] + ROUNDING
    walk = Walk(a.along(-tried), b.along(tried), moved, within, enough)
    most, found, closest = 1, np.inf, (0, 0)
    while len(pairs := walk.go_on(most)):
        check_time("measuring the distance of meshes")
        normals, proposed = directions((*a.shape(i), *b.shape(j)) for i, j in pairs.tolist())
        distances, bounds = walk.ask(a.along(-normals), b.along(normals), pairs)
        sure = (proposed > 0.0) & (np.abs(distances - proposed) < DOUBTFUL_DIFFERENCE)
        while not sure[row := int(distances.argmin())]:  # the others are not closer than it seems
            sure[row] = True
            i, j = pairs[row].tolist()
            again, _ = directions((*a.shape(i, turn), *b.shape(j)) for turn in TURNS)
            distances, bounds = walk.ask(a.along(-again), b.along(again), pairs)
            normals = np.concatenate([normals, again])
        tried = np.concatenate([tried, normals])
        walk.settle(float(distances[row]), float(bounds.min()))
        if (least := float(distances[row])) < found:
            found, closest = least, (int(pairs[row, 0]), int(pairs[row, 1]))
            walk.known = found - max(EQUAL_SHARE * found, ROUNDING)
        if found <= 0.0 and a.piece.grains is None and b.piece.grains is None:  # how deep is of no use
            return Found(0.0, -np.inf, tried[-KEPT_DIRECTIONS:], closest)
        most = min(2 * most, MOST_AT_ONCE)
    return Found(walk.least, walk.proven, tried[-KEPT_DIRECTIONS:], closest)


_EYE = read_only(np.eye(3))
_SIGNS = read_only(np.array([0.0, 1.0, -1.0]))
_UP = read_only(np.array([[0.0, 0.0, 1.0]]))
