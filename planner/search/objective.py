"""The objectives: one number for each, by which certified motions are compared.

`Scene.objective` chooses among

* *time*: the motion's duration T [s];
* *smoothness*: the smoothness cost of its waypoints, over a duration of one, in the units of the joints squared;
* *energy*: the mechanical work E = ∫ Σ_j |τ_j q̇_j| dt [J] of the joints along the executed curve, with all loads, by
  Pinocchio's inverse dynamics: what is braked counts too, as drives rarely give it back.

Each also knows a bound below which no motion between two configurations is, so that a search may pass a goal over.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pinocchio as pin

from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.problem import Problem
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.timing.retiming import Retimer

POWER_STEP = 1e-3  # [s] between samples of power, at most
SLOWEST_IMPROVED = 1.1  # a motion whose fastest law takes longer than another motion by this factor is not improved


class Achieved(NamedTuple):
    """The value that a motion achieves, to be reported."""

    name: str  # of the objective
    value: float
    unit: str


class Objective(ABC):
    """A measure of motions; less is better."""

    name: str
    unit: str

    @abstractmethod
    def value(self, path: Array, motion: Trajectory) -> float:
        """Return the measure of a motion that was timed along waypoints `path` (N, n), or is that path itself."""

    @abstractmethod
    def least(self, problem: Problem) -> float:
        """Return a lower bound of it for all motions from a problem's start to its goal."""

    def least_along(self, path: Array) -> float:
        """Return a lower bound of it for all timings of waypoints (N, n)."""
        return 0.0

    def unimprovable(self, least: float, value: float) -> bool:
        """True if a motion whose `least_along` is known is hardly ever improved to less than `value`."""
        return False

    def longest(self, value: float) -> float:
        """Return a duration [s] such that no motion that takes so long or longer costs less than `value`."""
        return math.inf

    def last(self, path: Array, motion: Trajectory | None) -> float:
        """Return the cost of the motion from which a search begins, as waypoints (N, n) and, if it had times, as it
        was; ∞ if that is not known."""
        return math.inf

    def achieved(self, path: Array, motion: Trajectory) -> Achieved:
        """Return a copy with its name and unit."""
        return Achieved(self.name, self.value(path, motion), self.unit)


def objective_of(problem: Problem, retimer: Retimer | None) -> Objective:
    """Return a scene's objective.

    Raises InputError for energy where the robot's description holds no masses.
    """
    match problem.scene.objective:
        case "time" if retimer is not None:
            return Time(retimer)
        case "energy":
            return Energy(problem.setup)
        case "smoothness":
            return Smoothness(problem)
    raise ValueError(f"no measure is known as {problem.scene.objective!r}, with times: {retimer is not None}")


class Time(Objective):
    """The duration [s]."""

    name, unit = "time", "s"

    def __init__(self, retimer: Retimer) -> None:
        """Take what times the motions."""
        self.retimer = retimer

    def value(self, path: Array, motion: Trajectory) -> float:
        """Return the motion's duration."""
        assert motion.duration is not None
        return motion.duration

    def unimprovable(self, least: float, value: float) -> bool:
        """True if even the fastest law takes SLOWEST_IMPROVED times as long, regardless of its jerk."""
        return least > SLOWEST_IMPROVED * value

    def longest(self, value: float) -> float:
        """Return the duration itself."""
        return value

    def last(self, path: Array, motion: Trajectory | None) -> float:
        """Return its duration."""
        return math.inf if motion is None or motion.duration is None else motion.duration

    def least(self, problem: Problem) -> float:
        """Return the time that the slowest joint alone needs."""
        return self.retimer.shortest(problem.start, problem.goal)

    def least_along(self, path: Array) -> float:
        """Return the time of the fastest law, regardless of its jerk."""
        return self.retimer.quickest_along(path)


class Smoothness(Objective):
    """The smoothness cost of the waypoints (`problem.smoothness`) and the user's own costs, regardless of their
    timing."""

    name = "smoothness"

    def __init__(self, problem: Problem) -> None:
        """Take the cost from a problem: it is the same for all goals."""
        self.cost, self.problem = problem.smoothness, problem
        self.unit = "rad²" if problem.robot.turning.all() else "rad² + m²"

    def value(self, path: Array, motion: Trajectory) -> float:
        """Return the cost of the waypoints."""
        return self.least_along(path)

    def least_along(self, path: Array) -> float:
        """Return the cost of the waypoints."""
        return self.cost.value(path)[0] + self.problem.own_cost(path)

    def last(self, path: Array, motion: Trajectory | None) -> float:
        """Return the cost of the waypoints."""
        return self.least_along(path)

    def least(self, problem: Problem) -> float:
        """Return the cost of the straight line, which is the least; of the user's own costs no bound is known."""
        return -math.inf if problem.terms.costs else self.cost.value(problem.polyline())[0]


class Energy(Objective):
    """The mechanical work of the joints [J]."""

    name, unit = "energy", "J"

    def __init__(self, setup: Setup) -> None:
        """Take the robot with its loads. Raises InputError for one that has no masses."""
        self.robot, self.model = setup.robot, setup.loaded_model
        self.data = self.model.createData()

    def value(self, path: Array, motion: Trajectory) -> float:
        """Return ∫ Σ_j |τ_j q̇_j| dt along the executed curve, by the midpoint rule on steps of at most POWER_STEP."""
        curve = curve_of(self.robot, motion)
        parts = np.maximum(np.ceil(curve.widths / POWER_STEP - 1e-9).astype(np.int64), 1)
        interval = np.repeat(np.arange(len(parts)), parts)
        place = np.arange(len(interval)) - np.repeat(np.cumsum(parts) - parts, parts)
        q, v, a = (curve.over_time(order).at(interval, (place + 0.5) / parts[interval]) for order in range(3))
        rows = zip(self.robot.pin_q(q), v, a, strict=True)
        torques = np.array([pin.rnea(self.model, self.data, *row) for row in rows])
        return float(np.abs(torques * v).sum(axis=1) @ (curve.widths / parts)[interval])

    def least(self, problem: Problem) -> float:
        """Return |U(goal) − U(start)|: from rest to rest, the potential energy U changes by ∫ Σ_j τ_j q̇_j dt."""
        first, last = (
            pin.computePotentialEnergy(self.model, self.data, self.robot.pin_q(q))
            for q in (problem.start, problem.goal)
        )
        return float(abs(last - first))
