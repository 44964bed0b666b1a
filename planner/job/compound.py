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
from hdplan.planner.job.following import CORNER, NotFollowedError, brought, lengths_of
from hdplan.planner.job.places import pose_of
from hdplan.planner.kinematics.inverse import Aim
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.link_frame import frames_of, link_poses
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.targets import PoseTarget

LOOKS = 1500  # of a planned motion
APART = 2e-3  # share of a path between the configurations that it is drawn through
FINE = 200  # configurations in a part of the path
ROWS = 24  # in the shortest blend
FEWEST, MOST = 48, 3000  # rows of a whole path
STANDS = 1e-12  # [rad] or [m]

Way = Callable[[Array], Array]


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
        rows = curve.at_parameter(np.linspace(0.0, 1.0, LOOKS))
        steps = lengths_of(link_poses(self.robot, rows, frames_of(self.robot)[self.link]), self.leg.free)[0]
        along = np.concatenate([[0.0], np.cumsum(steps)])
        along /= max(along[-1], STANDS)
        chosen = [0]
        for k, share in enumerate(along.tolist()):
            if share - along[chosen[-1]] >= APART and 1.0 - share >= APART:
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
    corners = (inner - first) / max(last - first, STANDS)
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

    def __post_init__(self) -> None:
        """Measure it."""
        at = [np.union1d(np.linspace(0.0, 1.0, FINE + 1), part.corners) for part in self.parts]
        length, gone = [], 0.0
        for part, shares in zip(self.parts, at, strict=True):
            steps = np.linalg.norm(np.diff(part.way(shares), axis=0), axis=1)
            length.append(gone + np.concatenate([[0.0], np.cumsum(steps)]))
            gone = float(length[-1][-1])
        object.__setattr__(self, "at", at)
        object.__setattr__(self, "length", length)

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
        moving = np.flatnonzero(np.linalg.norm(steps, axis=1) > STANDS)
        ways = steps[moving] / np.linalg.norm(steps[moving], axis=1)[:, None]
        sharp = (ways[1:] * ways[:-1]).sum(axis=1) < np.cos(CORNER)
        return [0.0, *length[moving[1:][sharp]].tolist(), float(length[-1])]

    @cached_property
    def _aim(self) -> Aim:
        return Aim.at(self.robot, self._target(self.parts[0], np.zeros(1)))

    def _target(self, part: Part, share: Array) -> PoseTarget:
        """Return the pose of the link at a share (1,) of a part."""
        return PoseTarget(self.link, pose_of(part.poses(share)[0]), free_rotation=self.free)

    def rows(self, first: float, last: float, count: int) -> Array:
        """Return configurations (count, n) evenly between two lengths of it. Raises NotFollowedError."""
        return np.array([self.row(length) for length in np.linspace(first, last, count).tolist()])

    def row(self, length: float) -> Array:
        """Return the configuration (n,) at a length. Raises NotFollowedError."""
        number = next((k for k, each in enumerate(self.length) if length <= each[-1]), len(self.parts) - 1)
        part = self.parts[number]
        share = np.array([np.interp(length, self.length[number], self.at[number])])
        (q,) = part.way(share)
        aim = self._aim.elsewhere(self._target(part, share))
        reached = brought(self.robot, aim, np.clip(q, self.robot.lower, self.robot.upper))
        if isinstance(reached, str):
            raise NotFollowedError(f"{self.link} cannot follow its blended curve: {reached}")
        return reached
