"""The check that a link follows a curve of poses all along, from the first to the last without going back.

Between two poses of the curve the origin moves straight, and the link turns about a fixed axis by the shortest turn. A
motion follows it if there is a place u(t) on the curve for every instant, from the first pose at the beginning to the
last at the end, that never goes back and at which the link is within the tolerances. Where it comes from elsewhere, or
leaves, it does so within a radius around the curve's end, and all of the curve that it leaves out lies within that. Any
such u is a proof; the one here is the nearest place at some nodes of every interval between rows, ahead of the last
one, and even along the curve between these.

Parts of the motion are cut where u passes a pose, so that on each, with t = t_m + s h, |s| ≤ 1, origin and rotation of
the curve are c(s) = c + s c', ‖c'‖ half the way, and C(s) = exp(s [w]×) C, w half the turn. With the link's origin p,
its rotation P and the bounds of `path_bounds`,

    ‖p(s) − c(s)‖ ≤ max_{s = ±1} ‖p − c + s (p' − c')‖ + R,           or  ‖p − c‖ + Σ_j (|δ_j| + ε_j) ρ_j + ‖c'‖
    ‖P(s) − C(s)‖_F/√2 ≤ max_{s = ±1} ‖P − C + s (P' − [w]× C)‖_F/√2 + ½ (Σ_j |δ_j|)² + Σ_j ε_j + ½ ‖w‖²

as ‖[w]×[w]×‖_F = √2 ‖w‖². Of a link that is free about one of its axes only that axis counts, and the curve's is the
shortest way from each to the next: the chord of the axes is bounded likewise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.planner.certificate.path_parts import Part, Valued, WithTolerance, angles_between, no_greater_angle, spun
from hdplan.planner.certificate.pose_curve import PoseCurve
from hdplan.planner.certificate.verdict import at_most
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain, cross
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Rows

# of an interval between two rows, at which the nearest place is sought: more where few prove nothing
NODES = 1, 4


@dataclass(frozen=True, eq=False)
class Followed:
    """One motion along a curve, and the place on it at every instant."""

    curve: PoseCurve
    nodes: Array  # (k,) of the motion, in intervals between rows, while it is on the curve
    places: Array  # (k,) on the curve, in poses
    before: Array  # (j,) nodes up to the first of these
    after: Array  # (j,) nodes after the last of these

    @classmethod
    def by(cls, motion: Curve, curve: PoseCurve, robot: Robot, chain: Chain, nodes: int) -> Followed:
        """Look for the places at so many nodes of every interval."""
        count = len(motion) - 1
        interval, fraction = np.repeat(np.arange(count), nodes), np.tile(np.arange(nodes) / nodes, count)
        interval, fraction = np.append(interval, count - 1), np.append(fraction, 1.0)
        rotations, origins = curve.poses(*chain.frames(robot.pin_q(motion.at(interval, fraction))))
        first, last, begins, ends = curve.on_it(rotations, origins)
        at, on = interval + fraction, slice(first, last + 1)
        places = curve.places(rotations[on], origins[on], begins, ends)
        around = at[: max(first, 1) + 1], at[min(last, len(at) - 2) :]
        return cls(curve, at[on], places, *around)

    @property
    def spans(self) -> tuple[Rows, Array, Array]:
        """Parts of the motion on which the place stays between two poses: interval, start and width (k,)."""
        first, last = self.ways[[0, -1]]
        passed = self.curve.ahead[(self.curve.ahead > first) & (self.curve.ahead < last)]
        return spans_between(np.union1d(self.nodes, np.interp(passed, self.ways, self.nodes)))

    @property
    def rated(self) -> tuple[Rows, Array, Array]:
        """Parts of the motion on which the link's speed is limited: while it comes or leaves it is within its radius,
        and on the curve before it passes a place that is beyond."""
        begins, ends = self.curve.beyond()
        row = np.searchsorted(self.places, begins, side="right") - 1, np.searchsorted(self.places, ends)
        first, last = self.nodes[np.clip(row, 0, len(self.nodes) - 1)]
        first = self.before[0] if self.curve.comes is None else first
        last = self.after[-1] if self.curve.goes is None else last
        if first >= last:  # all of it
            first, last = self.before[0], self.after[-1]
        return spans_between(np.union1d(np.arange(np.ceil(first), np.floor(last) + 1.0), [first, last]))

    @cached_property
    def ways(self) -> Array:
        """Arc length along the curve to the places (k,), in tolerances: between the nodes this is linear."""
        return self.curve.way_to(self.places)

    def on(self, interval: Rows, start: Array, width: Array) -> tuple[Rows, Array, Array]:
        """Return on parts of the motion the segment of the curve, the fraction of it in the middle, and half of how
        much of it is passed (k,)."""
        ahead = self.curve.ahead
        begins, ends = (np.interp(interval + at, self.nodes, self.ways) for at in (start, start + width))
        segment = np.searchsorted(ahead, 0.5 * (begins + ends), side="right") - 1
        segment = np.clip(segment, 0, len(self.curve.steps) - 1)
        wide = np.maximum(np.diff(ahead)[segment], 1e-300)
        first, last = (np.clip((way - ahead[segment]) / wide, 0.0, 1.0) for way in (begins, ends))
        return segment, 0.5 * (first + last), 0.5 * (last - first)


def spans_between(cuts: Array) -> tuple[Rows, Array, Array]:
    """Return parts of a motion between places on it, in intervals between rows: interval, start and width (k,)."""
    interval = np.floor(0.5 * (cuts[:-1] + cuts[1:])).astype(np.int64)
    return interval, cuts[:-1] - interval, np.diff(cuts)


class _Along(WithTolerance):
    """The proven properties along the curve."""

    motion: Followed

    @property
    def link(self) -> str:
        """The link that follows the curve."""
        return self.motion.curve.link

    @property
    def spans(self) -> tuple[Rows, Array, Array]:
        """First parts of the motion."""
        return self.motion.spans


@dataclass(frozen=True, eq=False)
class OnCurve(_Along):
    """A link's origin, to be kept on the curve."""

    motion: Followed
    allowed: float  # [m]
    field: str = "path.follow.position_tolerance"

    def on(self, interval: Rows, start: Array, width: Array) -> Valued:
        """Return the constraint on parts of the motion."""
        curve = self.motion.curve
        segment, middle, half = self.motion.on(interval, start, width)
        _, there = curve.at(segment, middle)
        return _AtPlaces(self, there, half[:, None] * curve.steps[segment])

    def broken(self, found: float) -> str:
        """Words such as "tool0 is 7 mm away from its curve, 5 mm are allowed"."""
        return f"{self.link} is {found * 1e3:.3g} mm away from its curve, {self.allowed * 1e3:g} mm are allowed"

    def kept(self, worst: float) -> str:
        """Words such as "tool0 within 0.08 of 0.1 mm of its curve"."""
        return f"{self.link} within {at_most(worst * 1e3)} of {self.allowed * 1e3:g} mm of its curve"


