"""The input of every solver besides the problem, its result, and the schedule of penalty weights that all share.

The penalty weight w starts low, so that the motion moves as a whole, and is raised whenever progress stalls with bodies
still too close: a quadratic penalty method with continuation (Nocedal & Wright, Numerical Optimization, section 17.1).
"""

from __future__ import annotations

import contextlib
import enum
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.problem import Evaluation, Problem
from hdplan.scenes.array_types import Array


class SolverStatus(enum.Enum):
    """Why a solver stopped; each value names the cause and the remedy."""

    CLEAR = "every sample keeps its distance: the motion is ready for the certificate"
    STALLED = "the penalty stopped falling with bodies still too close: a local minimum; try another seed"
    ITERATIONS = "the iteration limit was reached with bodies still too close: more iterations or another seed may help"
    TIME = "the time limit was reached: raise --time-limit"
    INTERRUPTED = "interrupted: this is the best motion so far"


FIRST_WEIGHT, LAST_WEIGHT, RAISE = 6e3, 3e8, 6.0  # of the penalty [1/m²]
DETOUR_WEIGHT = FIRST_WEIGHT * RAISE**3  # keeps a guess that leads around obstacles there [1/m²]
SLOW_DECREASE = 0.01  # relative decrease of the cost by a step that counts as stalled, unless a budget says otherwise
REFUSED_SHARE = 1 / 3  # a refused step counts as this share of a stalled one, as the next is another try at the same
MOST_REFUSED_STEPS = 9  # refused steps in a row, the patience of three weights
UNMOVED_SHARE = 0.9  # share of the depth before: a raise that leaves more frees a motion little
CLEAR_SHARE = 0.5  # share of the activation band that may be used up when the motion counts as clear
EQUAL_COST = 1e-9  # relative difference of two costs that are equal up to rounding: large sums cancel in them
END_SHARE = 0.2  # share of the duration over which an end that is itself too close excuses the motion next to it


@dataclass(frozen=True)
class Iteration:
    """One iteration, for progress displays and plots."""

    iteration: int
    cost: float
    smoothness: float
    depth: float  # [m] how far the worst sample may be inside its margin
    weight: float  # of the penalty


def _silent(step: Iteration, positions: Array) -> None:
    pass


def _never() -> bool:
    return False


@dataclass(frozen=True)
class Budget:
    """The budget of a solver."""

    deadline: float = float("inf")  # value of time.perf_counter() at which the solver stops
    iterations: int = 1000
    first_weight: float = FIRST_WEIGHT  # weight of the penalty at the beginning [1/m²]
    slow: float = SLOW_DECREASE  # relative decrease of the cost below which a step counts as stalled
    stuck: float = float("inf")  # [m] a motion so deep inside something that weights free little is given up
    report: Callable[[Iteration, Array], None] = _silent
    """Called once per iteration, with the waypoints (N, n) at its end."""
    stop: Callable[[], bool] = _never
    """Called once per iteration whether to stop with the best motion so far."""

    def spent(self) -> bool:
        """True if the deadline has passed."""
        return time.perf_counter() > self.deadline


@dataclass(frozen=True, eq=False)
class Solution:
    """A motion and how it was found; only a certificate proves that it is free of collisions."""

    trajectory: Trajectory
    status: SolverStatus
    weight: float  # the penalty weight of the last iteration
    steps: tuple[Iteration, ...]
    seconds: float

    def __repr__(self) -> str:
        """Name the outcome."""
        return f"<Solution: {self.status.name.lower()} after {self.iterations} iterations, {self.trajectory.extent}>"

    @property
    def iterations(self) -> int:
        """The number of steps taken."""
        return len(self.steps)


