"""The certificate's check of path constraints: whether a motion keeps them all along, proven between the rows too.

On a part of the motion q(s) = q_m + s δ + e(s), |s| ≤ 1, |e_j(s)| ≤ ε_j (`Curve.part`), everything evaluated at q_m:

*Upright.* The link's axis a is rotated by the revolute joints that carry it. With a' = Σ_j δ_j z_j × a and ‖∂²a/∂q_i
∂q_j‖ ≤ 1, the chord to the upward direction z is at most

    ‖a(s) − z‖ ≤ max_{s = ±1} ‖a − z + s a'‖ + ½ (Σ_j |δ_j|)² + Σ_j ε_j,    angle = 2 arcsin(chord/2),

as the norm is convex in s, and a joint deviation of ε_j rotates the axis by no more than that. Coarser: the angle grows
by Σ_j |δ_j| + ε_j at most.

*Within.* Along each axis of the box, the point's coordinate u is bounded, with v' and R of `motion_bounds`, by

    |u(s)| ≤ max_{s = ±1} |u + s u'| + R,    or    |u| + Σ_j (|δ_j| + ε_j) ρ_j.

A part whose bound does not suffice is halved; a violation found at a midpoint is a fact. Angles in [rad], excursions in
[m]: how far the point is beyond the nearest face of the box, negative inside. Placements are Pinocchio's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Array, Chain, Motion, cross
from hdplan.planner.robot.link_frame import link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.deadline import seconds_left
from hdplan.scenes.errors import naming
from hdplan.scenes.once import read_only
from hdplan.scenes.path_constraints import Upright, Within

UP = read_only(np.array([0.0, 0.0, 1.0]))  # in the world
GRANTED = 1e-9  # [rad] or [m] beyond the tolerance that is accepted, for rounding errors
ROUNDING = 1e-9  # [rad] or [m] added to every bound
SLACK = 0.02  # share of the tolerance by which the proven worst value may exceed the worst one found
SHORTEST = 2.0**-17  # of an interval: below it, the answer is "not proven"


@dataclass(frozen=True)
class Departure:
    """A place where a constraint is violated or not proven to be kept: the worst one found in its interval."""

    field: str  # "path.upright" or "path.position"
    link: str
    interval: int  # between rows `interval` and `interval` + 1
    fraction: float  # of that interval, 0 to 1
    parameter: float  # of the whole motion, 0 to 1
    found: float  # the angle [rad], or how far beyond the box [m]
    allowed: float  # the tolerance [rad], or 0 [m]

    @property
    def excess(self) -> float:
        """By how much it exceeds what is allowed [rad] or [m]; negative where it only could not be proven."""
        return self.found - self.allowed

    @property
    def violated(self) -> bool:
        """Whether the constraint is violated there; otherwise it only could not be proven."""
        return self.found > self.allowed + GRANTED

    @property
    def words(self) -> str:
        """A message such as "path.upright: panda_hand is tilted by 0.2 rad, 0.1 are allowed"."""
        if self.field == "path.upright":
            return f"{self.field}: {self.link} is tilted by {self.found:.3g} rad, {self.allowed:g} are allowed"
        side = "outside" if self.found > 0.0 else "inside"
        return f"{self.field}: the point of {self.link} is {abs(self.found) * 1e3:.3g} mm {side} its box"


@dataclass(frozen=True)
class Kept:
    """How well one constraint is kept."""

    field: str
    link: str
    worst: float  # proven upper bound over the whole motion: angle [rad] or excursion [m]
    met: float  # the worst one found
    allowed: float

    @property
    def words(self) -> str:
        """A message on what is proven, such as "panda_hand upright within 0.083 of 0.1 rad"."""
        if self.field == "path.upright":
            return f"{self.link} upright within {self.worst:.3g} of {self.allowed:g} rad"
        return f"the point of {self.link} at least {max(0.0, -self.worst) * 1e3:.3g} mm inside its box"


@dataclass(frozen=True)
class PathProof:
    """What was found about a motion."""

    kept: tuple[Kept, ...]  # one for each constraint of the scene
    departures: tuple[Departure, ...]  # one for every constraint and interval without proof
    configurations: int  # evaluated


class PathCheck:
    """The path constraints of one scene, prepared for many motions."""

    def __init__(self, setup: Setup, chain: Chain) -> None:
        """Look up the links. Raises InputError for one that the robot does not have or that does not move."""
        scene, robot = setup.scene, setup.robot
        self.robot, self.chain = robot, chain
        with naming(scene.source):
            given = (scene.path.upright, scene.path.position)
            self.constraints = tuple(_constraint(asked, robot) for asked in given if asked is not None)

    def at(self, q: Array) -> tuple[Departure, ...]:
        """Return the constraints that configuration q (n,) violates; exact up to rounding."""
        frames = self.chain.frames(self.robot.pin_q(q[None]))
        found = [(each, float(each.found(*frames)[0])) for each in self.constraints]
        departures = (Departure(each.field, each.link, 0, 0.0, 0.0, value, each.allowed) for each, value in found)
        return tuple(departure for departure in departures if departure.violated)

    def prove(self, curve: Curve) -> PathProof:
        """Prove every constraint over the whole motion, or find where it cannot be proven."""
        proofs = [self._prove(constraint, curve) for constraint in self.constraints]
        return PathProof(
            tuple(kept for kept, _, _ in proofs),
            tuple(departure for _, departures, _ in proofs for departure in departures),
            sum(count for _, _, count in proofs),
        )

    def _prove(self, held: _Upright | _Within, curve: Curve) -> tuple[Kept, list[Departure], int]:
        intervals, configurations = len(curve) - 1, 0
        interval, start, width = np.arange(intervals), np.zeros(intervals), np.ones(intervals)
        travel = _travel(*curve.part(interval, start, width))
        failed, broken = np.zeros(intervals, dtype=bool), np.zeros(intervals, dtype=bool)
        worst, place = np.full(intervals, -np.inf), np.zeros(intervals)  # found on each interval, and where
        proven, slack = -np.inf, max(SLACK * held.scale, GRANTED)
        while len(interval):
            middle, delta, off = curve.part(interval, start, width)
            frames = self.chain.frames(self.robot.pin_q(middle))
            found = held.found(*frames)
            bound = np.maximum(held.bound(self.chain, *frames, delta, off, travel, found), found) + ROUNDING
            configurations += len(interval)
            for i in np.flatnonzero(found > worst[interval]).tolist():
                if found[i] > worst[interval[i]]:
                    worst[interval[i]], place[interval[i]] = found[i], start[i] + 0.5 * width[i]
            broken |= worst > held.allowed + GRANTED
            settled = (bound <= held.allowed + GRANTED) | broken[interval]
            closed = settled & (bound <= worst.max() + slack)
            closed |= (width <= SHORTEST) | (seconds_left() == 0.0)
            failed[interval[closed & ~settled]] = True
            proven = max(proven, float(bound[closed].max(initial=-np.inf)))
            width = np.repeat(0.5 * width[~closed], 2)
            start = np.repeat(start[~closed], 2) + width * np.tile([0.0, 1.0], len(width) // 2)
            interval = np.repeat(interval[~closed], 2)
        departures = [
            Departure(
                held.field,
                held.link,
                i,
                float(place[i]),
                float((i + place[i]) / intervals),
                float(worst[i]),
                held.allowed,
            )
            for i in np.flatnonzero(failed | broken).tolist()
        ]
        return Kept(held.field, held.link, proven, float(worst.max()), held.allowed), departures, configurations


@dataclass(frozen=True, eq=False)
class _Upright:
    """A link's axis, to be kept upright."""

    link: str
    joint: int  # the model's joint that carries the link
    axis: Array  # (3,) unit, in the joint's frame
    allowed: float  # [rad]
    field: str = "path.upright"

    @property
    def scale(self) -> float:
        return self.allowed

    def found(self, rotations: Array, _: Array) -> Array:
        """Return the angle (k,) to the upward direction, exact: Kahan's formula, accurate near 0 and π too."""
        axis = rotations[:, self.joint] @ self.axis
        chord, other = np.linalg.norm(axis - UP, axis=1), np.linalg.norm(axis + UP, axis=1)
        return np.asarray(2.0 * np.arctan2(chord, other))

    def bound(
        self, chain: Chain, rotations: Array, _: Array, delta: Array, off: Array, travel: Array, found: Array
    ) -> Array:
        """Return an upper bound of the angle (k,) on the parts."""
        turning = chain.carried_by[self.joint] & chain.revolute
        axis, delta, off = rotations[:, self.joint] @ self.axis, delta * turning, (off * turning).sum(axis=1)
        axes = np.einsum("knij,nj->kni", rotations[:, 1:], chain.axes)
        slope, turn = cross(np.einsum("kn,knc->kc", delta, axes), axis), np.abs(delta).sum(axis=1)
        ends = np.maximum(np.linalg.norm(axis - UP + slope, axis=1), np.linalg.norm(axis - UP - slope, axis=1))
        chord = ends + 0.5 * turn**2 + off
        return np.asarray(np.minimum(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)), found + turn + off))


