"""The current motion: rows on the grid of the clock, up to standstill, and those executed shortly before."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.replanning.nominal import Rows
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array

KEPT_PAST = 1.0  # [s] of the past that is kept, for states that are measured late


@dataclass(frozen=True)
class Grid:
    """Rows of the clock: row k is at `origin` + k h."""

    origin: float  # [s] on the user's clock
    h: float  # [s]

    def time(self, row: int) -> float:
        """Return when a row is [s]."""
        return self.origin + row * self.h

    def after(self, t: float) -> int:
        """Return the first row that is not before a time [s]."""
        return math.ceil((t - self.origin) / self.h - 1e-6)


@dataclass(frozen=True, eq=False)
class Held:
    """A motion from its first row; it stands before and after."""

    grid: Grid
    first: int
    rows: Rows

    @classmethod
    def standing(cls, grid: Grid, row: int, q: Array) -> Held:
        """Return a robot that stands."""
        none = np.zeros((1, len(q)))
        return cls(grid, row, (q[None].copy(), none, none))

    @property
    def last(self) -> int:
        """The row from which on the robot stands."""
        return self.first + len(self.rows[0]) - 1

    @property
    def stop(self) -> Array:
        """Configuration (n,) at which it then stands."""
        return np.asarray(self.rows[0][-1])

    def row(self, row: int) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (n,) at a row."""
        at = min(max(row - self.first, 0), len(self.rows[0]) - 1)
        return self.rows[0][at], self.rows[1][at], self.rows[2][at]

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return position, velocity and acceleration (n,) at a time [s]."""
        begins, ends = self.grid.time(self.first), self.grid.time(self.last)
        if not begins < t < ends:
            return self.row(self.first if t <= begins else self.last)
        curve = Curve.through(
            self.rows[0], self.grid.h * np.arange(len(self.rows[0]), dtype=np.float64), *self.rows[1:]
        )
        place = curve.place_of(np.array([t - begins]))
        position, velocity, acceleration = (curve.over_time(order).at(*place)[0] for order in range(3))
        return position, velocity, acceleration

    def joined(self, row: int, rows: Rows) -> Held:
        """Return this motion up to a row, and from there on another one, which begins as this one is there."""
        first = max(min(self.first, row), row - math.ceil(KEPT_PAST / self.grid.h))
        before = [min(max(k - self.first, 0), len(self.rows[0]) - 1) for k in range(first, row)]
        past, velocity, acceleration = (
            np.concatenate([own[before], other]) for own, other in zip(self.rows, rows, strict=True)
        )
        return Held(self.grid, first, (past, velocity, acceleration))

    def ahead(self, robot: Robot, t: float) -> Trajectory:
        """Return the motion from the last row that is not after t on, with times from t on, to its standstill."""
        begin = min(math.floor((t - self.grid.origin) / self.grid.h + 1e-6), self.last)
        count = max(self.last - begin, 1) + 1
        found = [self.row(begin + k) for k in range(count)]
        position, velocity, acceleration = (np.array(each) for each in zip(*found, strict=True))
        times = self.grid.time(begin) - t + self.grid.h * np.arange(count, dtype=np.float64)
        return Trajectory(robot.joint_names, position, robot.locked, times, velocity, acceleration)
