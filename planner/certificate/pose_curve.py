"""The curve of poses that a link is to follow, and the places on it that are nearest to poses of the link.

Between two poses the origin moves straight, and the link turns about a fixed axis by the shortest turn; of a link that
is free about one of its axes only that axis counts. A place is a segment's number plus a fraction of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.distance.compiled.loops import C, Record, twin_of
from hdplan.planner.geometry.rotations import matrices_of, vectors_of
from hdplan.planner.motion.motion_bounds import cross
from hdplan.planner.robot.link_frame import AXES, link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.path_constraints import Follow

LOOK_AHEAD = 2.0  # of the link's own way since the last node, in tolerances: how far the next place is sought
CATCH_UP = 1.0  # tolerances that it may be farther, to catch up
# tolerances that a place may be farther away than the nearest: where a curve turns back, its end comes later
SOONER = 0.25
PARALLEL = 1e-12  # sine below which two directions have no axis of their own


def _places(curve: PoseCurve, rotations: Array, origins: Array, moved: Array, first: float) -> Array:
    found = np.full(len(origins), first)
    given = map(np.ascontiguousarray, (rotations, origins, moved))
    C.places(curve.record.struct, LOOK_AHEAD, CATCH_UP, SOONER, *given, found)
    return found


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

    def at(self, segment: Rows, fraction: Array) -> tuple[Array, Array]:
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
        """Return the length of the curve up to places (k,), in tolerances."""
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
        found = self._places(rotations, origins, moved, first)
        found[-1] = last
        return np.asarray(np.minimum(found, last))

    @cached_property
    def record(self) -> Record:
        """The C struct `pose_curve`."""
        begins, axis = (self.origins[:-1], self.rotations[:-1]), 3 if self.axis is None else self.axis
        return Record("pose_curve", self.steps, self.turns, *begins, self.ahead, axis, *self.tolerances, PARALLEL)

    @twin_of(_places)
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

    def _turn_from(self, segment: Rows, rotation: Array) -> Array:
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
