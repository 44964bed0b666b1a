"""The cost of a problem's terms: the size of their CasADi functions, and their share of a trial evaluation.

In: a built `Problem`. Out: (name, value) rows; sizes are exact, times are measured.
"""

from __future__ import annotations

import timeit
from collections.abc import Callable
from typing import Any

import numpy as np

from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.terms import Term
from hdplan.planner.solvers.solution import FIRST_WEIGHT
from hdplan.scenes.array_types import Array

Rows = list[tuple[str, str]]

TRIALS = 9  # evaluations whose median is shown, after one for warming up


def functions(problem: Problem) -> Rows:
    """Return a row for each CasADi function: the instructions of one evaluation, and the nodes of its expression."""
    rows = [("kinematics", _sizes(problem.kinematics.state))]
    for term in problem.terms:
        rows += [(f"{term.name}, {purpose}", _sizes(function)) for purpose, function in term.functions.items()]
        if not term.functions:
            rows.append((term.name, "no expression: NumPy, or a library"))
    if problem.scene.limits.torque is not None:
        from hdplan.planner.kinematics.inverse_dynamics import dynamics_of

        rows.append(("timing, torques", _sizes(dynamics_of(problem.setup).function)))
    return rows


def _sizes(function: Any) -> str:
    """Return the size of a CasADi function; one on matrices is counted in scalar operations."""
    if function.is_a("MXFunction"):
        function = function.expand()
    return f"{function.n_instructions()} instructions, {function.n_nodes()} nodes"


def trial(problem: Problem) -> Rows:
    """Return a row for each part of one evaluation at the straight line: its time and its share of the cost, with the
    solver's initial weight."""
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    placed = problem.samples.configurations(line)
    kinematics = problem.placed(placed)
    seconds = {"kinematics": _median(lambda: problem.placed(placed))}
    costs = {"smoothness": problem.smoothness.value(line)[0]}
    seconds["smoothness"] = _median(lambda: problem.smoothness.value(line))
    for term in problem.terms:
        run = _run(term, problem, kinematics, line)
        costs[term.name], seconds[term.name] = FIRST_WEIGHT * run(), _median(run)
    whole, cost = sum(seconds.values()), sum(costs.values())
    rows = []
    for name, taken in seconds.items():
        share = f"   cost {costs[name]:10.4g} {_percent(costs[name], cost)}" if name in costs else ""
        rows.append((name, f"{taken * 1e3:7.3f} ms {_percent(taken, whole)}{share}"))
    evaluated = _median(lambda: problem.evaluate(line, FIRST_WEIGHT))
    place = f"at the straight line, {len(placed)} configurations; weight {FIRST_WEIGHT:g}/m²; medians of {TRIALS}, warm"
    return [("measured", place), *rows, ("all, with derivatives", f"{evaluated * 1e3:7.3f} ms")]


def _run(term: Term, problem: Problem, kinematics: KinematicsBatch, line: Array) -> Callable[[], float]:
    """Return one evaluation of a term as a function, which returns the term's cost."""

    def run() -> float:
        along = problem.robot.expand(line)
        found = (term.at_samples(kinematics, problem.samples), term.over_motion(along, problem.kinematics))
        return sum(penalty.cost for penalty in found if penalty)

    return run


def _median(run: Callable[[], object]) -> float:
    return float(np.median(timeit.repeat(run, repeat=TRIALS + 1, number=1)[1:]))


def _percent(part: float, whole: float) -> str:
    return f"{100 * part / whole if whole else 0.0:3.0f} %"
