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

from hdplan.distance.compiled.loops import Record, library
from hdplan.planner.certificate import places_loop
from hdplan.planner.certificate.path_bounds import Part, Valued, WithTolerance, angles_between, no_greater_angle, spun
from hdplan.planner.certificate.verdict import at_most
from hdplan.planner.geometry.rotations import matrices_of, vectors_of
from hdplan.planner.motion.curve import Curve, Index
from hdplan.planner.motion.motion_bounds import Chain, cross
from hdplan.planner.robot.link_frame import AXES, link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.path_constraints import Follow

# of an interval between two rows, at which the nearest place is sought: more where few prove nothing
NODES = 1, 4
LOOK_AHEAD = 2.0  # of the link's own way since the last node, in tolerances: how far the next place is sought
CATCH_UP = 1.0  # tolerances that it may be farther, to catch up
# tolerances that a place may be farther away than the nearest: where a curve turns back, its end comes later
SOONER = 0.25
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
    comes: float | None = None  # [m] around its beginning, within which the link comes from elsewhere
    goes: float | None = None  # [m] around its end, within which it leaves

    @classmethod
    def of(cls, robot: Robot, follow: Follow) -> PoseCurve:
        """Look up the link. Raises InputError as `link_frame`."""
        frame = robot.model.frames[link_frame(robot, follow.link, "path.follow")]
        poses = np.array([pose.matrix for pose in follow.poses])
        axis = AXES.index(follow.free_rotation) if follow.free_rotation in AXES else None
        origins, rotations = poses[:, :3, 3], poses[:, :3, :3]
        turns = turn_vectors(rotations[:-1], rotations[1:], axis)
        tolerances = follow.position_tolerance, follow.orientation_tolerance
        own = frame.placement.homogeneous
        joint, steps = int(frame.parentJoint), np.diff(origins, axis=0)
        ends = follow.begin_tolerance, follow.end_tolerance
        return cls(follow.link, joint, own, axis, origins, rotations, steps, turns, tolerances, *ends)

    def poses(self, rotations: Array, origins: Array) -> tuple[Array, Array]:
        """Return the link's rotations (k, 3, 3) and origins (k, 3) from all joints' frames."""
        carried = rotations[:, self.joint]
        return carried @ self.own[:3, :3], carried @ self.own[:3, 3] + origins[:, self.joint]

    def at(self, segment: Index, fraction: Array) -> tuple[Array, Array]:
        """Return the curve's rotations (k, 3, 3) and origins (k, 3) at fractions (k,) of segments (k,)."""
        turned = matrices_of(fraction[:, None] * self.turns[segment])
        return turned @ self.rotations[segment], self.origins[segment] + fraction[:, None] * self.steps[segment]

    @cached_property
    def ahead(self) -> Array:
        """Arc length along the curve to each of its poses (N,), in tolerances."""
        far, angle = self.tolerances
        way = np.hypot(_lengths(self.steps) / far, _lengths(self.turns) / angle)
        return np.asarray(np.concatenate([[0.0], np.cumsum(way)]))

    def way_to(self, places: Array) -> Array:
        """Return how far it is along the curve to places (k,), in tolerances."""
        return np.asarray(np.interp(places, np.arange(len(self.ahead)), self.ahead))

    def places(self, rotations: Array, origins: Array, first: float, last: float) -> Array:
        """Return places (k,) on the curve, none before the last: near these rotations and origins of the link, one
        after the other, from a first place to a last one."""
        if len(self.steps) == 1:
            found = np.maximum.accumulate(np.append(first, self._shares(rotations, origins)[1:]))
            found[-1] = last
            return np.asarray(np.minimum(found, last))
        far, angle = self.tolerances
        turned = _lengths(turn_vectors(rotations[:-1], rotations[1:], self.axis))
        moved = np.hypot(_lengths(np.diff(origins, axis=0)) / far, turned / angle)
        if loops := library():
            how = LOOK_AHEAD, CATCH_UP, SOONER
            found = places_loop.places(loops, self._record, how, rotations, origins, moved, first)
        else:
            found = self._places(rotations, origins, moved, first)
        found[-1] = last
        return np.asarray(np.minimum(found, last))

    @cached_property
    def _record(self) -> Record:
        """For the loop in C."""
        return places_loop.pose_curve(self, PARALLEL)

    def _places(self, rotations: Array, origins: Array, moved: Array, first: float) -> Array:
        """Return the places (k,) at which a link is that moves on by this much (k − 1,), in tolerances."""
        far, angle = self.tolerances
        ahead, way = self.ahead, np.diff(self.ahead)
        found, final, gone = np.full(len(origins), first), len(self.steps) - 1, float(self.way_to(np.array([first]))[0])
        for k in range(1, len(origins)):
            begin = min(int(found[k - 1]), final)
            end = int(np.searchsorted(ahead, gone + LOOK_AHEAD * moved[k - 1] + CATCH_UP))
            near = np.arange(begin, min(max(end, begin + 1), final + 1))
            off, turn = origins[k] - self.origins[near], self._turn_from(near, rotations[k])
            inner = (off * self.steps[near]).sum(axis=1) / far**2 + (turn * self.turns[near]).sum(axis=1) / angle**2
            share = np.clip(inner / np.maximum(way[near] ** 2, 1e-300), 0.0, 1.0)
            share[0] = max(share[0], found[k - 1] - begin)
            off, turn = off - share[:, None] * self.steps[near], turn - share[:, None] * self.turns[near]
            away = np.hypot(_lengths(off) / far, _lengths(turn) / angle)
            best = int((away <= away.min() + SOONER).argmax())
            while best + 1 < len(away) and share[best] >= 1.0 and away[best + 1] < away[best]:
                best += 1
            found[k] = max(found[k - 1], near[best] + share[best])
            gone = ahead[near[best]] + share[best] * way[near[best]]
        return found

    def _shares(self, rotations: Array, origins: Array) -> Array:
        """Return the shares (k,) of the first step that are nearest to rotations and origins of the link."""
        far, angle = self.tolerances
        off, turn = origins - self.origins[0], self._turn_from(np.zeros(len(origins), np.int64), rotations)
        inner = (off * self.steps[0]).sum(axis=1) / far**2 + (turn * self.turns[0]).sum(axis=1) / angle**2
        return np.asarray(np.clip(inner / max(self.ahead[1] ** 2, 1e-300), 0.0, 1.0))

    def nearest(self, rotations: Array, origins: Array) -> tuple[Array, Mask]:
        """Return the places (k,) of the curve that are nearest to origins of the link (k, 3), and whether it is within
        the tolerances there."""
        squares = np.maximum((self.steps**2).sum(axis=1), 1e-300)
        places = np.zeros(len(origins))
        for k, origin in enumerate(origins):
            off = origin - self.origins[:-1]
            share = np.clip((off * self.steps).sum(axis=1) / squares, 0.0, 1.0)
            segment = int(((off - share[:, None] * self.steps) ** 2).sum(axis=1).argmin())
            places[k] = segment + share[segment]
        segment_of = np.minimum(places.astype(np.int64), len(self.steps) - 1)
        turned, there = self.at(segment_of, places - segment_of)
        angles = _lengths(turn_vectors(turned, rotations, self.axis))
        far, angle = self.tolerances
        return places, (_lengths(origins - there) <= far) & (angles <= angle)

    def beyond(self) -> tuple[float, float]:
        """Return the places of the curve between which a link that follows it may be beyond the radii in which it comes
        and leaves: first and last so far from its ends, less the tolerance."""
        far, whole = self.tolerances[0], float(len(self.steps))
        first = 0.0 if self.comes is None else _leaves(self.origins, self.comes - far)
        last = whole if self.goes is None else whole - _leaves(self.origins[::-1], self.goes - far)
        return first, last

    def on_it(self, rotations: Array, origins: Array) -> tuple[int, int, float, float]:
        """Return the first and the last of some nodes at which the link, which comes from elsewhere and leaves, is to
        be on the curve, and its places there: those of the longest way on it. What it leaves out of the curve is within
        the radii around its ends; or else it is to be on all of it."""
        whole = 0, len(origins) - 1, 0.0, float(len(self.steps))
        if self.comes is None and self.goes is None:
            return whole
        places, on = self.nearest(rotations, origins)
        on = on.copy()
        if self.comes is None:
            on[0], places[0] = True, 0.0
        if self.goes is None:
            on[-1], places[-1] = True, whole[3]
        edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]])))
        if not len(edges):
            return whole
        begins, ends = edges[::2], edges[1::2] - 1
        longest = int((ends - begins).argmax())
        first = 0 if self.comes is None else int(begins[longest])
        last = whole[1] if self.goes is None else int(ends[longest])
        left, right = np.arange(len(self.origins)) < places[first], np.arange(len(self.origins)) > places[last]
        out = _lengths(self.origins - self.origins[0])[left], _lengths(self.origins - self.origins[-1])[right]
        if out[0].max(initial=0.0) > (self.comes or 0.0) or out[1].max(initial=0.0) > (self.goes or 0.0):
            return whole
        if last <= first or places[last] < places[first]:
            return whole
        return first, last, float(places[first]), float(places[last])

    def _turn_from(self, segment: Index, rotation: Array) -> Array:
        """Return about which rotation vectors (k, 3) take the curve from where segments begin to a rotation, one
        (3, 3) or one for each (k, 3, 3)."""
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
    def spans(self) -> tuple[Index, Array, Array]:
        """Parts of the motion on which the place stays between two poses: interval, start and width (k,)."""
        first, last = self.ways[[0, -1]]
        passed = self.curve.ahead[(self.curve.ahead > first) & (self.curve.ahead < last)]
        return spans_between(np.union1d(self.nodes, np.interp(passed, self.ways, self.nodes)))

    @property
    def rated(self) -> tuple[Index, Array, Array]:
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

    def on(self, interval: Index, start: Array, width: Array) -> tuple[Index, Array, Array]:
        """Return on parts of the motion the segment of the curve, the fraction of it in the middle, and half of how
        much of it is passed (k,)."""
        ahead = self.curve.ahead
        begins, ends = (np.interp(interval + at, self.nodes, self.ways) for at in (start, start + width))
        segment = np.searchsorted(ahead, 0.5 * (begins + ends), side="right") - 1
        segment = np.clip(segment, 0, len(self.curve.steps) - 1)
        wide = np.maximum(np.diff(ahead)[segment], 1e-300)
        first, last = (np.clip((way - ahead[segment]) / wide, 0.0, 1.0) for way in (begins, ends))
        return segment, 0.5 * (first + last), 0.5 * (last - first)


