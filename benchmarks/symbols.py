"""The problem in symbols as it stands: what it costs to build, compile, evaluate and solve, beside the loops.

    python benchmarks/symbols.py [DIR] [--every K] [--shipped K]

The problems are every K-th shipped scene and, with DIR, every K-th of MotionBenchMaker's for the Panda. First the
figures of each form: the graph in CasADi's interpreter, the graph as generated C, and the loops behind form external.
Then solvers on the graph as C, from the guesses that the planner has: the straight line, then ways through its roadmap;
at one weight of the penalty after another, each to a tolerance of 1e-4 or for 60 steps, until a motion is certified;
where none is, why. Times are of the processor, that of the compiler included.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import casadi as ca
import numpy as np
from cells import quantiles
from problems import SHIPPED, mixed_parser, mixed_problems

import hdplan
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.program import Program
from hdplan.planner.search.roadmap import seeds
from hdplan.planner.solvers.solution import DETOUR_WEIGHT, FIRST_WEIGHT, LAST_WEIGHT, RAISE
from hdplan.planner.studies.report import Cell, markdown_text
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError

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


STEP = {"print_level": 0, "max_iter": 10, "sb": "yes"}  # ten steps of Ipopt, to time one


def main() -> None:
    """Run the benchmark from the command line."""
    parser = mixed_parser(__doc__)
    parser.add_argument("--shipped", type=int, default=1, metavar="K")
    options = parser.parse_args()
    problems = list(mixed_problems(options.folder, options.every, ["panda"]))
    shipped = [each for each in problems if each[0] == SHIPPED]
    problems = shipped[options.shipped - 1 :: options.shipped] + problems[len(shipped) :]
    found: list[dict[str, Any]] = []
    for _, name, load in problems:
        problem = hdplan.build(load())
        problem = problem.resampled(problem.polyline())
        forms = measured(problem)
        found.append({"name": name, "forms": forms, "solved": {each: tried(problem, each) for each in SOLVERS}})
        print(f"{len(found)} of {len(problems)}: {found[-1]}", file=sys.stderr, flush=True)
    print(markdown_text([form_row(form, [each["forms"] for each in found]) for form in found[0]["forms"]]))
    print()
    print(markdown_text([solver_row(plugin, [each["solved"][plugin] for each in found]) for plugin in SOLVERS]))
    for plugin in SOLVERS:
        for each in found:
            if each["solved"][plugin]["guess"] < 0:
                print(f"\n{plugin}, {each['name']}: {each['solved'][plugin]['why']}")


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
    """Of each form: seconds to build and to compile, and milliseconds for the cost, for cost and gradient, for the
    Hessian, and for a step of Ipopt."""
    positions = problem.polyline()
    results: dict[str, dict[str, float]] = {}
    every: list[Callable[[], object]] = []
    solvers: list[ca.Function] = []
    forms = ("generated C", "symbolic", True), ("interpreted", "symbolic", False), ("loops", "", False)
    for name, form, in_c in forms:
        began = seconds()
        program = problem.casadi(form=form or "external")
        built, began = seconds() - began, seconds()
        with no_cache():
            solver = program.solver("ipopt", {"ipopt": STEP, **QUIET}, compiled=in_c)
        spent, x, p = seconds() - began, program.guess(positions), program.values(FIRST_WEIGHT)
        first, second = (lambda: problem.evaluate(positions, FIRST_WEIGHT)), (lambda: problem.second_order(positions))
        calls: list[Callable[[], object]] = [first, second]  # cost and gradient together, once: a second call is warmer
        if form:
            more = {"nlp_f": (), "nlp_grad_f": (), "nlp_hess_l": (np.ones(1), np.zeros(solver.numel_in("lbg")))}
            calls = [buffered(solver.get_function(key), [x, p, *given]) for key, given in more.items()]
        calls.append(lambda solver=solver, program=program, x=x: stepped(solver, program, x))  # type: ignore[misc]
        every += calls
        solvers.append(solver)
        results[name] = {"build": built, "compile": spent * in_c}
    times = iter(in_turn(every, 8))  # of all forms in turn, as the machine may be busy
    for (name, found), solver in zip(results.items(), solvers, strict=True):
        value = next(times)
        slope = value if name == "loops" else next(times)
        hessian, steps = itertools.islice(times, 2)
        taken = max(1, int(solver.stats()["iter_count"]))
        results[name] = found | {"value": value, "first": slope, "second": hessian, "step": steps / taken}
    return results


@contextlib.contextmanager
def no_cache() -> Iterator[None]:
    """Nothing that was compiled before is found."""
    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, HDPLAN_CACHE=folder):
        yield


def buffered(function: ca.Function, given: list[Array]) -> Callable[[], object]:
    """A call of a function without conversions."""
    memory, run = function.buffer()
    results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
    for k, array in enumerate(given):
        memory.set_arg(k, array.data)  # type: ignore[call-arg]  # an overload that the stubs lack
    for k, array in enumerate(results):
        memory.set_res(k, array.data)  # type: ignore[call-arg]
    return lambda: (run(), memory, given, results)  # which have to stay alive


def stepped(solver: ca.Function, program: Program, x: Array) -> None:
    """Some steps of a solver."""
    solver(x0=x, p=program.values(FIRST_WEIGHT), **program.bounds)


def tried(problem: Problem, plugin: str) -> dict[str, Any]:
    """One solver: at which of the guesses it found a certified motion, if at any."""
    hessian, options = SOLVERS[plugin]
    began = seconds()
    program = problem.casadi(hessian, form="symbolic")
    with no_cache():
        solver = program.solver(plugin, {**options, **QUIET}, compiled=True)
    built, began = seconds() - began, seconds()
    found: dict[str, Any] = {"build": built, "guess": -1}
    for number, (guess, weight) in enumerate(guesses(problem)):
        found["why"] = why = missed(program, solver, guess, weight)
        if why is None:
            found["guess"] = number
            break
    return found | {"solve": seconds() - began}


def guesses(problem: Problem) -> Iterator[tuple[Array, float]]:
    """The planner's own: waypoints and the first weight of the penalty."""
    for number, found in enumerate(itertools.islice(seeds(problem, 0), GUESSES)):
        yield found, DETOUR_WEIGHT if number else FIRST_WEIGHT


