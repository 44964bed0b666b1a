"""Solvers by name. Each takes a problem and a first guess and returns a `Solution`; none claims that its motion is free
of collisions."""

from __future__ import annotations

import importlib
import pkgutil

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.warm_start import waypoints_of
from hdplan.planner.solvers import methods
from hdplan.planner.solvers.solution import Budget, Solution, Solver
from hdplan.scenes.array_types import Array
from hdplan.scenes.arrays import as_numbers
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.values import instance

LARGEST_VALUE = 1e9  # [rad] or [m] in a guess: above it, the cost of a joint without limits is lost in rounding

DEFAULT = "gauss_newton"
SOLVERS: dict[str, Solver] = {
    name: importlib.import_module(f"{methods.__name__}.{name}").SOLVER
    for name in sorted((each.name for each in pkgutil.iter_modules(methods.__path__)), key=lambda name: name != DEFAULT)
}
"""Every module of `methods`, the default first."""


def solver_named(name: str) -> Solver:
    """Return a solver. Raises InputError for an unknown name."""
    if not isinstance(name, str):
        raise InputError(f"solver: must be one of {', '.join(SOLVERS)}, found {name!r}")
    if name not in SOLVERS:
        raise InputError(f"solver: unknown '{name}'{nearest(name, SOLVERS)}")
    return SOLVERS[name]


def solve(
    problem: Problem,
    *,
    solver: str = "gauss_newton",
    guess: Trajectory | ArrayLike | None = None,
    budget: Budget | None = None,
) -> Solution:
    """Solve a problem once, from a first guess (N, n) or the straight line; certify the result before you trust it.

    Args:
        problem: a problem of `build`.
        solver: "gauss_newton", "chomp", "fatrop" or "ipopt".
        guess: the waypoints to begin with (N, n) [rad or m], in the order of the robot's joints; or a motion of the
            robot, whose ends are moved to the problem's.
        budget: limits of time and steps, and the callback for reports.

    Raises InputError for an unknown solver, and for a guess of another shape or with values beyond LARGEST_VALUE; for a
    motion as `plan` does.
    """
    run = solver_named(solver)
    instance(problem, Problem, "problem")
    budget = Budget() if budget is None else budget
    instance(budget, Budget, "budget")
    return run.solve(problem, problem.polyline() if guess is None else _checked(problem, guess), budget)


def _checked(problem: Problem, guess: Trajectory | ArrayLike) -> Array:
    """Return a valid guess for a solver."""
    if isinstance(guess, Trajectory):
        return waypoints_of(problem, guess)
    robot, shape = problem.robot, (problem.waypoints, problem.robot.n)
    positions = as_numbers(guess)
    if positions is None:
        raise InputError(f"guess: numbers of shape {shape} are expected")
    if positions.shape != shape:
        raise InputError(f"guess: shape {positions.shape}, expected {shape}: waypoints by joints of {robot.name}")
    beyond = ~(np.abs(positions) <= LARGEST_VALUE)  # NaN too
    if beyond.any():
        row, joint = np.argwhere(beyond)[0].tolist()
        raise InputError(
            f"guess: waypoint {row}, joint '{robot.joint_names[joint]}': {positions[row, joint]:g}, allowed are finite "
            f"values up to {LARGEST_VALUE:g}"
        )
    return positions.copy()