def spans_between(cuts: Array) -> tuple[Index, Array, Array]:
    """Return parts of a motion between places on it, in intervals between rows: interval, start and width (k,)."""
    interval = np.floor(0.5 * (cuts[:-1] + cuts[1:])).astype(np.int64)
    return interval, cuts[:-1] - interval, np.diff(cuts)


class _Along(WithTolerance):
    """The proven properties along the curve."""

    motion: Followed

    @property
    def link(self) -> str:
        """Whose it is."""
        return self.motion.curve.link

    @property
    def spans(self) -> tuple[Index, Array, Array]:
        """First parts of the motion."""
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
    def spans(self) -> tuple[Index, Array, Array]:
        """First parts of the motion."""
        return spans_between(self.motion.after if self.at_end else self.motion.before)

    @property
    def end(self) -> str:
        """The end of the curve, in a word."""
        return "end" if self.at_end else "beginning"

    def on(self, interval: Index, start: Array, width: Array) -> Valued:
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

    def on(self, interval: Index, start: Array, width: Array) -> Valued:
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


def _leaves(points: Array, radius: float) -> float:
    """Return where a line through points (N, 3) first is so far from the first of them, in points; its end where it is
    nowhere so far."""
    off = points - points[0]
    far = _lengths(off) > max(radius, 0.0)
    if not far.any():
        return float(len(points) - 1)
    k = int(far.argmax())
    one, way = off[k - 1], off[k] - off[k - 1]
    a, b, c = way @ way, one @ way, one @ one - max(radius, 0.0) ** 2  # a x² + 2 b x + c = 0
    return float(k - 1 + np.clip((-b + np.sqrt(max(b * b - a * c, 0.0))) / a, 0.0, 1.0))


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def turn_vectors(one: Array, other: Array, axis: int | None) -> Array:
    """Return the rotation vectors (k, 3) of the shortest turns from rotations (k, 3, 3) to others, or from one of their
    axes to that of the others."""
    if axis is None:
        return vectors_of(other @ one.transpose(0, 2, 1))
    begins, ends = one[:, :, axis], other[:, :, axis]
    about = cross(begins, ends)
    sine, cosine = _lengths(about), (begins * ends).sum(axis=1)
    return np.asarray(about * (np.arctan2(sine, cosine) / np.maximum(sine, PARALLEL))[:, None])
