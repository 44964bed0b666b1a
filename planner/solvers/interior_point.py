"""Interior-point solvers on the problem's CasADi program: short runs, between which the penalty weight rises.

A run begins at the motion of the last one. It counts as one step, and is judged like a step of any other solver: by the
cost that `Problem.evaluate` finds. The Hessian is the Gauss-Newton curvature: in runs as short as these the exact one
takes twice as long and ends in worse motions (docs/measurements.md).
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Mapping
from typing import Any

import casadi as ca
import numpy as np

from hdplan.planner.problem.penalty_function import PenaltyFunction
from hdplan.planner.problem.problem import Problem
from hdplan.planner.solvers.solution import EQUAL_COST, Budget, Progress, Solution
from hdplan.scenes.array_types import Array

RUN_STEPS = 5  # of a run: more only polish a motion that the next weight bends anyway
FIRST_BARRIER = 1e-4  # of a run: small, since it begins near the solution and few joints are at their limits
PATIENCE = 1  # a run that gains little has converged
QUIET = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}  # most runs end at their last step


def solve(plugin: str, options: Mapping[str, Any], problem: Problem, guess: Array, budget: Budget) -> Solution:
    """Improve a guess (N, n) by runs of one of CasADi's solvers, with options of that solver itself."""
    program = problem.casadi("gauss_newton")
    stages = program.stages if plugin == "fatrop" else {}
    run = ca.nlpsol("run", plugin, program.nlp, {plugin: {"max_iter": RUN_STEPS, **options}, **stages, **QUIET})
    positions = problem.clip(guess)
    progress = Progress(problem, budget, PATIENCE)
    state = problem.evaluate(positions, progress.weight)
    with _interrupts_noted() as pressed, progress.until_interrupted():
        penalty = program.penalty
        assert isinstance(penalty, PenaltyFunction)  # as it is external
        penalty.stop = lambda: pressed.is_set() or budget.spent() or budget.stop()
        while progress.goes_on():
            found = run(x0=program.guess(positions), p=progress.weight, **program.bounds)["x"]
            if penalty.error is not None:
                raise penalty.error
            trial = program.positions(np.array(found) if penalty.stopped_at is None else penalty.stopped_at)
            before, after = state.cost, problem.evaluate(trial, progress.weight)
            if after.cost <= (1 + EQUAL_COST) * before:  # of equal costs the later run is closer to the minimum
                positions, state = trial, after
            if progress.step(before, state, positions):
                state = problem.evaluate(positions, progress.weight)
            if pressed.is_set():
                raise KeyboardInterrupt
    return progress.solution(positions)


@contextlib.contextmanager
def _interrupts_noted() -> Iterator[threading.Event]:
    """Note Ctrl-C instead of raising it: CasADi would take the exception for a failed evaluation and continue."""
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # no other thread receives it
        yield pressed
        return

    def note(*_: object) -> None:
        pressed.set()

    before = signal.signal(signal.SIGINT, note)
    try:
        yield pressed
    finally:
        if signal.getsignal(signal.SIGINT) is note:  # whoever has taken its place since keeps noting after this run
            signal.signal(signal.SIGINT, before or signal.SIG_DFL)
