"""Whether a link follows a curve of poses all along, from the first to the last without going back.

Between two poses of the curve the origin moves straight, and the link turns about a fixed axis by the shortest turn. A
motion follows it if there is a place u(t) on the curve for every instant, from the first pose at the beginning to the
last at the end, that never goes back and at which the link is within the tolerances. Any such u is a proof; the one
here is the nearest place at `NODES` of every interval between rows, ahead of the last one, and linear between these.

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

import numpy as np

from hdplan.planner.certificate.path_bounds import Part, Valued, WithTolerance, angles_between, no_greater_angle, spun
from hdplan.planner.motion.curve import Curve, Index
from hdplan.planner.motion.motion_bounds import Chain, cross
from hdplan.planner.robot.link_frame import AXES, link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.path_constraints import Follow

NODES = 4  # of an interval between two rows, at which the nearest place is looked for
LOOK_AHEAD = 2.0  # of the link's own way since the last node, in tolerances: so far the next place is looked for
CATCH_UP = 1.0  # tolerances that it may be farther, to catch up
PARALLEL = 1e-12  # sine below which two directions have no axis of their own


@dataclass(frozen=True, eq=False)
class PoseCurve:
    """The poses of a link that is to follow them, and where the link is in the frame of the joint that carries it."""

    link: str
    joint: int
    own: Array  # (4, 4) the link in the joint's frame
    axis: int | None  # of the link, about which it is free
    origins: Array  # (N, 3)
    rotations: Array  # (N, 3, 3)
    steps: Array  # (N − 1, 3) from each origin to the next
    turns: Array  # (N − 1, 3) rotation vectors, or of the free axis
    tolerances: tuple[float, float]  # [m] and [rad]

    @classmethod
    def of(cls, robot: Robot, asked: Follow) -> PoseCurve:
        """Look up the link. Raises InputError as `link_frame`."""
        frame = robot.model.frames[link_frame(robot, asked.link, "path.follow")]
        poses = np.array([pose.matrix for pose in asked.poses])
        axis = AXES.index(asked.free_rotation) if asked.free_rotation in AXES else None
        origins, rotations = poses[:, :3, 3], poses[:, :3, :3]
        turns = turn_vectors(rotations[:-1], rotations[1:], axis)
        tolerances = asked.position_tolerance, asked.orientation_tolerance
        own = frame.placement.homogeneous
        joint, steps = int(frame.parentJoint), np.diff(origins, axis=0)
        return cls(asked.link, joint, own, axis, origins, rotations, steps, turns, tolerances)

    def poses(self, rotations: Array, origins: Array) -> tuple[Array, Array]:
        """Return the link's rotations (k, 3, 3) and origins (k, 3) from all joints' frames."""
        carried = rotations[:, self.joint]
        return carried @ self.own[:3, :3], carried @ self.own[:3, 3] + origins[:, self.joint]

    def at(self, segment: Index, fraction: Array) -> tuple[Array, Array]:
        """Return the curve's rotations (k, 3, 3) and origins (k, 3) at fractions (k,) of segments (k,)."""
        turned = scipy.spatial.transform.Rotation.from_rotvec(fraction[:, None] * self.turns[segment]).as_matrix()
        return turned @ self.rotations[segment], self.origins[segment] + fraction[:, None] * self.steps[segment]

    def places(self, rotations: Array, origins: Array) -> Array:
        """Return places (k,) on the curve, none before the last: near these rotations and origins of the link, one
        after the other; the first and the last are the curve's ends."""
        far, angle = self.tolerances
        way = np.hypot(_lengths(self.steps) / far, _lengths(self.turns) / angle)
        ahead = np.concatenate([[0.0], np.cumsum(way)])
        turned = _lengths(turn_vectors(rotations[:-1], rotations[1:], self.axis))
        moved = np.hypot(_lengths(np.diff(origins, axis=0)) / far, turned / angle)
        found, last, gone = np.zeros(len(origins)), len(self.steps) - 1, 0.0
        for k in range(1, len(origins) - 1):
            first = min(int(found[k - 1]), last)
            end = int(np.searchsorted(ahead, gone + LOOK_AHEAD * moved[k - 1] + CATCH_UP))
            near = np.arange(first, min(max(end, first + 1), last + 1))
            off, turn = origins[k] - self.origins[near], self._turn_from(near, rotations[k])
            inner = (off * self.steps[near]).sum(axis=1) / far**2 + (turn * self.turns[near]).sum(axis=1) / angle**2
            share = np.clip(inner / np.maximum(way[near] ** 2, 1e-300), 0.0, 1.0)
            share[0] = max(share[0], found[k - 1] - first)
            off, turn = off - share[:, None] * self.steps[near], turn - share[:, None] * self.turns[near]
            best = int(np.hypot(_lengths(off) / far, _lengths(turn) / angle).argmin())
            found[k] = max(found[k - 1], near[best] + share[best])
            gone = ahead[near[best]] + share[best] * way[near[best]]
        found[-1] = len(self.steps)
        return found

    def _turn_from(self, segment: Index, rotation: Array) -> Array:
        """Return about which rotation vectors (k, 3) take the curve from where segments begin to a rotation."""
        begins = self.rotations[segment]
        if self.axis is not None:
            return turn_vectors(begins, np.broadcast_to(rotation, begins.shape), self.axis)
        between = rotation @ begins.transpose(0, 2, 1)
        twice = between[:, [2, 0, 1], [1, 2, 0]] - between[:, [1, 2, 0], [2, 0, 1]]
        sine = 0.5 * _lengths(twice)
        angle = np.arctan2(sine, 0.5 * (np.trace(between, axis1=1, axis2=2) - 1.0))
        return np.asarray(twice * (0.5 * angle / np.maximum(sine, PARALLEL))[:, None])


