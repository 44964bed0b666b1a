"""Curves that are blended, as one path from rest to rest.

Each stage was planned by itself, from rest to rest, so that there is a joint path q_k(λ) along the whole of its curve.
In a blend the arm goes over from q₁ to q₂ as `blends` says it of poses. All joint values are brought to the poses of
the curve and its blends then, so that these paths only say how a redundant arm stands.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hdplan.planner.job.blends import Blend, Leg, UnblendedError, quintic
from hdplan.planner.job.following import CORNER_ANGLE, NotFollowedError, Places, lengths_of
from hdplan.planner.job.places import pose_of
from hdplan.planner.kinematics.inverse import LinkPose
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.link_frame import frames_of, link_poses
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.targets import PoseTarget

PLANNED_SAMPLES = 1500  # of a planned motion
PATH_GAP = 2e-3  # share of a path between two of its configurations
PART_CONFIGURATIONS = 200  # configurations in a part of the path
ROWS = 24  # in the shortest blend
LEAST_ROWS, MOST_ROWS = 48, 3000  # rows of a whole path
LEAST_MOTION = 1e-12  # [rad] or [m]

Way = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Arc(Leg):
    """An arc of chords, driven as the curve through their ends: a kink between two chords would be jerk."""

    @cached_property
    def _through(self) -> Way:
        found: Way = scipy.interpolate.CubicSpline(self.places, self.poses[:, :3, 3])
        return found

    def at(self, share: Array) -> Array:
        """Return poses (k, 4, 4) at shares (k,) of the curve."""
        found = super().at(share)
        found[:, :3, 3] = self._through(np.clip(share, 0.0, 1.0))
        return found


@dataclass(frozen=True, eq=False)
class Driven:
    """The path of one stage, from rest to rest."""

    robot: Robot
    motion: Trajectory
    leg: Leg  # its curve
    link: str  # that follows it
    way: Way = field(init=False)  # joint values (k, n) at shares (k,) of it
    ends: tuple[Array, Array] = field(init=False)  # (n,) where it begins and ends

    def __post_init__(self) -> None:
        """Draw the path through some configurations of the motion."""
        curve = curve_of(self.robot, self.motion)
        object.__setattr__(self, "ends", (curve.rows[0], curve.rows[-1]))
        rows = curve.at_parameter(np.linspace(0.0, 1.0, PLANNED_SAMPLES))
        steps = lengths_of(link_poses(self.robot, rows, frames_of(self.robot)[self.link]), self.leg.free)[0]
        along = np.concatenate([[0.0], np.cumsum(steps)])
        along /= max(along[-1], LEAST_MOTION)
        chosen = [0]
        for k, share in enumerate(along.tolist()):
            if share - along[chosen[-1]] >= PATH_GAP and 1.0 - share >= PATH_GAP:
                chosen.append(k)
        chosen.append(len(along) - 1)
        object.__setattr__(self, "way", scipy.interpolate.CubicSpline(along[chosen], rows[chosen]))


@dataclass(frozen=True, eq=False)
class Part:
    """A part of a path: joint values (k, n) near it at shares (k,) of it, and the poses of the link there."""

    way: Way
    poses: Way
    corners: Array = field(default_factory=lambda: np.zeros(0))  # shares at which it may change its direction


def parts_of(driven: Sequence[Driven], radii: Sequence[float]) -> list[Part]:
    """Return the parts of a path: stages and, between two of them, a blend within a radius. Raises UnblendedError."""
    blends = []
    for k, (pair, radius) in enumerate(zip(itertools.pairwise(driven), radii, strict=True)):
        with _numbered(k):
            blends.append(Blend.of(pair[0].leg, pair[1].leg, radius))
    found: list[Part] = []
    for k, each in enumerate(driven):
        first = blends[k - 1].leaves if k else 0.0
        last = blends[k].enters if k < len(blends) else 1.0
        with _numbered(k):
            if first > last:
                raise UnblendedError("its radius and that of the stage before it overlap on this stage")
        found.append(_stage(each, first, last))
        if k < len(blends):
            found.append(_between(each, driven[k + 1], blends[k]))
    return found


@contextmanager
def _numbered(number: int) -> Iterator[None]:
    try:
        yield
    except UnblendedError as error:
        error.number = number
        raise


def _stage(each: Driven, first: float, last: float) -> Part:
    def shares(at: Array) -> Array:
        return np.asarray(first + at * (last - first))

    leg = each.leg
    inner = leg.places[(leg.places > first) & (leg.places < last)]
    corners = (inner - first) / max(last - first, LEAST_MOTION)
    return Part(lambda at: each.way(shares(at)), lambda at: leg.at(shares(at)), corners)


def _between(one: Driven, other: Driven, blend: Blend) -> Part:
    def way(s: Array) -> Array:
        first, second = blend.shares(s)
        begins = one.way(first)
        return np.asarray(begins + quintic(s)[:, None] * (other.way(second) - begins))

    return Part(way, blend.at)


@dataclass(frozen=True, eq=False)
class Path:
    """A path of parts one after the other, over a length in joint values."""

    robot: Robot
    link: str
    free: str
    parts: Sequence[Part]
    at: list[Array] = field(init=False)  # shares of each part
    length: list[Array] = field(init=False)  # of the path up to there

    _shares: list[Way] = field(init=False)  # of each part, by the length

    def __post_init__(self) -> None:
        """Measure it."""
        at = [np.union1d(np.linspace(0.0, 1.0, PART_CONFIGURATIONS + 1), part.corners) for part in self.parts]
        length, gone = [], 0.0
        for part, shares in zip(self.parts, at, strict=True):
            steps = np.linalg.norm(np.diff(part.way(shares), axis=0), axis=1)
            length.append(gone + np.concatenate([[0.0], np.cumsum(steps)]))
            gone = float(length[-1][-1])
        object.__setattr__(self, "at", at)
        object.__setattr__(self, "length", length)
        object.__setattr__(self, "_shares", [_by_length(*pair) for pair in zip(at, length, strict=True)])

    @property
    def middles(self) -> list[float]:
        """The lengths up to the middles of its blends, which are every other part."""
        return [float(np.interp(0.5, self.at[k], self.length[k])) for k in range(1, len(self.parts), 2)]

    @property
    def shortest(self) -> float:
        """The length of its shortest blend."""
        return min(float(np.ptp(self.length[k])) for k in range(1, len(self.parts), 2))

    @property
    def cuts(self) -> list[float]:
        """The lengths at which it begins, changes its direction abruptly, and ends."""
        rows = np.concatenate(
            [part.way(at)[min(k, 1) :] for k, (part, at) in enumerate(zip(self.parts, self.at, strict=True))]
        )
        length = np.concatenate([each[min(k, 1) :] for k, each in enumerate(self.length)])
        steps = np.diff(rows, axis=0)
        moving = np.flatnonzero(np.linalg.norm(steps, axis=1) > LEAST_MOTION)
        ways = steps[moving] / np.linalg.norm(steps[moving], axis=1)[:, None]
        sharp = (ways[1:] * ways[:-1]).sum(axis=1) < np.cos(CORNER_ANGLE)
        return [0.0, *length[moving[1:][sharp]].tolist(), float(length[-1])]

    def rows(self, lengths: Array) -> Array:
        """Return configurations (N, n) at lengths (N,) of it, in order. All take the same steps to their poses: what
        neighbours of different steps are off would be jerk between them. Raises NotFollowedError."""
        ends = np.array([each[-1] for each in self.length[:-1]])
        number = np.searchsorted(ends, lengths)
        near, poses = [], []
        for k in np.unique(number).tolist():
            shares = np.clip(self._shares[k](lengths[number == k]), 0.0, 1.0)
            near.append(self.parts[k].way(shares))
            poses.append(self.parts[k].poses(shares))
        places, robot = np.concatenate(poses), self.robot
        link = LinkPose.of(robot, PoseTarget(self.link, pose_of(places[0]), free_rotation=self.free))
        curve = Places(link, places, np.ones(robot.n), robot.lower, robot.upper)
        rows = curve.back(np.concatenate(near))
        if not (reached := curve.reached(rows)).all():
            share = float(lengths[int((~reached).argmax())]) / self.cuts[-1]
            raise NotFollowedError(f"{self.link} cannot follow its blended curve beyond {share:.0%} of it")
        return rows


def _by_length(at: Array, length: Array) -> Way:
    """Return the shares of a part by the length of the path: a spline, as kinks between few lengths would be jerk."""
    even = np.searchsorted(at, np.linspace(0.0, 1.0, PART_CONFIGURATIONS + 1))
    if not (np.diff(length[even]) > LEAST_MOTION).all():
        return lambda wanted: np.asarray(np.interp(wanted, length, at))
    found: Way = scipy.interpolate.CubicSpline(length[even], at[even])
    return found
