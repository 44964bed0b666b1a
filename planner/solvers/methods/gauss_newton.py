"""The default solver: damped Gauss-Newton steps on a system that is banded in time, with a rising penalty weight.

Each step solves (H + λ diag H) dq = −∇, where H is the smoothness' exact Hessian plus the penalty's Gauss-Newton
curvature. A waypoint is coupled only to its two neighbours on either side, so H is banded and a step costs O(N n³).
Joint limits hold by projection: coordinates that a step would push beyond a limit are held for that step (Bertsekas,
Projected Newton Methods, 1982).
"""

from __future__ import annotations

import functools

import numpy as np

from hdplan.planner.problem.problem import Evaluation, Problem
from hdplan.planner.solvers.banded_system import solve_banded
from hdplan.planner.solvers.solution import SAME, Budget, Progress, Solution, Solver, SolverStatus
from hdplan.scenes.array_types import Array, Rows

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e6  # λ
PATIENCE = 1  # a Newton step that gains little has converged
REST = 1e15  # stiffness that holds a coordinate at its limit for one step


def solve(problem: Problem, guess: Array, budget: Budget) -> Solution:
    """Improve a guess (N, n) until every sample keeps its distance, or no progress is made any more."""
    positions = problem.clip(guess)
    progress = Progress(problem, budget, PATIENCE)
    state = problem.evaluate(positions, progress.weight)
    damping = FIRST_DAMPING
    with progress.until_interrupted():
        while progress.goes_on():
            trial = problem.clip(positions + _step(problem, positions, state, damping))
            after = problem.evaluate(trial, progress.weight)
            before = state.cost
            if after.cost < before:
                positions, state, damping = trial, after, max(damping / 4, LEAST_DAMPING)
            else:
                damping = min(damping * 6, MOST_DAMPING)
            if progress.step(before, state, positions):
                state, damping = problem.evaluate(positions, progress.weight), max(damping, FIRST_DAMPING)
            if progress.status is SolverStatus.CLEAR:
                # An undamped step: without any penalty it leads to the minimum at once, and small steps may just
                # have been too cautious.
                trial = problem.clip(positions + _step(problem, positions, state, 0.0))
                after = problem.evaluate(trial, progress.weight)
                if after.cost <= (1 + SAME) * state.cost and progress.is_clear(after):
                    before, positions, state, damping = state.cost, trial, after, FIRST_DAMPING
                    progress.go_on(before, state, positions)
    return progress.solution(positions)


def _step(problem: Problem, positions: Array, state: Evaluation, damping: float) -> Array:
    """The damped Gauss-Newton step as waypoint displacements (N, n), zero at the ends."""
    interior = positions[1:-1]
    count, n = interior.shape
    band = _band(problem.smoothness.matrix[1:-1, 1:-1], state, damping)
    gradient = state.gradient
    outward = ((interior >= problem.robot.inner[1]) & (gradient < 0)) | (
        (interior <= problem.robot.inner[0]) & (gradient > 0)
    )
    band[0] += REST * outward.ravel()
    step = np.zeros_like(positions)
    step[1:-1] = -solve_banded(band, np.where(outward, 0.0, gradient).ravel()).reshape(count, n)
    return step


def _band(smoothness: Array, state: Evaluation, damping: float) -> Array:
    """The lower band (2 n + 1, M n) of the Hessian for M interior waypoints: row d, column c holds H[c + d, c]."""
    count, n = state.gradient.shape
    band = np.zeros((2 * n + 1, count * n))
    for offset in range(min(3, count)):
        band[offset * n, : (count - offset) * n] = np.repeat(np.diagonal(smoothness, offset), n)
    within, between, (row, column) = _places(count, n)
    band.ravel()[within] += state.diagonal[:, row, column]
    band.ravel()[between] += state.coupling.reshape(-1, n * n)
    band[0] *= 1 + damping
    return band


@functools.lru_cache(maxsize=8)
def _places(count: int, n: int) -> tuple[Rows, Rows, tuple[Rows, Rows]]:
    """The positions in the flat band of each waypoint's block and of the block that couples it to the next: of the
    former, which is symmetric, the lower triangle (M, n (n + 1) / 2), of the latter everything (M − 1, n²); also that
    triangle's rows and columns."""
    width, first = count * n, np.arange(count)[:, None] * n
    row, column = np.tril_indices(n)
    within = (row - column) * width + first + column
    below, beside = (index.ravel() for index in np.indices((n, n)))
    between = (n + below - beside) * width + first[:-1] + beside
    return within, between, (row, column)


SOLVER = Solver(solve)
