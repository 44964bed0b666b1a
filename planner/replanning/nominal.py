"""The nominal motion: the way of the robot, and its progress.

A motion q = P(s) that begins and ends at rest, in its own time s. It is driven by a law s(t): with ṡ = 1 as it was
planned, and with ṡ → 0 the robot brakes along the same way. Another motion may take the place of its rest from a row s*
on, with the same P, P′ and P″ there: whatever ṡ is when the robot comes to s*, its rates do not jump,

    q̇ = P′ ṡ,    q̈ = P″ ṡ² + P′ s̈.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import ReadOnly

STILL_STEP = 1e-9  # [rad] or [m] between two rows, and their rates per second: the robot stands
Rows = tuple[Array, Array, Array]  # positions, velocities, accelerations (k, n)


@dataclass(frozen=True, eq=False)
class Nominal:
    """A motion from where the robot was to the goal, at rest there; its times are s."""

    motion: Trajectory  # in the order of the robot's joints, with rates
    required: float  # [m] clearance with which it was proven, as far as its ends allow
    margin: float  # [s] of the obstacles' motion for which the plan left room

    @property
    def ends(self) -> float:
        """The time s at which it stands at its goal."""
        return float(self._times[-1])

    @property
    def begins(self) -> float:
        """The time s at which it begins."""
        return float(self._times[0])

    @property
    def _times(self) -> Array:
        assert self.motion.times is not None
        return self.motion.times

    @cached_property
    def _curves(self) -> tuple[Curve, Curve, Curve]:
        curve = self.motion.curve
        return curve, curve.over_time(1), curve.over_time(2)

    def driven(self, law: Array) -> Rows:
        """Return the robot's state at rows (k, 3) of a law: s, ṡ, s̈; beyond its end it stands."""
        place = self._curves[0].place_of(np.clip(law[:, 0], self.begins, self.ends))
        position, first, second = (curve.at(*place) for curve in self._curves)
        speed, change = law[:, 1, None], law[:, 2, None]
        there = law[:, 0, None] < self.ends  # else P′ and P″ are 0, to the bit
        return position, np.where(there, first * speed, 0.0), np.where(there, second * speed**2 + first * change, 0.0)

    def rests(self, s: float) -> bool:
        """True if the robot stands at s whatever ṡ is."""
        _, velocity, acceleration = self.driven(np.array([[s, 1.0, 1.0]]))
        return not (velocity.any() or acceleration.any())

    def row_after(self, s: float) -> int:
        """Return the first row that is not before s; the last one if there is none."""
        return min(int(np.searchsorted(self._times, s)), len(self._times) - 1)

    def leads_from(self, s: float) -> bool:
        """True if the robot still moves after s."""
        if s >= self.ends:
            return False
        here = self.driven(np.array([[s, 0.0, 0.0]]))[0]
        return bool(np.abs(self.motion.positions[self.row_after(s) :] - here).max() > STILL_STEP)

    def rest(self, row: int) -> Trajectory | None:
        """Return the rest after a row; None if nothing is."""
        return self.motion.between(row, len(self.motion) - 1) if row < len(self.motion) - 1 else None

    def continued(self, begin: float, row: int, tail: Nominal) -> Nominal:
        """Return this motion from s = begin up to a row, and then another one, which begins as this one passes it."""
        one, other = self.motion, tail.motion
        first = max(int(np.searchsorted(self._times, begin, side="right")) - 1, 0)
        if row <= first:
            first = row
        head, times = slice(first, row), self._times[row] - tail.begins + tail._times
        rows: dict[str, Any] = {
            name: np.concatenate([getattr(one, name)[head], getattr(other, name)])
            for name in ("positions", "velocities", "accelerations")
        }
        rows["times"] = np.concatenate([self._times[head], times])
        motion = Trajectory(one.joint_names, locked=one.locked, **rows)
        return Nominal(motion, min(self.required, tail.required), tail.margin)


@dataclass(frozen=True, eq=False)
class Course(ReadOnly):
    """A nominal motion, and the law by which the motion that is held drives it."""

    nominal: Nominal
    first: int  # row of the clock at which the law begins
    law: Array  # (k, 3) s, ṡ, s̈ at rows of the clock; the last one holds afterwards

    def at(self, row: int) -> Array:
        """Return s, ṡ and s̈ (3,) at a row of the clock."""
        return np.asarray(self.law[min(max(row - self.first, 0), len(self.law) - 1)])

    @property
    def arrives(self) -> bool:
        """True if the law leads to where the nominal motion ends."""
        return not self.nominal.leads_from(float(self.law[-1, 0]))
