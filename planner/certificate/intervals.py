"""Bodies on the intervals of a motion: where the pieces of links and obstacles are at each midpoint, and how they move.

Bodies and pairs of them are collected into arrays once (`Bodies`, `Pairs`); `Intervals` holds, for many intervals of
one motion at a time, the placements at their midpoints (Pinocchio's) and what the motion bounds need. What stands has
one place for all intervals: scenes have thousands of it. Obstacles may move on their own (`obstacle_motion`), at the
times of the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import coal
import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.certificate import bounds_loop
from hdplan.planner.certificate.exact_proximity import Piece
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain, Motion, cross
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.once import ReadOnly

if TYPE_CHECKING:
    from hdplan.planner.certificate.sizes import Sizes
    from hdplan.scenes.obstacle_motion import ObstacleMotion


@dataclass(frozen=True, eq=False)
class Body(ReadOnly):
    """One piece of a link or an obstacle."""

    name: str  # of the link or the obstacle
    piece: Piece
    joint: int = 0  # the model's joint that carries it; 0: the world
    placement: Array = field(default_factory=lambda: np.eye(4))  # (4, 4) of the piece in that joint's frame
    obstacle_motion: ObstacleMotion | None = None  # of a moving obstacle, in place of the placement

    def around(self, chain: Chain) -> tuple[float, float, float]:
        """Return a cylinder around it about its joint's axis, as `Chain.around` does."""
        points = self.piece.vertices @ self.placement[:3, :3].T + self.placement[:3, 3]
        return chain.around(self.joint, points, self.piece.sweep)


