"""Every solver on the same problems with the same certificate: success, time, cost.

    python benchmarks/solvers.py [DIR] [--every K] [--solvers NAME ...] [--time-limit S]

The problems are the shipped scenes and, with DIR, every K-th problem of MotionBenchMaker for Panda and UR5. Prints a
table that sums up, and one of the shipped scenes; warm, one run each. Time is that of the whole plan, from the scene to
the certificate. Cost is the scene's objective: smoothness, but where the motion is to be quick.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from cells import quantiles
from problems import SHIPPED, mixed_parser, mixed_problems

import hdplan
from hdplan.planner.solvers import SOLVERS
from hdplan.planner.studies.planning_runs import path_length
from hdplan.planner.studies.report import Cell, markdown_text


@dataclass(frozen=True)
class Outcome:
    """One plan."""

    status: str
    certified: bool
    first: bool  # by the first guess
    seconds: float
    cost: float  # by the scene's objective
    length: float  # of the path in joint space


def main() -> None:
    """Run the benchmark from the command line."""
    parser = mixed_parser(__doc__)
    parser.add_argument("--solvers", nargs="+", default=list(SOLVERS), choices=SOLVERS)
    parser.add_argument("--time-limit", type=float, default=10.0)
    options = parser.parse_args()
    outcomes: dict[str, dict[str, dict[str, Outcome]]] = {}
    for robot, name, load in mixed_problems(options.folder, options.every):
        group = outcomes.setdefault(robot if robot == SHIPPED else f"MotionBenchMaker, {robot}", {})
        group[name] = planned(name, load(), options.solvers, options.time_limit)
    print(markdown_text([row for group, found in outcomes.items() for row in summary(group, list(found.values()))]))
    print("Time [s] and cost of each shipped scene:\n")
    print(markdown_text([scene_row(name, found) for name, found in outcomes[SHIPPED].items()]))


def planned(name: str, scene: hdplan.Scene, solvers: Sequence[str], time_limit: float) -> dict[str, Outcome]:
    """Plan with each solver."""
    hdplan.plan(scene, time_limit=time_limit)  # what a first plan fits, compiles and keeps
    found = {}
    for solver in solvers:
        began = time.perf_counter()
        result = hdplan.plan(scene, solver=solver, time_limit=time_limit)
        seconds = time.perf_counter() - began
        status, cost, length = result.certificate.status.value, result.objective.value, path_length(result.trajectory)
        found[solver] = Outcome(status, result.certified, result.attempts == 1, seconds, cost, length)
        print(name, solver, *vars(found[solver]).values(), file=sys.stderr)
    return found


def summary(group: str, outcomes: Sequence[dict[str, Outcome]]) -> list[dict[str, Cell]]:
    """One row for each solver."""
    rows: list[dict[str, Cell]] = []
    for solver in outcomes[0]:
        own = [found[solver] for found in outcomes]
        ratios, lengths = (
            [getattr(found[solver], what) / least(found, what) for found in outcomes if found[solver].certified]
            for what in ("cost", "length")
        )
        row: dict[str, Cell] = {
            "problems": group,
            "solver": solver,
            "certified": f"{sum(outcome.certified for outcome in own)} of {len(own)}",
            "by the first guess": sum(outcome.certified and outcome.first for outcome in own),
            "time median / p95 / worst [s]": quantiles([outcome.seconds for outcome in own], (0.5, 0.95, 1.0), 2),
            "cost over the least of all, median / p95": quantiles(ratios, digits=2),
            "length over the shortest of all, mean": f"{np.mean(lengths):.3f}" if lengths else None,
        }
        rows.append(row)
    return rows


def least(found: dict[str, Outcome], what: str) -> float:
    """The least cost or length of what is certified."""
    return max(min(float(getattr(each, what)) for each in found.values() if each.certified), 1e-9)


def scene_row(name: str, found: dict[str, Outcome]) -> dict[str, Cell]:
    """Time and cost of each solver, or what came of it instead."""
    return {
        "scene": name,
        **{
            solver: f"{each.seconds:.2f}, {each.cost:.3g}" if each.certified else each.status
            for solver, each in found.items()
        },
    }


if __name__ == "__main__":
    main()
