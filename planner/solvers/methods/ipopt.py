"""Ipopt on the CasADi problem: an interior-point method with exact Hessians; the penalty weight rises between its runs.

Every pair at every sample is in the graph, so a step costs far more than one of gauss_newton. It shows what exact
second derivatives gain, and how to hand the problem to any other solver.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from hdplan.planner.problem.problem import Problem
from hdplan.planner.solvers.nlp import nlp
from hdplan.planner.solvers.solution import SAME, Budget, Progress, Solution, Solver
from hdplan.scenes.array_types import Array
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.scene import Scene

STEPS_PER_WEIGHT = 20


def solve(problem: Problem, guess: Array, budget: Budget) -> Solution:
    """Improve a guess (N, n) by interior-point runs at rising penalty weights."""
    positions = problem.clip(guess)
    progress = Progress(problem, budget, patience=1)
    state = problem.evaluate(positions, progress.weight)
    whole = nlp(problem)
    pressed = threading.Event()
    stop = _Stop(whole.x.numel(), budget, pressed)
    run = ca.nlpsol(
        "run",
        "ipopt",
        {"x": whole.x, "p": whole.weight, "f": whole.cost},
        {
            "grad_f": ca.Function(
                "grad_f", [whole.x, whole.weight], [whole.cost, whole.gradient], ["x", "p"], ["f", "grad_f_x"]
            ),
            "hess_lag": _lagrangian_hessian(whole.x, whole.weight, whole.hessian),
            "iteration_callback": stop,
            "print_time": False,
            "error_on_fail": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "max_iter": STEPS_PER_WEIGHT,
                "mu_init": 1e-4,
                "bound_relax_factor": 0.0,
            },
        },
    )
    with _interrupts_noted(pressed), progress.until_interrupted():
        while progress.goes_on():
            found = run(x0=positions[1:-1].ravel(), p=progress.weight, lbx=whole.lower, ubx=whole.upper)
            trial = positions.copy()
            trial[1:-1] = np.array(found["x"]).reshape(positions[1:-1].shape)
            trial = problem.clip(trial)
            before, after = state.cost, problem.evaluate(trial, progress.weight)
            if after.cost <= (1 + SAME) * before:  # of equal costs the later run is closer to the minimum
                positions, state = trial, after
            if progress.step(before, state, positions):
                state = problem.evaluate(positions, progress.weight)
            if pressed.is_set():
                raise KeyboardInterrupt
    return progress.solution(positions)


def _lagrangian_hessian(x: ca.MX, weight: ca.MX, hessian: ca.MX) -> ca.Function:
    """The Hessian as CasADi's interface to ipopt wants it: its upper triangle, times the objective's factor."""
    factor, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", 0)
    triangle = ca.triu(factor * hessian)
    return ca.Function(
        "hess_lag", [x, weight, factor, multipliers], [triangle], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
    )


@contextlib.contextmanager
def _interrupts_noted(pressed: threading.Event) -> Iterator[None]:
    """Note Ctrl-C instead of raising it: CasADi would take the exception for a failed evaluation and continue."""
    if threading.current_thread() is not threading.main_thread():  # no other thread receives it
        yield
        return
    before = signal.signal(signal.SIGINT, lambda *_: pressed.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before or signal.SIG_DFL)


class _Stop(ca.Callback):
    """Ends a run when the time is up or the user asks for it."""

    def __init__(self, size: int, budget: Budget, pressed: threading.Event) -> None:
        ca.Callback.__init__(self)
        self.size = size
        self.budget = budget
        self.pressed = pressed
        self.construct("stop")

    def get_n_in(self) -> int:
        """The outputs of nlpsol."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """One flag."""
        return 1

    def get_sparsity_in(self, index: int) -> ca.Sparsity:
        """Shapes of nlpsol's outputs: x and its multipliers are vectors, the cost a scalar, the rest empty."""
        return ca.Sparsity.dense({"x": self.size, "lam_x": self.size, "f": 1}.get(ca.nlpsol_out(index), 0), 1)

    def eval(self, arg: Sequence[ca.DM]) -> Sequence[ca.DM]:
        """1 ends the run."""
        return [ca.DM(float(self.budget.spent() or self.budget.stop() or self.pressed.is_set()))]


def _without_second_derivatives(scene: Scene) -> str | None:
    """Name what the scene asks for that has no exact second derivatives."""
    lacking = {
        "planner.swept: true": scene.planner.swept,
        "the distance fcl": scene.planner.distance == "fcl",
        "a path constraint (section path)": scene.path != PathConstraints(),
        "a torque limit (limits.torque)": scene.limits.torque is not None,
        "an obstacle that moves": bool(scene.moving),
    }
    found = next((name for name, asked in lacking.items() if asked), None)
    return None if found is None else f"needs exact second derivatives, which {found} does not have"


SOLVER = Solver(solve, _without_second_derivatives, live=False)