class Bodies:
    """All bodies of a scene and its robot, as arrays over g bodies."""

    def __init__(
        self, chain: Chain, bodies: Sequence[Body], to_pinocchio: Callable[[Array], Array], sizes: Sizes | None = None
    ) -> None:
        """Collect placements and bounds; `to_pinocchio` maps joint values (k, n) to configurations (k, nq). `sizes` are
        those of what is unknown, if anything is."""
        self.chain, self.bodies, self.to_pinocchio = chain, tuple(bodies), to_pinocchio
        self.sizes = sizes
        self.names = tuple(body.name for body in bodies)
        self.pieces = tuple(body.piece for body in bodies)
        self.joint = np.array([body.joint for body in bodies], dtype=np.int64)  # (g,)
        self.rotation = np.array([body.placement[:3, :3] for body in bodies]).reshape(-1, 3, 3)
        self.origin = np.array([body.placement[:3, 3] for body in bodies]).reshape(-1, 3)
        self.center = np.array([piece.center for piece in self.pieces]).reshape(-1, 3)  # of the bounding balls, boxes
        self.radius = np.array([piece.radius for piece in self.pieces])
        self.half = np.array([0.5 * (piece.high - piece.low) for piece in self.pieces]).reshape(-1, 3)  # box sizes / 2
        self.bounding = np.array([piece.surface is not None for piece in self.pieces], dtype=bool)  # a solid
        grainy = np.array([piece.grains is not None for piece in self.pieces], dtype=bool)
        self.hollow = self.bounding | grainy  # the hull is not the exact shape
        self.drifting = np.array([body.obstacle_motion is not None for body in bodies], dtype=bool)  # (g,)
        self.moving = np.flatnonzero((self.joint > 0) | self.drifting)  # (m,) the others stand
        self.free = self.drifting if sizes is None else self.drifting | (sizes.speed > 0.0)  # (g,) may move on its own
        # On interval k a body has row `row` + k `step` of the places (r, …) that `Intervals` holds.
        self.row, self.step = np.arange(len(bodies)), np.zeros(len(bodies), dtype=np.int64)
        self.row[self.moving] = len(bodies) + np.arange(len(self.moving))
        self.step[self.moving] = len(self.moving)
        self.transforms: dict[int, Any] = {}  # coal's, of what stands, made on first use

    @cached_property
    def standing(self) -> tuple[Array, Array, Array]:
        """Rotations, origins and centres of the bodies in the world (g, …), valid for static bodies."""
        return self.rotation, self.origin, np.einsum("gij,gj->gi", self.rotation, self.center) + self.origin

    def speed(self, g: int) -> float:
        """Return the greatest speed of any point of a drifting body [m/s]."""
        motion = self._motion(g)
        return float((_lengths(motion.velocity) + _lengths(motion.spin) * self._lever(g)).max())

    def latest(self, g: int) -> float:
        """Return the greatest |time| [s] of a drifting body's own poses."""
        return float(np.abs(self._motion(g).anchors).max())

    def farthest(self, g: int, time: float) -> float:
        """Return the greatest distance of a drifting body's origin from the world's [m] within `time` [s] of its
        poses."""
        motion = self._motion(g)
        gone = float(_lengths(motion.velocity).max()) * time if time > 0.0 else 0.0
        return float(_lengths(motion.poses[:, :3, 3]).max()) + gone

    def _lever(self, g: int) -> float:
        """Return a bound on the distance of a body's points from its origin [m]."""
        return float(np.linalg.norm(self.pieces[g].center)) + self.pieces[g].radius

    def _motion(self, g: int) -> ObstacleMotion:
        motion = self.bodies[g].obstacle_motion
        assert motion is not None
        return motion

    def drift(self, middle: Array, half: Array) -> tuple[Array, Motion]:
        """Return the poses of the drifting ones of the `moving` bodies at times `middle` (k,) [s], (k, m, 4, 4), and
        their motion within `half` (k,) [s] of these times, (k, m); the others of them are at rest.

        Within one segment a point x moves by s (ω × (x − o) + v) `half`, up to an error of ½ (|ω| half)² ‖x − o‖, with
        o the body's origin; over several segments it is no faster than in the fastest of them.
        """
        shape = (len(middle), len(self.moving))
        placements, omega, velocity = np.zeros((*shape, 4, 4)), np.zeros((*shape, 3)), np.zeros((*shape, 3))
        first, second = np.zeros(shape), np.zeros(shape)
        for g, motion, lever, turn, speeds in self._drifts:
            placements[:, g] = motion.at(middle)
            if len(speeds) == 1:
                begin, one = np.zeros(len(middle), dtype=np.int64), np.ones(len(middle), dtype=bool)
                first[:, g] = half * speeds[0]
            else:
                begin = motion.segment(middle - half)
                end = np.maximum(np.searchsorted(motion.begins, middle + half, side="left") - 1, begin)
                first[:, g] = half * [speeds[i : j + 1].max() for i, j in zip(begin, end, strict=True)]
                one = begin == end
            omega[:, g] = np.where(one[:, None], half[:, None] * motion.spin[begin], 0.0)
            velocity[:, g] = np.where(one[:, None], half[:, None] * motion.velocity[begin], 0.0)
            velocity[:, g] -= cross(omega[:, g], placements[:, g, :3, 3])
            second[:, g] = np.where(one, 0.5 * (half * turn[begin]) ** 2 * lever, first[:, g])
        return placements, Motion(omega, velocity, first, second)

    @cached_property
    def _drifts(self) -> list[tuple[int, ObstacleMotion, float, Array, Array]]:
        """Each drifting one of the `moving` bodies: its place among them, its motion, lever [m], and in each segment
        |ω| [rad/s] and the greatest speed of its points [m/s]."""
        found = []
        for g in np.flatnonzero(self.drifting[self.moving]).tolist():
            motion, lever = self._motion(self.moving[g]), self._lever(self.moving[g])
            turn = np.linalg.norm(motion.spin, axis=1)
            found.append((g, motion, lever, turn, np.linalg.norm(motion.velocity, axis=1) + turn * lever))
        return found

    def reach(self, curve: Curve) -> Array:
        """Return ρ (g, n) for all configurations of a motion."""
        low, high = curve.bounds()
        travel = np.stack([low.min(axis=0), high.max(axis=0)], axis=1)
        if self.sizes is not None:
            travel += np.outer(self.sizes.joints, [-1.0, 1.0])
        return self.chain.reach_around(self.joint, self._cylinders, travel)

    @cached_property
    def _cylinders(self) -> Array:
        """Around every body, as `Body.around` (g, 3)."""
        found = np.zeros((len(self.bodies), 3))  # nothing around what stands
        for row in np.flatnonzero(self.joint).tolist():
            found[row] = _around(self.chain, self.bodies[row])
        return found


