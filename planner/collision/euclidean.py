"""The exact Euclidean distance of many body pairs at many samples, by coal (the maintained successor of FCL).

The alternative distance for the obstacle penalty, for comparison with the HD-SDF: same bodies, same margin, same pairs.
The first body is the link's outer body, the second the obstacle's true shape (or another link's outer body), not its
planes.

coal proposes the normal n of a pair (from the second body to the first); the distance is computed here from supports,

    D = gap(n) − margin,   gap(n) = min_{a ∈ A} n·a − max_{b ∈ B} n·b  ≤  d(A, B),

exact to about 2e-7 m where n is the witness normal, and a lower bound whatever coal says. The gradient of D is the
motion of A's witness point along n (the envelope theorem). It jumps where d has kinks: between parallel faces the
witness points, and in overlaps the normal too, are one choice among many.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np

from hdplan.distance.baselines.coal import coal_hull
from hdplan.distance.bodies import ConvexBody
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.link_bodies import LinkBody
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.collision.pieces import Pieces
from hdplan.planner.geometry.rotations import slight_turns
from hdplan.planner.geometry.shape_table import Outline, operations
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import read_only
from hdplan.scenes.shapes import Shape

# [m] coal's distance and the gap along its own normal differ by more only where coal is wrong
DOUBTFUL_DIFFERENCE = 1e-6
NUDGE = 1e-5  # [rad] by which A is turned for another query: enough to break an exactly parallel contact
TURNS = read_only(slight_turns(3, NUDGE))
REQUEST = coal.DistanceRequest()
REQUEST.gjk_tolerance = REQUEST.epa_tolerance = 1e-8


class FclPairs(PairDistance):
    """D of the pairs' bodies, less the margin: exact, except in the contacts that coal gets wrong.

    In about one of a thousand exactly parallel contacts (one of a hundred with a cylinder) its distance is not the gap
    along its own normal; python-fcl, the older binding, crashes the whole process in some of them. There coal is
    queried again with A turned by NUDGE, and the largest gap counts, including that along the line of the centres. No
    pair is left out: D is always finite and never above the exact value, and the wrench is its derivative. Where a
    cylinder and a box aligned with it overlap deeply, coal may return a direction out that is not the shortest: there D
    is only a lower bound.
    """

    def __init__(self, pairs: BodyPairs, bodies: Sequence[LinkBody], halfspace_bodies: Sequence[HalfspaceBody]) -> None:
        """Take the pairs and the bodies that they index; the second body's margin is subtracted from every distance."""
        self.pairs = pairs
        self.first = {a: _swept(bodies[a].body) for a in set(pairs.body.tolist())}
        self.second = _Solids(halfspace_bodies)
        self.placements = Pieces.of(halfspace_bodies).placements  # (B, 4, 4) in the joints' frames

    @property
    def how(self) -> str:
        """Library and version."""
        return f"exact Euclidean distance by FCL (coal {coal.__version__}), one pair after another"

    def __call__(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return D (S,) [m], its wrench (S, 6) and D again, for S pairs (row of the pairs) at samples."""
        pairs = self.pairs
        a, b = pairs.body[pair], pairs.halfspace_body[pair]
        joint_a, joint_b = pairs.joint_a[pair], pairs.joint_b[pair]
        turn_b = kinematics.rotations[sample, joint_b]
        origin = (turn_b @ self.placements[b, :3, 3, None])[..., 0] + kinematics.translations[sample, joint_b]
        turn_b = turn_b @ self.placements[b, :3, :3]
        turn = turn_b.transpose(0, 2, 1) @ kinematics.rotations[sample, joint_a]  # A as seen from B
        shift = ((kinematics.translations[sample, joint_a] - origin)[:, None] @ turn_b)[:, 0]

        distance, normal, witness = self._ask(a, b, turn, shift)
        gap = self._gaps(a, b, turn, shift, normal)
        for k in np.flatnonzero(~(np.abs(gap - distance) <= DOUBTFUL_DIFFERENCE)):
            gap[k], normal[k], witness[k] = self._ask_again(int(a[k]), int(b[k]), turn[k], shift[k])
        force = (turn_b @ normal[..., None])[..., 0]
        point = (turn_b @ witness[..., None])[..., 0] + origin
        value = gap - pairs.margins[b]
        return value, np.concatenate([force, np.cross(point, force)], axis=1), value

    def _ask(self, a: Rows, b: Rows, turn: Array, shift: Array) -> tuple[Array, Array, Array]:
        """Return coal's distances (S,), normals (S, 3) and witness points on A (S, 3), in B's frames, as they are."""
        place, identity, result = coal.Transform3s(), coal.Transform3s(), coal.DistanceResult()
        distances, normals, witnesses = np.empty(len(a)), np.empty((len(a), 3)), np.empty((len(a), 3))
        for k, (i, j) in enumerate(zip(a.tolist(), b.tolist(), strict=True)):
            place.setRotation(turn[k])
            place.setTranslation(shift[k])
            result.clear()
            distances[k] = coal.distance(self.first[i].shape, place, self.second[j].shape, identity, REQUEST, result)
            normals[k], witnesses[k] = result.normal, result.getNearestPoint1()
        return distances, -normals, witnesses

    def _ask_again(self, a: int, b: int, turn: Array, shift: Array) -> tuple[float, Array, Array]:
        """Return the largest gap of one pair among the normals that turned poses and the centres give, the normal, and
        the point of A that is nearest along it."""
        count = 1 + len(TURNS)
        many_a, many_b, shifts = np.full(count, a), np.full(count, b), np.tile(shift, (count, 1))
        _, normals, _ = self._ask(many_a[1:], many_b[1:], turn @ TURNS, shifts[1:])
        corners = self.first[a].vertices @ turn.T + shift
        centres = corners.mean(axis=0) - self.second[b].centre
        length = float(np.linalg.norm(centres))
        between = centres / length if length else np.array([0.0, 0.0, 1.0])  # any direction will do
        normals = np.vstack([between, normals])
        gaps = self._gaps(many_a, many_b, np.tile(turn, (count, 1, 1)), shifts, normals)
        best = int(np.nanargmax(np.where(np.isfinite(gaps), gaps, np.nan)))  # the first is finite
        normal = normals[best]
        return float(gaps[best]), normal, corners[np.argmin(corners @ normal)] - self.first[a].ball * normal

    def _gaps(self, a: Rows, b: Rows, turn: Array, shift: Array, normal: Array) -> Array:
        """gap(n) (S,) [m] along normals (S, 3) in B's frames; NaN where the normal is not of length one."""
        inward = -(normal[:, None] @ turn)[:, 0]
        gaps: Array = np.einsum("si,si->s", normal, shift) - _supports(self.first, a, inward)
        gaps -= _supports(self.second, b, normal)
        gaps[~(np.abs(np.linalg.norm(normal, axis=1) - 1) <= 1e-9)] = np.nan
        return gaps


@dataclass(frozen=True, eq=False)
class _Swept:
    """The hull of `vertices`, swept by a ball, in its own frame."""

    shape: Any  # the same for coal
    vertices: Array  # (m, 3) [m]
    ball: float  # [m] radius

    @property
    def centre(self) -> Array:
        """A point inside (3,)."""
        return np.asarray(self.vertices.mean(axis=0))

    def support(self, directions: Array) -> Array:
        """h(d) = max d·x over the body, for unit directions (S, 3)."""
        values: Array = (directions @ self.vertices.T).max(axis=1)
        values += self.ball * np.linalg.norm(directions, axis=1)
        return values


@dataclass(frozen=True, eq=False)
class _Outlined:
    """One of the scene's shapes, in its own frame. Its support is a formula, looked up rather than stored, as it cannot
    be pickled."""

    shape: Any  # the same for coal
    outlined: Shape

    @property
    def centre(self) -> Array:
        """A point inside (3,)."""
        return np.zeros(3)

    def support(self, directions: Array) -> Array:
        """h(d) = max d·x over the shape, for unit directions (S, 3)."""
        return _outline(self.outlined).support(self.outlined, directions)


class _Solids(dict[int, _Swept | _Outlined]):
    """The true shapes of halfspace bodies, made when they are needed: of a cloud's thousands few are ever near."""

    def __init__(self, bodies: Sequence[HalfspaceBody]) -> None:
        super().__init__()
        self._bodies = bodies

    def __missing__(self, index: int) -> _Swept | _Outlined:
        self[index] = found = _solid(self._bodies[index].solid)
        return found


def _outline(shape: Shape) -> Outline:
    outline = operations(shape).outline
    if outline is None:
        raise TypeError(f"a {type(shape).__name__} has to be split into convex pieces first")
    return outline


def _supports(solids: Mapping[int, _Swept | _Outlined], index: Rows, directions: Array) -> Array:
    """The support of solid `index` (S,) in each direction (S, 3)."""
    result = np.empty(len(index))
    order = np.argsort(index, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(index[order])) + 1):
        if len(rows):
            result[rows] = solids[int(index[rows[0]])].support(directions[rows])
    return result


def _solid(shape: Shape | ConvexBody) -> _Swept | _Outlined:
    """A halfspace body's true shape."""
    if isinstance(shape, ConvexBody):
        return _swept(shape)
    _outline(shape)  # refuses a shape without one
    return _Outlined(operations(shape).coal(shape, ""), shape)


@functools.lru_cache(maxsize=4096)
def _swept(body: ConvexBody) -> _Swept:
    """A polytope swept by a ball; coal takes the radius off the distance of the polytopes."""
    shape = coal_hull(body)
    shape.setSweptSphereRadius(body.radius)
    return _Swept(shape, body.vertices, body.radius)