class Progress:
    """Records the steps, and decides when to raise the penalty weight and when to stop."""

    def __init__(self, problem: Problem, budget: Budget, patience: int) -> None:
        """Start at the budget's first weight, which is raised after `patience` stalled steps in a row."""
        self.patience = patience
        self.problem = problem
        self.began = time.perf_counter()
        self.weight = budget.first_weight
        self.allowed = _allowed_depth(problem)
        self.budget = budget
        self.status: SolverStatus | None = None
        self.steps: list[Iteration] = []
        self.stalled = 0.0
        self.refused = 0  # steps in a row
        self.depths: list[float] = []  # at the end of the steps with each weight that counts

    def goes_on(self) -> bool:
        """True if another step may be taken."""
        if self.status is None and self.budget.stop():
            self.status = SolverStatus.INTERRUPTED
        if self.status is None and self.budget.spent():
            self.status = SolverStatus.TIME
        if self.status is None and len(self.steps) >= self.budget.iterations:
            self.status = SolverStatus.ITERATIONS
        return self.status is None

    def step(self, before: float, state: Evaluation, positions: Array) -> bool:
        """Record a step from cost `before` to `state` at `positions` (N, n), at the same weight; True if the weight was
        raised after it."""
        depth = float(state.depth.max(initial=0.0))
        self.steps.append(Iteration(len(self.steps) + 1, state.cost, state.smoothness, depth, self.weight))
        self.budget.report(self.steps[-1], positions)
        gain = before - state.cost
        self.stalled = (
            0.0 if gain > self.budget.slow * before else self.stalled + (1.0 if gain > 0.0 else REFUSED_SHARE)
        )
        self.refused = 0 if gain > 0.0 else self.refused + 1
        if self.stalled < self.patience:
            return False
        if self.is_clear(state):
            self.status = SolverStatus.CLEAR
        elif self.weight >= LAST_WEIGHT or self.refused >= MOST_REFUSED_STEPS or self._is_stuck(depth):
            self.status = SolverStatus.STALLED
        else:
            self.weight, self.stalled = self.weight * RAISE, 0.0
            return True
        return False

    def _is_stuck(self, depth: float) -> bool:
        """True if a motion is too far inside something, by its depth [m], and the last raise of two freed it little."""
        if self.weight >= FIRST_WEIGHT:  # lower ones free nothing yet
            self.depths.append(depth)
        return len(self.depths) > 2 and depth > self.budget.stuck and depth > UNMOVED_SHARE * self.depths[-2]

    def go_on(self, before: float, state: Evaluation, positions: Array) -> None:
        """Record one more step of a clear motion, and continue if it gained much."""
        self.status = None
        self.step(before, state, positions)
        if self.stalled:
            self.status = SolverStatus.CLEAR

    def is_clear(self, state: Evaluation) -> bool:
        """True if every sample keeps its distance."""
        return bool(np.all(state.depth <= self.allowed))

    @contextlib.contextmanager
    def until_interrupted(self) -> Iterator[None]:
        """Turn Ctrl-C into a status: what has been found is kept."""
        try:
            yield
        except KeyboardInterrupt:
            self.status = SolverStatus.INTERRUPTED

    def solution(self, positions: Array) -> Solution:
        """Wrap up."""
        trajectory = Trajectory(self.problem.robot.joint_names, positions, self.problem.robot.locked)
        seconds = time.perf_counter() - self.began
        return Solution(trajectory, self.status or SolverStatus.ITERATIONS, self.weight, tuple(self.steps), seconds)


def _allowed_depth(problem: Problem) -> Array:
    """Depth inside its margin that each sample (B,) may have in a clear motion [m]: more near an end that is itself
    deep, since no motion can do better there."""
    parameter = problem.samples.parameter
    start, goal = _end_depths(problem)
    excused = np.maximum(start * (1 - parameter / END_SHARE), goal * (1 - (1 - parameter) / END_SHARE))
    allowed: Array = np.maximum(CLEAR_SHARE * problem.scene.planner.activation, excused)
    return allowed


def _end_depths(problem: Problem) -> Array:
    return problem.depth(np.array([problem.start, problem.goal]), np.array([0.0, 1.0]))


def is_narrow(problem: Problem) -> bool:
    """True if an end is so deep inside a margin that a clear motion is excused there."""
    return bool(np.any(_end_depths(problem) > CLEAR_SHARE * problem.scene.planner.activation))


def ends_overlap(problem: Problem) -> bool:
    """True if the bodies themselves overlap at an end, which is free if its links are: there they are too loose."""
    settings = problem.scene.planner
    return bool(np.any(_end_depths(problem) > settings.clearance + settings.activation))


def is_clear(problem: Problem, positions: Array) -> bool:
    """True if every sample of a motion (N, n) keeps its distance."""
    samples = problem.samples
    depth = problem.depth(samples.configurations(positions), samples.parameter)
    return bool(np.all(depth <= _allowed_depth(problem)))


@dataclass(frozen=True)
class Solver:
    """A solver: every term of every problem is its business."""

    solve: Callable[[Problem, Array, Budget], Solution]  # from a first guess (N, n)
