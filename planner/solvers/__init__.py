"""Solvers by name. Each takes a problem and a first guess and gives a `Solution`; none of them claims that a motion is free."""

from __future__ import annotations

from collections.abc import Callable

from hdplan.planner.problem import Floats, Problem
from hdplan.planner.solvers import chomp, gauss_newton, ipopt
from hdplan.planner.solvers.solution import Budget, Solution

Solver = Callable[[Problem, Floats, Budget], Solution]

SOLVERS: dict[str, Solver] = {
    "gauss_newton": gauss_newton.solve,  # banded second-order steps: the default
    "chomp": chomp.solve,  # covariant gradient descent, as in the original
    "ipopt": ipopt.solve,  # the CasADi problem with exact Hessians, by an interior-point method
}