@dataclass(frozen=True, eq=False)
class NearEnd(_Along):
    """A link's origin, to be kept near the beginning or the end of the curve while it is not on it."""

    motion: Followed
    allowed: float  # [m]
    field: str
    at_end: bool

    @property
    def spans(self) -> tuple[Rows, Array, Array]:
        """First parts of the motion."""
        return spans_between(self.motion.after if self.at_end else self.motion.before)

    @property
    def end(self) -> str:
        """The end of the curve, in a word."""
        return "end" if self.at_end else "beginning"

    def on(self, interval: Rows, start: Array, width: Array) -> Valued:
        """Return the constraint on parts of the motion."""
        there = np.broadcast_to(self.motion.curve.origins[-1 if self.at_end else 0], (len(interval), 3))
        return _AtPlaces(self, there, np.zeros_like(there))

    def broken(self, found: float) -> str:
        """Words such as "tool0 is 70 mm away from the end of its curve and not on it, 50 mm are allowed"."""
        away = f"{self.link} is {found * 1e3:.3g} mm away from the {self.end} of its curve and not on it"
        return f"{away}, {self.allowed * 1e3:g} mm are allowed"

    def kept(self, worst: float) -> str:
        """Words such as "tool0 blended within 42 of 50 mm of the end of its curve"."""
        within = f"within {at_most(worst * 1e3)} of {self.allowed * 1e3:g} mm"
        return f"{self.link} blended {within} of the {self.end} of its curve"


