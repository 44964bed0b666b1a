"""The default solver: damped Gauss-Newton steps (`newton_step`) with a rising penalty weight."""

from __future__ import annotations

from hdplan.planner.problem.problem import Problem
from hdplan.planner.solvers.newton_step import newton_step
from hdplan.planner.solvers.solution import EQUAL_COST, Budget, Progress, Solution, Solver, SolverStatus
from hdplan.scenes.array_types import Array

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e6  # λ
PATIENCE = 1  # a Newton step that gains little has converged


def solve(problem: Problem, guess: Array, budget: Budget) -> Solution:
    """Improve a guess (N, n) until every sample keeps its distance, or progress ends."""
    positions = problem.clip(guess)
    progress = Progress(problem, budget, PATIENCE)
    state = problem.evaluate(positions, progress.weight)
    damping = FIRST_DAMPING
    with progress.until_interrupted():
        while progress.goes_on():
            trial = problem.clip(positions + newton_step(problem, positions, state, damping))
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
                trial = problem.clip(positions + newton_step(problem, positions, state, 0.0))
                after = problem.evaluate(trial, progress.weight)
                if after.cost <= (1 + EQUAL_COST) * state.cost and progress.is_clear(after):
                    before, positions, state, damping = state.cost, trial, after, FIRST_DAMPING
                    progress.go_on(before, state, positions)
    return progress.solution(positions)


SOLVER = Solver(solve)
