"""The CasADi program to a tolerance, with the penalty's exact Hessian and with the Gauss-Newton curvature in its place.

    python benchmarks/hessians.py [DIR] [--every K]

The problems are the shipped scenes and, with DIR, every K-th problem of MotionBenchMaker for Panda and UR5. From the
straight line, five weights of the penalty one after another, each to its minimum; and from the motion that the default
solver found, its last weight. Ipopt and fatrop with a tolerance of 1e-6, at most 300 steps for a weight. Times are of
the processor, warm, without the set-up.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from cells import quantiles
from problems import mixed_parser, mixed_problems

import hdplan
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.program import HESSIANS
from hdplan.planner.studies.report import Cell, markdown_text
from hdplan.scenes.array_types import Array

PLUGINS: dict[str, dict[str, Any]] = {"ipopt": {"sb": "yes"}, "fatrop": {}}
OPTIONS: dict[str, Any] = {"print_level": 0, "max_iter": 300, "tol": 1e-6, "mu_init": 1e-4}
QUIET = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
WEIGHTS = tuple(6e3 * 6.0 ** np.arange(5))  # of the penalty [1/m²]


@dataclass(frozen=True)
class Outcome:
    """All weights of one start."""

    converged: bool  # at every weight
    steps: int
    seconds: float
    cost: float  # at the last weight


def main() -> None:
    """Run the benchmark from the command line."""
    options = mixed_parser(__doc__).parse_args()
    starts: dict[str, list[dict[tuple[str, str], Outcome]]] = {"straight line": [], "motion of the default solver": []}
    for _, title, load in mixed_problems(options.folder, options.every):
        problem = hdplan.build(load())
        found = hdplan.solve(problem)
        for name, first, weights in (
            ("straight line", problem.polyline(), WEIGHTS),
            ("motion of the default solver", found.trajectory.positions, (found.weight,)),
        ):
            starts[name].append(solved(problem, first, weights))
            print(title, name, *(vars(each) for each in starts[name][-1].values()), sep="\n  ", file=sys.stderr)
    print(markdown_text([row for start, outcomes in starts.items() for row in rows(start, outcomes)]))


def solved(problem: Problem, first: Array, weights: Sequence[float]) -> dict[tuple[str, str], Outcome]:
    """Each solver with each Hessian."""
    found = {}
    for plugin, own in PLUGINS.items():
        for hessian in HESSIANS:
            program = problem.casadi(hessian)
            stages = program.stages if plugin == "fatrop" else {}
            settings: dict[str, Any] = {plugin: OPTIONS | own, **QUIET, **stages}
            solver = ca.nlpsol("solver", plugin, program.nlp, settings)
            x, states, began = ca.DM(program.guess(first)), [], time.process_time()
            for weight in weights:
                result = solver(x0=x, p=weight, **program.bounds)
                x = result["x"]
                states.append(solver.stats())
            found[plugin, hessian] = Outcome(
                all(state["success"] for state in states),
                sum(state["iter_count"] for state in states),
                time.process_time() - began,
                float(result["f"]),
            )
    return found


def rows(start: str, outcomes: Sequence[dict[tuple[str, str], Outcome]]) -> list[dict[str, Cell]]:
    """One row for each solver and Hessian."""
    result: list[dict[str, Cell]] = []
    for plugin, hessian in outcomes[0]:
        own = [found[plugin, hessian] for found in outcomes]
        costs = [found[plugin, hessian].cost / min(other.cost for other in found.values()) for found in outcomes]
        row: dict[str, Cell] = {
            "from": start,
            "solver": plugin,
            "Hessian": hessian,
            "converged": f"{sum(each.converged for each in own)} of {len(own)}",
            "steps, median / p95": quantiles([each.steps for each in own]),
            "time, median / p95 [s]": quantiles([each.seconds for each in own], digits=2),
            "cost over the least of all, median / p95": quantiles(costs, digits=3),
        }
        result.append(row)
    return result


if __name__ == "__main__":
    main()