@dataclass(frozen=True, eq=False)
class Followed:
    """One motion along a curve, and the place on it at every instant."""

    curve: PoseCurve
    nodes: Array  # (k,) of the motion, in intervals between rows
    places: Array  # (k,) on the curve, in poses

    @classmethod
    def by(cls, motion: Curve, curve: PoseCurve, robot: Robot, chain: Chain) -> Followed:
        """Look for the places."""
        count = len(motion) - 1
        interval, fraction = np.repeat(np.arange(count), NODES), np.tile(np.arange(NODES) / NODES, count)
        interval, fraction = np.append(interval, count - 1), np.append(fraction, 1.0)
        rotations, origins = curve.poses(*chain.frames(robot.pin_q(motion.at(interval, fraction))))
        return cls(curve, interval + fraction, curve.places(rotations, origins))

    @property
    def spans(self) -> tuple[Index, Array, Array]:
        """Parts of the motion on which the place stays between two poses: interval, start and width (k,)."""
        passed = np.interp(np.arange(1, len(self.curve.steps)), self.places, self.nodes)
        cuts = np.union1d(self.nodes, passed)
        interval = np.floor(0.5 * (cuts[:-1] + cuts[1:])).astype(np.int64)
        return interval, cuts[:-1] - interval, np.diff(cuts)

    def on(self, interval: Index, start: Array, width: Array) -> tuple[Index, Array, Array]:
        """Return on parts of the motion the segment of the curve, the fraction of it in the middle, and half of how
        much of it is passed (k,)."""
        begins, ends = (np.interp(interval + at, self.nodes, self.places) for at in (start, start + width))
        segment = np.minimum(np.floor(0.5 * (begins + ends)).astype(np.int64), len(self.curve.steps) - 1)
        first, last = np.clip(begins - segment, 0.0, 1.0), np.clip(ends - segment, 0.0, 1.0)
        return segment, 0.5 * (first + last), 0.5 * (last - first)


class _Along(WithTolerance):
    """What is kept along the curve."""

    motion: Followed

    @property
    def link(self) -> str:
        """Whose it is."""
        return self.motion.curve.link

    @property
    def spans(self) -> tuple[Index, Array, Array]:
        """Parts of the motion to begin with."""
        return self.motion.spans


@dataclass(frozen=True, eq=False)
class OnCurve(_Along):
    """A link's origin, to be kept on the curve."""

    motion: Followed
    allowed: float  # [m]
    field: str = "path.follow.position_tolerance"

    def on(self, interval: Index, start: Array, width: Array) -> Valued:
        """Return the constraint on parts of the motion."""
        curve = self.motion.curve
        segment, middle, half = self.motion.on(interval, start, width)
        _, there = curve.at(segment, middle)
        return _AtPlaces(self, there, half[:, None] * curve.steps[segment])

    def broken(self, found: float) -> str:
        """Such as "tool0 is 7 mm away from its curve, 5 mm are allowed"."""
        return f"{self.link} is {found * 1e3:.3g} mm away from its curve, {self.allowed * 1e3:g} mm are allowed"

    def kept(self, worst: float) -> str:
        """Such as "tool0 within 0.08 of 0.1 mm of its curve"."""
        return f"{self.link} within {worst * 1e3:.3g} of {self.allowed * 1e3:g} mm of its curve"


@dataclass(frozen=True, eq=False)
class TurnedAlong(_Along):
    """A link's rotation, to be kept at that of the curve."""

    motion: Followed
    allowed: float  # [rad]
    field: str = "path.follow.orientation_tolerance"

    def on(self, interval: Index, start: Array, width: Array) -> Valued:
        """Return the constraint on parts of the motion."""
        curve = self.motion.curve
        segment, middle, half = self.motion.on(interval, start, width)
        turned, _ = curve.at(segment, middle)
        turn = half[:, None] * curve.turns[segment]
        return (_AtTurns if curve.axis is None else _AtAxes)(self, turned, turn)

    def broken(self, found: float) -> str:
        """Such as "tool0 is turned by 0.2 rad against its curve, 0.05 are allowed"."""
        return f"{self.link} is turned by {found:.3g} rad against its curve, {self.allowed:g} are allowed"

    def kept(self, worst: float) -> str:
        """Such as "tool0 turned within 0.02 of 0.05 rad against its curve"."""
        return f"{self.link} turned within {worst:.3g} of {self.allowed:g} rad against its curve"


@dataclass(frozen=True, eq=False)
class _AtPlaces:
    whole: OnCurve
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


def turn_vectors(one: Array, other: Array, axis: int | None) -> Array:
    """Return the rotation vectors (k, 3) of the shortest turns from rotations (k, 3, 3) to others, or from one of their
    axes to that of the others."""
    if axis is None:
        found = scipy.spatial.transform.Rotation.from_matrix(other @ one.transpose(0, 2, 1)).as_rotvec()
        return np.asarray(found)
    begins, ends = one[:, :, axis], other[:, :, axis]
    about = cross(begins, ends)
    sine, cosine = _lengths(about), (begins * ends).sum(axis=1)
    return np.asarray(about * (np.arctan2(sine, cosine) / np.maximum(sine, PARALLEL))[:, None])
