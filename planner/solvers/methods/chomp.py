"""CHOMP as first published: covariant gradient descent, dq = −η M⁻¹ ∇U, with M the smoothness' Hessian.

A step in the metric M spreads a local push smoothly over the whole motion (Ratliff et al., CHOMP, ICRA 2009, eq. 4).
The step length η is halved while the cost does not fall, and doubled when it does; the penalty weight is raised as in
gauss_newton.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.problem.problem import Problem
from hdplan.planner.solvers.solution import Budget, Progress, Solution, Solver
from hdplan.scenes.array_types import Array

SMALLEST_STEP = 1e-9
PATIENCE = 12  # gradient steps gain little each


def solve(problem: Problem, guess: Array, budget: Budget) -> Solution:
    """Improve a guess (N, n) by gradient steps in the metric of the smoothness."""
    positions = problem.clip(guess)
    spread = np.linalg.inv(problem.smoothness.matrix[1:-1, 1:-1])  # M⁻¹
    progress = Progress(problem, budget, PATIENCE)
    state = problem.evaluate(positions, progress.weight)
    length = 1.0
    with progress.until_interrupted():
        while progress.goes_on():
            direction = np.zeros_like(positions)
            direction[1:-1] = -spread @ state.gradient
            trial = problem.clip(positions + length * direction)
            after = problem.evaluate(trial, progress.weight)
            before = state.cost
            if after.cost < before:
                positions, state, length = trial, after, min(2 * length, 1.0)
            else:
                length = max(length / 2, SMALLEST_STEP)
            if progress.step(before, state, positions):
                state, length = problem.evaluate(positions, progress.weight), 1.0
    return progress.solution(positions)


SOLVER = Solver(solve)