def missed(program: Program, solver: ca.Function, guess: Array, weight: float) -> str | None:
    """Why no certified motion is found from a guess, at one weight after another; None where one is."""
    x, why = ca.DM(program.guess(guess)), "no weight"
    while weight <= LAST_WEIGHT:
        x = solver(x0=x, p=program.values(weight), **program.bounds)["x"]
        path = program.positions(x)
        if not np.isfinite(path).all():
            return f"{solver.stats()['return_status']}, no numbers"
        if (found := refused(program.problem, path)) is None:
            return None
        why, weight = found, weight * RAISE
    return why


def refused(problem: Problem, path: Array) -> str | None:
    """Why a motion along waypoints, with times where the scene asks for them, has no certificate; None if it has."""
    trajectory = hdplan.Trajectory(problem.robot.joint_names, path, problem.robot.locked)
    try:
        if problem.scene.timed:
            trajectory = Retimer(problem.setup)(trajectory).trajectory
        found = hdplan.certify(problem.scene, trajectory)
        return None if found.certified else " ".join(found.text.split())
    except HdplanError as error:
        return str(error)


def form_row(form: str, found: list[dict[str, dict[str, float]]]) -> dict[str, Cell]:
    """Medians and 95th percentiles."""

    def column(key: str, digits: int, of: str = "") -> str:
        return quantiles([each[form][key] / (each[of][key] if of else 1.0) for each in found], digits=digits)

    return {
        "form": form,
        "build [s]": column("build", 2),
        "compile [s]": column("compile", 1),
        "cost [ms]": column("value", 2),
        "cost and gradient [ms]": column("first", 2),
        "of the loops'": column("first", 1, "loops"),
        "Hessian [ms]": column("second", 2),
        "step of Ipopt [ms]": column("step", 1),
    }


def solver_row(plugin: str, found: list[dict[str, Any]]) -> dict[str, Cell]:
    """How many are certified, and the times."""
    return {
        "solver": plugin,
        "Hessian": SOLVERS[plugin][0],
        "certified from the first guess": f"{sum(each['guess'] == 0 for each in found)} of {len(found)}",
        "from any guess": f"{sum(each['guess'] >= 0 for each in found)} of {len(found)}",
        "build and compile [s]": quantiles([each["build"] for each in found], digits=1),
        "solve [s]": quantiles([each["solve"] for each in found], digits=2),
    }


if __name__ == "__main__":
    main()
