"""Solvers by name. Each takes a problem and a first guess and gives a `Solution`; none of them claims that a motion
is free."""

from __future__ import annotations

from collections.abc import Callable

from hdplan.planner.problem import Floats, Problem
from hdplan.planner.seeds import seeds
from hdplan.planner.solvers import chomp, gauss_newton, ipopt
from hdplan.planner.solvers.solution import Budget, Solution
from hdplan.scenes.errors import InputError, nearest

Solver = Callable[[Problem, Floats, Budget], Solution]

SOLVERS: dict[str, Solver] = {
    "gauss_newton": gauss_newton.solve,  # banded second-order steps: the default
    "chomp": chomp.solve,  # covariant gradient descent, as in the original
    "ipopt": ipopt.solve,  # the CasADi problem with exact Hessians, by an interior-point method
}


def solver_named(name: str) -> Solver:
    """Return a solver. Raises InputError for an unknown name."""
    if name not in SOLVERS:
        raise InputError(f"solver: unknown '{name}'{nearest(name, SOLVERS)}")
    return SOLVERS[name]


def solve(
    problem: Problem, *, solver: str = "gauss_newton", guess: Floats | None = None, budget: Budget | None = None
) -> Solution:
    """Solve a problem once, from a first guess (N, n) or the straight line; certify the result before you trust it.

    Raises InputError for an unknown solver.
    """
    return solver_named(solver)(problem, next(seeds(problem, 0)) if guess is None else guess, budget or Budget())
