"""The problem in symbols as it stands: what it costs to build, compile, evaluate and solve, beside the loops.

    python benchmarks/symbols.py [DIR] [--every K] [--shipped K]

The problems are every K-th shipped scene and, with DIR, every K-th of MotionBenchMaker's for the Panda. First the
figures of each form: the graph in CasADi's interpreter, the graph as generated C, and the loops behind form external.
Then solvers on the graph as C, from the guesses that the planner has: the straight line, then ways through its roadmap;
at one weight of the penalty after another, each to a tolerance of 1e-4 or for 60 steps, until a motion is certified.
Times are of the processor, that of the compiler included.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from problems import real_problems

import hdplan
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.program import Program
from hdplan.planner.search.roadmap import seeds
from hdplan.planner.solvers.solution import DETOUR_WEIGHT, FIRST_WEIGHT, LAST_WEIGHT, RAISE
from hdplan.planner.studies.report import Cell, markdown_text
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.yaml_format.reader import shipped_scenes

QUIET = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
NEWTON = {"print_level": 0, "max_iter": 60, "tol": 1e-4, "mu_init": 1e-4}
SQP = {
    **{"max_iter": 60, "tol_du": 1e-4, "qpsol": "qrqp", "print_header": False, "print_iteration": False},
    **{"print_status": False, "qpsol_options": {"print_iter": False, "print_header": False, "error_on_fail": False}},
}
SOLVERS: dict[str, tuple[str, dict[str, Any]]] = {  # the Hessian and options of each
    "ipopt": ("exact", {"ipopt": {**NEWTON, "sb": "yes"}}),
    "fatrop": ("exact", {"fatrop": NEWTON}),
    "sqpmethod": ("gauss_newton", SQP),
}
GUESSES = 8  # for each problem


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, metavar="DIR")
    parser.add_argument("--every", type=int, default=10)
    parser.add_argument("--shipped", type=int, default=1)
    options = parser.parse_args()
    scenes = [hdplan.load_scene(name) for name in list(shipped_scenes())[options.shipped - 1 :: options.shipped]]
    if options.folder is not None:
        scenes += [each.load() for each in real_problems(options.folder, "panda", options.every)]
    forms: dict[str, list[dict[str, float]]] = {}
    solved: dict[str, list[dict[str, Any]]] = {}
    for scene in scenes:
        problem = hdplan.build(scene)
        problem = problem.resampled(problem.polyline())
        for name, figures in measured(problem).items():
            forms.setdefault(name, []).append(figures)
        for plugin in SOLVERS:
            solved.setdefault(plugin, []).append(tried(problem, plugin))
        print(
            scene.name, *(f"{key}: {found[-1]}" for key, found in (forms | solved).items()), sep="\n  ", file=sys.stderr
        )
    print(markdown_text([form_row(name, found) for name, found in forms.items()]))
    print()
    print(markdown_text([solver_row(name, found) for name, found in solved.items()]))


def seconds() -> float:
    """Of the processor [s], the compiler's too."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def in_turn(calls: list[Callable[[], object]], count: int) -> list[float]:
    """The median of each of some calls [ms], made in turn."""
    found: list[list[float]] = [[] for _ in calls]
    for _ in range(count):
        for call, spent in zip(calls, found, strict=True):
            began = time.process_time()
            call()
            spent.append(1e3 * (time.process_time() - began))
    return [float(np.median(spent[1:])) for spent in found]


