"""HD-SDF against FCL as the obstacle penalty: same bodies, functional, solver, first guesses and certificate.

    python benchmarks/penalties.py DIR [--robot NAME ...] [--set cage ...] [--every K] [--time-limit S]
    [--picture F]

DIR holds MotionBenchMaker's problems as `mbm` takes them; the shipped scenes come on top. Each problem is planned with
each of VARIANTS, one right after the other, all else at its default. Prints tables: effort over all problems, motions
over those that all certify, cost of a pair's distance with and without Python's loop (`penalty_pairs`),
near-parallel faces (`penalty_faces`); to the error stream, a line per problem; and draws a picture of the cost against
the iteration (`penalty_picture`).

All penalties are ½ min(D, 0)² with the same weights and the same margin of 20 mm, and D is zero about where bodies keep
it; but deeper inside the HD-SDF is up to 1.6 times the exact depth, and its planes enclose a little more than the
obstacle. The solver's own constants were chosen with the HD-SDF. "Refused" is a step that leaves the motion as it was,
since the cost would rise. Times are of the processor, not of
the clock on the wall. Length and smoothness as in `peer_task.measure`.
"""

from __future__ import annotations

import contextlib
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import penalty_faces
import penalty_pairs
import penalty_picture
from cells import milliseconds, quantiles
from peer_task import Shape, measure
from penalty_faces import VARIANTS, varied
from problems import SHIPPED, mixed_problems, problem_parser
from threadpoolctl import threadpool_limits

import hdplan
from hdplan.planner.collision.euclidean import FclPairs
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.search import Event
from hdplan.planner.solvers import SOLVERS
from hdplan.planner.solvers.solution import Iteration, Solver
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.scene import Scene


@dataclass
class Meter:
    """Calls and time of one plan."""

    evaluations: int = 0  # of the cost
    evaluate: float = 0.0  # [s] in them
    pairs: int = 0  # distances computed, in evaluations and in the choice of first guesses
    distance: float = 0.0  # [s] in them
    solve: float = 0.0  # [s] in the solver, all attempts


@dataclass(frozen=True)
class Run:
    """One problem with one penalty."""

    group: str  # panda, ur5 or the shipped scenes
    problem: str
    variant: str
    certified: bool
    attempts: int
    meter: Meter
    shape: Shape
    clearance: float  # [m] proven; NaN without proof
    steps: tuple[tuple[Iteration, ...], ...] = field(repr=False)  # of each attempt

    @property
    def iterations(self) -> int:
        return sum(len(attempt) for attempt in self.steps)

    @property
    def refused(self) -> int:
        """Steps after which the motion is what it was."""
        return sum(
            before.smoothness == after.smoothness
            for attempt in self.steps
            for before, after in itertools.pairwise(attempt)
        )


@contextlib.contextmanager
def metered() -> Iterator[Meter]:
    """Count and time the solves, evaluations and distances made within."""
    meter = Meter()

    def evaluate(self: Problem, *arguments: Any) -> Any:
        began = time.process_time()
        result = true_evaluate(self, *arguments)
        meter.evaluate += time.process_time() - began
        meter.evaluations += 1
        return result

    def timed(compute: Callable[..., Any]) -> Callable[..., Any]:
        def call(self: Any, kinematics: Any, sample: Any, pair: Any) -> Any:
            began = time.process_time()
            result = compute(self, kinematics, sample, pair)
            meter.distance += time.process_time() - began
            meter.pairs += len(pair)
            return result

        return call

    def solver(*arguments: Any) -> Any:
        began = time.process_time()
        solution = true_solver(*arguments)
        meter.solve += time.process_time() - began
        return solution

    true_evaluate, true_solver = Problem.evaluate, SOLVERS["gauss_newton"].solve
    with (
        patch.dict(SOLVERS, gauss_newton=Solver(solver)),
        patch.object(Problem, "evaluate", evaluate),
        patch.object(HdsdfPairs, "__call__", timed(HdsdfPairs.__call__)),
        patch.object(FclPairs, "__call__", timed(FclPairs.__call__)),
    ):
        yield meter


def run(group: str, name: str, scene: Scene, variant: str, time_limit: float) -> Run:
    """Plan one problem with one penalty. Raises InputError for ends in collision."""
    steps: dict[int, list[Iteration]] = {}

    def note(event: Event) -> None:
        if event.step:
            steps.setdefault(event.attempt, []).append(event.step)

    with metered() as meter:
        result = hdplan.plan(varied(scene, variant), time_limit=time_limit, report=note)
    clearance = result.certificate.clearance
    proven = np.nan if clearance is None or not result.certified else clearance
    shape, attempts = measure(result.trajectory.positions), tuple(map(tuple, steps.values()))
    return Run(group, name, variant, result.certified, result.attempts, meter, shape, proven, attempts)