@dataclass(frozen=True, eq=False)
class TurnedAlong(_Along):
    """A link's rotation, to be kept at that of the curve."""

    motion: Followed
    allowed: float  # [rad]
    field: str = "path.follow.orientation_tolerance"

    def on(self, interval: Rows, start: Array, width: Array) -> Valued:
        """Return the constraint on parts of the motion."""
        curve = self.motion.curve
        segment, middle, half = self.motion.on(interval, start, width)
        turned, _ = curve.at(segment, middle)
        turn = half[:, None] * curve.turns[segment]
        return (_AtTurns if curve.axis is None else _AtAxes)(self, turned, turn)

    def broken(self, found: float) -> str:
        """Words such as "tool0 is turned by 0.2 rad against its curve, 0.05 are allowed"."""
        return f"{self.link} is turned by {found:.3g} rad against its curve, {self.allowed:g} are allowed"

    def kept(self, worst: float) -> str:
        """Words such as "tool0 turned within 0.02 of 0.05 rad against its curve"."""
        return f"{self.link} turned within {at_most(worst)} of {self.allowed:g} rad against its curve"


@dataclass(frozen=True, eq=False)
class _AtPlaces:
    whole: OnCurve | NearEnd
    there: Array  # (k, 3) c
    slope: Array  # (k, 3) c'

    def found(self, rotations: Array, origins: Array) -> Array:
        return _lengths(self.whole.motion.curve.poses(rotations, origins)[1] - self.there)

    def bound(self, part: Part, found: Array) -> Array:
        curve = self.whole.motion.curve
        here, motion = part.moved(curve.joint, curve.own[:3, 3], part.chain.carried_by[curve.joint])
        off, slope = here - self.there, cross(motion.omega, here) + motion.velocity - self.slope
        ends = np.maximum(_lengths(off + slope), _lengths(off - slope))
        return np.asarray(np.minimum(ends + motion.second, found + motion.first + _lengths(self.slope)))


@dataclass(frozen=True, eq=False)
class _AtTurns:
    whole: TurnedAlong
    there: Array  # (k, 3, 3) C
    turn: Array  # (k, 3) w

    def found(self, rotations: Array, origins: Array) -> Array:
        turned, _ = self.whole.motion.curve.poses(rotations, origins)
        return angles_between(self.there, turned)

    def bound(self, part: Part, found: Array) -> Array:
        here, _ = self.whole.motion.curve.poses(part.rotations, part.origins)
        omega, bent, turned = _turning(part, self.whole.motion.curve.joint)
        slope, most = spun(omega, here) - spun(self.turn, self.there), _lengths(self.turn)
        ends = np.maximum(*(np.linalg.norm(here - self.there + sign * slope, axis=(1, 2)) for sign in (1.0, -1.0)))
        return no_greater_angle(ends / np.sqrt(2.0) + bent + 0.5 * most**2, found + turned + most)


@dataclass(frozen=True, eq=False)
class _AtAxes:
    whole: TurnedAlong
    there: Array  # (k, 3, 3)
    turn: Array  # (k, 3)

    def found(self, rotations: Array, origins: Array) -> Array:
        one, other = self._axes(rotations, origins)
        return np.asarray(2.0 * np.arctan2(_lengths(one - other), _lengths(one + other)))

    def _axes(self, rotations: Array, origins: Array) -> tuple[Array, Array]:
        curve = self.whole.motion.curve
        assert curve.axis is not None
        return curve.poses(rotations, origins)[0][:, :, curve.axis], self.there[:, :, curve.axis]

    def bound(self, part: Part, found: Array) -> Array:
        one, other = self._axes(part.rotations, part.origins)
        omega, bent, turned = _turning(part, self.whole.motion.curve.joint)
        slope, most = cross(omega, one) - cross(self.turn, other), _lengths(self.turn)
        ends = np.maximum(_lengths(one - other + slope), _lengths(one - other - slope))
        return no_greater_angle(ends + bent + 0.5 * most**2, found + turned + most)


def _turning(part: Part, joint: int) -> tuple[Array, Array, Array]:
    """Return Ω (k, 3) of a joint's frame, how much its rotation may leave the straight way, and how much it turns at
    most (k,)."""
    moves = part.chain.carried_by[joint] & part.chain.revolute
    delta, off = part.delta * moves, (part.off * moves).sum(axis=1)
    turn = np.abs(delta).sum(axis=1)
    return np.einsum("kn,knc->kc", delta, part.axes), 0.5 * turn**2 + off, turn + off


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))