def _rows(standing: Array, moving: Array) -> Array:
    """Return the rows (r, …) of what is standing (g, …), and of what is moving on each interval (k, m, …)."""
    return np.concatenate([standing, moving.reshape(-1, *standing.shape[1:])])


def _lengths(vectors: Array) -> Array:
    """Return the lengths (k,) of vectors (k, 3), without overflow."""
    return np.asarray(np.hypot(np.hypot(vectors[:, 0], vectors[:, 1]), vectors[:, 2]))


_cylinders: WeakKeyDictionary[Chain, WeakKeyDictionary[Body, tuple[float, float, float]]] = WeakKeyDictionary()


def _around(chain: Chain, body: Body) -> tuple[float, float, float]:
    """Return `Body.around`, once for as long as both are used: a body may hold a mesh of megabytes."""
    known = _cylinders.setdefault(chain, WeakKeyDictionary())
    if body not in known:
        known[body] = body.around(chain)
    return known[body]


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of bodies to be kept apart, in two groups: 0 link and obstacle, 1 link and link."""

    a: Rows  # (P,) rows of the list of bodies
    b: Rows  # (P,)
    group: Rows  # (P,)
    moves_a: Mask  # (P, n) joints that move a and not b
    moves_b: Mask  # (P, n) and the other way round

    @classmethod
    def of(cls, bodies: Bodies, table: Rows) -> Pairs:
        """Build from rows (a, b, group); pairs without relative motion are left out."""
        carried_by = bodies.chain.carried_by[bodies.joint]
        a, b = carried_by[table[:, 0]], carried_by[table[:, 1]]
        moving = (a != b).any(axis=1) | bodies.free[table[:, :2]].any(axis=1)
        return cls(table[moving, 0], table[moving, 1], table[moving, 2], (a & ~b)[moving], (b & ~a)[moving])


@dataclass(frozen=True, eq=False)
class Intervals:
    """k intervals of a motion, with everything about their midpoints."""

    bodies: Bodies
    interval: Rows  # (k,) waypoint interval
    start: Array  # (k,) within it, 0 to 1
    width: Array  # (k,)
    delta: Array  # (k, n) half of the joints' motion, signed, δ
    deviation: Array  # (k, n) by how much they may deviate from the straight line, ε
    rotation: Array  # (r, 3, 3) of the bodies, at `row`
    origin: Array  # (r, 3)
    center: Array  # (r, 3) of their bounding balls and boxes
    reach: Array  # (r, n) ρ
    axes: Array  # (k, n, 3) of the joints
    points: Array  # (k, n, 3) on the axes
    drift: Motion | None = None  # (r,) of bodies that move on their own
    transforms: dict[int, Any] = field(default_factory=dict)  # coal's, of what moves, made on first use
    of_curve: tuple[Curve, Array] | None = None  # of which they are intervals, and `bodies.reach` of that
    latest: Array = field(default_factory=lambda: np.zeros(0))  # (k,) greatest |time| [s], where sizes are unknown

    @classmethod
    def of(cls, bodies: Bodies, curve: Curve, rho: Array, interval: Rows, start: Array, width: Array) -> Intervals:
        """Place the bodies; `rho` is `bodies.reach(curve)`, the others are the fields of the class."""
        chain, moving = bodies.chain, bodies.moving
        middle, delta, deviation = curve.part(interval, start, width)
        latest = np.zeros(len(interval))
        if bodies.sizes is not None:
            deviation = deviation + bodies.sizes.joints
            if curve.times is not None:
                when, half = curve.span(interval, start, width)
                latest = np.abs(when) + half
        turned, moved = chain.frames(bodies.to_pinocchio(middle))
        joint = bodies.joint[moving]
        rotation = turned[:, joint] @ bodies.rotation[moving]
        origin = np.einsum("kgij,gj->kgi", turned[:, joint], bodies.origin[moving]) + moved[:, joint]
        drift = None
        if bodies.drifting.any():
            when, half = curve.span(interval, start, width)
            placements, own = bodies.drift(when, half)
            free = bodies.drifting[moving]
            rotation[:, free], origin[:, free] = placements[:, free, :3, :3], placements[:, free][..., :3, 3]
            drift = Motion(*(_rows(np.zeros((len(rho), *part.shape[2:])), part) for part in own.parts))
        center = origin + np.einsum("kgij,gj->kgi", rotation, bodies.center[moving])
        axes = np.einsum("knij,nj->kni", turned[:, 1:], chain.axes)
        axes, points = np.ascontiguousarray(axes), np.ascontiguousarray(moved[:, 1:])
        most = np.abs(delta) + deviation
        reach = chain.local_reach(rho[moving], joint, center, bodies.radius[moving], axes, points, most)
        standing = (*bodies.standing, np.zeros(rho.shape))
        rotation, origin, center, reach = map(_rows, standing, (rotation, origin, center, reach))
        places = rotation, origin, center, reach, axes, points, drift
        return cls(bodies, interval, start, width, delta, deviation, *places, of_curve=(curve, rho), latest=latest)

    @cached_property
    def instants(self) -> Intervals:
        """Their midpoints, as intervals that take no time."""
        assert self.of_curve is not None
        bodies, still = self.bodies, len(self.bodies.bodies)
        curve, rho = self.of_curve
        delta, joint = np.zeros_like(self.delta), bodies.joint[bodies.moving]
        deviation = delta if bodies.sizes is None else delta + bodies.sizes.joints
        center = self.center[still:].reshape(len(self.width), len(bodies.moving), 3)
        balls = center, bodies.radius[bodies.moving], self.axes, self.points
        reach = bodies.chain.local_reach(rho[bodies.moving], joint, *balls, deviation)
        when = curve.span(self.interval, self.start, self.width)[0] if self.latest.any() else self.latest
        return replace(
            self,
            start=self.start + 0.5 * self.width,
            width=np.zeros_like(self.width),
            delta=delta,
            deviation=deviation,
            reach=_rows(np.zeros(rho.shape), reach),
            drift=None if self.drift is None else Motion(*(np.zeros_like(part) for part in self.drift.parts)),
            latest=np.abs(when),
        )

    def row(self, node: Rows | int, body: Rows | int) -> Any:
        """Return the rows of bodies' places on intervals."""
        return self.bodies.row[body] + node * self.bodies.step[body]

    def motion(self, node: Rows, body: Rows, moves: Mask) -> Motion:
        """Return the motion of bodies (i,) on intervals (i,) due to the joints `moves` (i, n) alone, and what they
        drift."""
        delta, deviation, row = self.delta[node] * moves, self.deviation[node] * moves, self.row(node, body)
        found = Motion.of(self.bodies.chain, delta, deviation, self.axes[node], self.points[node], self.reach[row])
        return found if self.drift is None else found + self.drift[row]

    @cached_property
    def record(self) -> Record:
        """The record of the intervals for the loops in C."""
        return bounds_loop.intervals(self)

    @cached_property
    def moved(self) -> Array:
        """The farthest that each body moves (r,) [m]."""
        still, moving = len(self.bodies.bodies), (len(self.interval), len(self.bodies.moving), -1)
        reach = self.reach[still:].reshape(moving)
        far = _rows(np.zeros(still), np.einsum("kn,kgn->kg", np.abs(self.delta) + self.deviation, reach))
        return far if self.drift is None else far + self.drift.first

    def transform(self, row: int) -> Any:
        """Return one body's placement for coal."""
        known = self.bodies.transforms if row < len(self.bodies.bodies) else self.transforms
        if row not in known:
            known[row] = coal.Transform3s(self.rotation[row], self.origin[row])
        return known[row]

    def pose(self, node: int, body: int) -> Array:
        """Return one body's placement (4, 4)."""
        pose, row = np.eye(4), self.row(node, body)
        pose[:3, :3], pose[:3, 3] = self.rotation[row], self.origin[row]
        return pose