def line(r: Run) -> str:
    """One line for a person."""
    steps = f"{r.attempts} attempt(s), {r.iterations} iterations, {r.refused} of them refused"
    figures = f"{1e3 * r.meter.solve:.0f} ms, length {r.shape.length:.2f} rad, {1e3 * r.clearance:.1f} mm"
    return f"{r.group} {r.problem} {r.variant}: {'' if r.certified else 'not '}certified, {steps}, {figures}"


# --- tables -----------------------------------------------------------------------------------------------------------


INSIDE = "in the evaluation"  # compiled as a whole, so that no call of the distance can be timed


def effort(runs: list[Run]) -> str:
    """Markdown: what it took, over all problems."""
    rows = []
    for group in dict.fromkeys(r.group for r in runs):
        for variant in VARIANTS:
            some = [r for r in runs if (r.group, r.variant) == (group, variant)]
            iterations, evaluations = sum(r.iterations for r in some), sum(r.meter.evaluations for r in some)
            pairs = sum(r.meter.pairs for r in some)
            row = {
                "problems": group,
                "penalty": variant,
                "certified": f"{sum(r.certified for r in some)} of {len(some)}",
                "with the first guess": sum(r.certified and r.attempts == 1 for r in some),
                "attempts mean": f"{np.mean([r.attempts for r in some]):.2f}",
                "iterations median / p95": quantiles([r.iterations for r in some]),
                "refused": f"{100 * sum(r.refused for r in some) / iterations:.0f} %",
                "evaluations median": f"{np.median([r.meter.evaluations for r in some]):.0f}",
                "solve median / p95 [ms]": milliseconds([r.meter.solve for r in some]),
                "evaluation [ms]": 1e3 * sum(r.meter.evaluate for r in some) / evaluations,
                "distance of a pair [µs]": 1e6 * sum(r.meter.distance for r in some) / pairs if pairs else INSIDE,
            }
            rows.append(row)
    return markdown_text(rows)


def motions(runs: list[Run]) -> str:
    """Markdown: medians over the problems that all certify."""
    rows = []
    for group in dict.fromkeys(r.group for r in runs):
        good = [{r.problem for r in runs if (r.group, r.variant) == (group, v) and r.certified} for v in VARIANTS]
        shared = set.intersection(*good)
        for variant in VARIANTS:
            some = [r for r in runs if (r.group, r.variant) == (group, variant) and r.problem in shared]
            if not some:
                continue
            clearance = [1e3 * r.clearance for r in some if np.isfinite(r.clearance)] or [np.nan]
            row = {
                "certified by all": f"{len(shared)} of {group}",
                "penalty": variant,
                "last weight [1/m²]": f"{np.median([r.steps[-1][-1].weight for r in some]):.1e}",
                "length [rad]": float(np.median([r.shape.length for r in some])),
                "∫ acceleration² [rad²]": float(np.median([r.shape.acceleration for r in some])),
                "∫ jerk² [rad²]": f"{np.median([r.shape.jerk for r in some]):.3g}",
                "proven clearance 5 % / median [mm]": quantiles(clearance, (0.05, 0.5), 1),
            }
            rows.append(row)
    return markdown_text(rows)


# --- command line -----------------------------------------------------------------------------------------------------


def main() -> None:
    """Run the comparison from the command line."""
    parser = problem_parser(__doc__)
    parser.add_argument("--picture", type=Path, help="where to draw the cost against the iteration")
    options = parser.parse_args()
    runs: list[Run] = []
    timed: list[penalty_pairs.PairTimes] = []
    warm: set[str] = set()
    with threadpool_limits(1):
        robots = options.robot or ("panda", "ur5")
        for group, name, load in mixed_problems(options.folder, options.every, robots, options.set):
            scene = load()
            try:
                if scene.robot.name not in warm:  # fits and compiles what is not in the cache
                    for variant in VARIANTS:
                        run(group, name, scene, variant, options.time_limit)
                    warm.add(scene.robot.name or "")
                found = [run(group, name, scene, variant, options.time_limit) for variant in VARIANTS]
            except hdplan.InputError as error:
                print(f"{group} {name}: left out, {error}", file=sys.stderr)
                continue
            runs += found
            print(*map(line, found), sep="\n", file=sys.stderr)
            if group != SHIPPED:
                timed += penalty_pairs.measure(*(hdplan.build(varied(scene, name)) for name in ("hdsdf", "fcl")))
        faces = penalty_faces.table()
    if not runs:
        sys.exit(f"no problems found below {options.folder}")
    print(effort(runs), motions(runs), penalty_pairs.table(timed), faces, sep="\n")
    if options.picture:
        benchmark = [r for r in runs if r.group != SHIPPED]
        attempts = {v: [r.steps for r in benchmark if r.variant == v] for v in VARIANTS}
        certified = {v: [r.certified for r in benchmark if r.variant == v] for v in VARIANTS}
        penalty_picture.draw(attempts, certified, penalty_faces.tilted(), options.picture)


if __name__ == "__main__":
    main()