def measured(problem: Problem) -> dict[str, dict[str, float]]:
    """Of each form: seconds to build and to compile, and milliseconds for cost and gradient, and for the Hessian, as
    multiples of what the loops take."""
    positions = problem.polyline()
    began = seconds()
    program = problem.casadi(form="symbolic")
    cost = program.standing["f"]
    hessian, gradient = ca.hessian(cost, program.x)
    given = [program.x, program.p]
    functions = [ca.Function("first", given, [cost, gradient]), ca.Function("second", given, [hessian])]
    built = [seconds() - began]
    began = seconds()
    compiled = [RowFunction(each) for each in functions]
    spent = seconds() - began
    began = seconds()
    problem.casadi()
    built = [*built * 2, seconds() - began]
    x, p = program.guess(positions), program.values(FIRST_WEIGHT)
    loops = (lambda: problem.evaluate(positions, FIRST_WEIGHT)), (lambda: problem.bend(positions))
    found: dict[str, dict[str, float]] = {}
    for name, which, count in (("graph, generated C", compiled, 16), ("graph, interpreted", functions, 4)):
        run = [getattr(each, "once", each) for each in which]
        calls = [*(lambda each=each: each(x, p) for each in run), *loops]  # type: ignore[misc]
        first, second, *of_loops = in_turn(calls, count)
        found[name] = {"first": first / of_loops[0], "second": second / of_loops[1]}
    found["loops"] = {"first": 1.0, "second": 1.0}
    return {
        name: each | {"build": took, "compile": spent * ("C" in name)}
        for (name, each), took in zip(found.items(), built, strict=True)
    }


def tried(problem: Problem, plugin: str) -> dict[str, Any]:
    """One solver: at which of the guesses it found a certified motion, if at any."""
    hessian, options = SOLVERS[plugin]
    began = seconds()
    program = problem.casadi(hessian, form="symbolic")
    solver = program.solver(plugin, {**options, **QUIET}, compiled=True)
    built, began = seconds() - began, seconds()
    found = {"build": built, "guess": -1}
    for number, (guess, weight) in enumerate(guesses(problem)):
        if reached(program, solver, guess, weight):
            found["guess"] = number
            break
    return found | {"solve": seconds() - began}


def guesses(problem: Problem) -> Iterator[tuple[Array, float]]:
    """The planner's own: waypoints and the first weight of the penalty."""
    for number, found in enumerate(itertools.islice(seeds(problem, 0), GUESSES)):
        yield found, DETOUR_WEIGHT if number else FIRST_WEIGHT


def reached(program: Program, solver: ca.Function, guess: Array, weight: float) -> bool:
    """Whether a certified motion is found from a guess, at one weight after another."""
    x = program.guess(guess)
    while weight <= LAST_WEIGHT:
        x = solver(x0=x, p=program.values(weight), **program.bounds)["x"]
        path = program.positions(x)
        if not np.isfinite(path).all():
            return False
        if certified(program.problem, path):
            return True
        weight *= RAISE
    return False


def certified(problem: Problem, path: Array) -> bool:
    """Whether a motion along waypoints is, with times where the scene asks for them."""
    trajectory = hdplan.Trajectory(problem.robot.joint_names, path, problem.robot.locked)
    try:
        if problem.scene.timed:
            trajectory = Retimer(problem.setup)(trajectory).trajectory
        return bool(hdplan.certify(problem.scene, trajectory).certified)
    except HdplanError:
        return False


def quantiles(values: list[float], digits: int) -> str:
    return " / ".join(f"{x:.{digits}f}" for x in np.quantile(values, [0.5, 0.95]))


def form_row(name: str, found: list[dict[str, float]]) -> dict[str, Cell]:
    """Medians and 95th percentiles."""
    return {
        "form": name,
        "build [s]": quantiles([each["build"] for each in found], 2),
        "compile [s]": quantiles([each["compile"] for each in found], 1),
        "cost and gradient, of the loops'": quantiles([each["first"] for each in found], 1),
        "Hessian, of the loops'": quantiles([each["second"] for each in found], 1),
    }


def solver_row(plugin: str, found: list[dict[str, Any]]) -> dict[str, Cell]:
    """How many are certified, and the times."""
    return {
        "solver": plugin,
        "Hessian": SOLVERS[plugin][0],
        "certified from the first guess": f"{sum(each['guess'] == 0 for each in found)} of {len(found)}",
        "from any guess": f"{sum(each['guess'] >= 0 for each in found)} of {len(found)}",
        "build and compile [s]": quantiles([each["build"] for each in found], 1),
        "solve [s]": quantiles([each["solve"] for each in found], 2),
    }


if __name__ == "__main__":
    main()