@dataclass(frozen=True, eq=False)
class _Within:
    """A point of a link, to be kept in a box."""

    link: str
    joint: int
    point: Array  # (3,) in the joint's frame
    box: Array  # (4, 4) the box in the world
    half: Array  # (3,) half its edges; inf where it is unbounded
    allowed: float = 0.0  # [m]
    field: str = "path.position"

    @property
    def scale(self) -> float:
        return float(self.half.min())

    def found(self, rotations: Array, origins: Array) -> Array:
        """Return how far the point is beyond the box (k,), exact along its axes."""
        place = rotations[:, self.joint] @ self.point + origins[:, self.joint]
        return np.asarray((np.abs(self._in_box(place - self.box[:3, 3])) - self.half).max(axis=1))

    def bound(
        self, chain: Chain, rotations: Array, origins: Array, delta: Array, off: Array, travel: Array, found: Array
    ) -> Array:
        """Return an upper bound of the excursion (k,) on the parts."""
        carried = chain.carried_by[self.joint]
        place = rotations[:, self.joint] @ self.point + origins[:, self.joint]
        axes, points = np.einsum("knij,nj->kni", rotations[:, 1:], chain.axes), origins[:, 1:]
        everywhere = chain.reach(self.joint, self.point[None], 0.0, travel)
        joints, radii = np.array([self.joint]), np.zeros(1)
        half = np.abs(delta) + off
        reach = chain.local_reach(everywhere[None], joints, place[:, None], radii, axes, points, half)[:, 0]
        motion = Motion.of(chain, delta * carried, off * carried, axes, points, reach)
        now = self._in_box(place - self.box[:3, 3])
        slope = self._in_box(cross(motion.omega, place) + motion.velocity)
        second = np.maximum(np.abs(now + slope), np.abs(now - slope)) + motion.second[:, None]
        return np.asarray(np.minimum((second - self.half).max(axis=1), found + motion.first))

    def _in_box(self, vectors: Array) -> Array:
        return np.asarray(vectors @ self.box[:3, :3])


def _constraint(asked: Upright | Within, robot: Robot) -> _Upright | _Within:
    field = "path.upright" if isinstance(asked, Upright) else "path.position"
    frame = robot.model.frames[link_frame(robot, asked.link, field)]
    joint, placement = int(frame.parentJoint), frame.placement
    if isinstance(asked, Upright):
        axis = np.array(asked.axis) / np.linalg.norm(asked.axis)
        return _Upright(asked.link, joint, placement.rotation @ axis, asked.tolerance)
    point, half = placement.act(np.array(asked.point)), 0.5 * np.array(asked.size)
    return _Within(asked.link, joint, point, asked.pose.matrix, half)


def _travel(middle: Array, delta: Array, off: Array) -> Array:
    """Return the range (n, 2) of each joint coordinate over all parts."""
    reach = np.abs(delta) + off
    return np.stack([(middle - reach).min(axis=0), (middle + reach).max(axis=0)], axis=1)
