"""What a problem's terms weigh: the size of their compiled functions, and their share of a trial evaluation.

In: a built `Problem`. Out: (name, value) rows; sizes are exact, times measured on the spot.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.problem import Floats, Problem
from hdplan.planner.problem.swept_clearance import SweptClearance
from hdplan.planner.problem.terms import Clearance, MotionTerm, Term
from hdplan.planner.solvers.solution import FIRST_WEIGHT

Rows = list[tuple[str, str]]

TRIALS = 9  # evaluations of which the median counts, after one that warms up


def functions(problem: Problem) -> Rows:
    """Return a row for each compiled function: instructions of one evaluation, nodes of its expression."""
    rows = [("kinematics", _sizes(problem.kinematics.state))]
    for term in problem.terms:
        found = list(_compiled(term))
        rows += [(f"{term.name}{which}", _sizes(function)) for which, function in found]
        if not found:
            rows.append((term.name, "nothing compiled: NumPy, or a library"))
    if problem.scene.limits.torque is not None:
        from hdplan.planner.kinematics.inverse_dynamics import dynamics_of

        rows.append(("timing, torques", _sizes(dynamics_of(problem.setup).function)))
    return rows


def _compiled(term: Term | MotionTerm) -> Iterator[tuple[str, Any]]:
    """The functions that a term calls, by what tells them apart."""
    if isinstance(term, Clearance) and isinstance(term.distance, HdsdfPairs):
        for count in sorted(set(term.pairs.plane_slots.tolist())):
            yield f", {count} planes", term.distance.kernels[count].function
    if isinstance(term, SweptClearance):
        for count in sorted(set(term.pairs.plane_slots.tolist())):
            yield f", {count} planes, swept", term.kernels[count].function


def _sizes(function: Any) -> str:
    """How large a CasADi function is; one made of matrices is counted as the scalar operations that it stands for."""
    if function.is_a("MXFunction"):
        function = function.expand()
    return f"{function.n_instructions()} instructions, {function.n_nodes()} nodes"


def trial(problem: Problem) -> Rows:
    """Return a row for each part of one evaluation at the straight line: its time and its share of the cost, which is
    weighed as at the solver's beginning."""
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    placed = problem.samples.configurations(line)
    kinematics = problem.kinematics.evaluate(placed)
    seconds = {"kinematics": _median(lambda: problem.kinematics.evaluate(placed))}
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


def _run(term: Term | MotionTerm, problem: Problem, kinematics: KinematicsBatch, line: Floats) -> Callable[[], float]:
    """What one evaluation of a term takes; it returns the term's cost."""
    if isinstance(term, MotionTerm):
        return lambda: term.over_motion(line, problem.kinematics.evaluate(line)).cost
    return lambda: term.value(kinematics, problem.samples).cost


def _median(run: Callable[[], object]) -> float:
    run()
    taken = []
    for _ in range(TRIALS):
        began = time.perf_counter()
        run()
        taken.append(time.perf_counter() - began)
    return float(np.median(taken))


def _percent(part: float, whole: float) -> str:
    return f"{100 * part / whole if whole else 0.0:3.0f} %"
