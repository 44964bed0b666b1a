"""hdplan beside its peers: the same problems, link hulls, machine and run, each path judged by the same certificate.

    python benchmarks/peers.py DIR [--robot panda|ur5] [--set cage ...] [--every K] [--planner NAME ...]
    [--time-limit S] [--csv F]

DIR holds MotionBenchMaker's problems as `mbm` takes them. The peers need `pip install -e '.[peers]'`; without it choose
by --planner those that are there. Prints a table of all planners over all problems; to the error stream, a line per
problem and planner, each peer beside hdplan on what both proved, and what is proven by set.

Planners, all on one core, from the same start to the same goal, each within its time limit:

    hdplan         default settings, seed 0; claims a motion only with a certificate, whose time is in its own
    drake-25/-100  KinematicTrajectoryOptimization, collisions looked at in 25 or 100 samples: see `peer_drake`
    rrtconnect     OMPL's RRTConnect and path simplification, edges checked every 0.02 rad: see `peer_ompl`
    rrtconnect-1%  the same as OMPL comes: edges checked every 1 % of the space's extent (0.14 rad for Panda), no margin
    aorrtc-1s, aorrtc  OMPL's AORRTC, which shortens its path as long as it may: for 1 s, or to the time limit

The peers get the convex hulls of the links' and the obstacles' pieces and the pairs that the certificate compares, and
keep 5 mm, or half of what the ends keep where that is less. (UR5's forearm is not convex: where an end touches its
hull, a few problems of a hundred, no peer can start.) Everything is judged by hdplan's continuous certificate against
the real meshes: "claimed" is the planner's word, "proven" the certificate's. hdplan's own paths have no other judge
here; `mbm` has them re-checked by independent code. Time is wall-clock, from a planner's knowing robot and obstacles to
its path; what comes before, once the hulls are there, is set-up. All are run once before. Length and smoothness as in
`peer_task.measure`.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from peer_task import Answer, Shape, Task, measure
from problems import real_problems
from threadpoolctl import threadpool_limits

import hdplan
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.studies.report import Cell, markdown_text

SEED = 1  # OMPL takes no 0
FINE = 0.02  # [rad] joint-space step at which an edge is checked
WARM_UP = 1.0  # [s] time limit of the run that is not measured

Planner = Callable[[Task, float], Answer]  # of the task and the time limit [s]


def hdplan_planner(task: Task, time_limit: float) -> Answer:
    began = time.perf_counter()
    result = hdplan.plan(task.scene, robot=task.robot, time_limit=time_limit)
    total, times = time.perf_counter() - began, result.times
    setup = times.load + times.build + times.compile
    return Answer(result.trajectory.positions if result.certified else None, setup, total - setup)


def drake(samples: int) -> Planner:
    solve = importlib.import_module("peer_drake").solve
    return lambda task, time_limit: solve(task, samples, time_limit)


def ompl(name: str, most_seconds: float = np.inf, as_it_comes: bool = False) -> Planner:
    solve = importlib.import_module("peer_ompl").solve

    def run(task: Task, time_limit: float) -> Answer:
        step, margin = (None, 0.0) if as_it_comes else (FINE, task.margin)
        answer: Answer = solve(task, name, step, margin, SEED, min(time_limit, most_seconds))
        return answer

    return run


WORDS = {  # in the table
    "hdplan": "hdplan, proofs included",
    "drake-25": "Drake, 25 collision samples",
    "drake-100": "Drake, 100 collision samples",
    "rrtconnect": f"OMPL RRTConnect, checked every {FINE:g} rad, 5 mm kept",
    "rrtconnect-1%": "OMPL RRTConnect, OMPL's own resolution, no margin",
    "aorrtc-1s": "OMPL AORRTC, 1 s",
    "aorrtc": "OMPL AORRTC, to the time limit",
}
PLANNERS: dict[str, Callable[[], Planner]] = {
    "hdplan": lambda: hdplan_planner,
    "drake-25": lambda: drake(25),
    "drake-100": lambda: drake(100),
    "rrtconnect": lambda: ompl("RRTConnect"),
    "rrtconnect-1%": lambda: ompl("RRTConnect", as_it_comes=True),
    "aorrtc-1s": lambda: ompl("AORRTC", most_seconds=1.0),
    "aorrtc": lambda: ompl("AORRTC"),
}


@dataclass(frozen=True)
class Outcome:
    """One planner on one problem."""

    planner: str
    robot: str
    set: str
    problem: str
    claimed: bool
    proven: bool
    verdict: str  # certificate's text, or why there is no path
    setup: float  # [s]
    seconds: float  # [s]
    shape: Shape | None  # of a claimed path
    clearance: float  # [m] proven, robot to obstacles; NaN without proof


def run(name: str, planner: Planner, task: Task, where: tuple[str, str, str], time_limit: float) -> Outcome:
    """Plan and judge."""
    try:
        answer = planner(task, time_limit)
    except (RuntimeError, hdplan.InputError) as error:
        return Outcome(name, *where, False, False, f"refused: {error}", np.nan, np.nan, None, np.nan)
    if answer.path is None:
        return Outcome(name, *where, False, False, "no solution", answer.setup, answer.seconds, None, np.nan)
    certificate = task.certifier.certify(Trajectory(task.robot.joint_names, answer.path))
    return Outcome(
        name,
        *where,
        True,
        certificate.certified,
        certificate.text,
        answer.setup,
        answer.seconds,
        measure(answer.path),
        np.nan if certificate.clearance is None else certificate.clearance,
    )


def line(o: Outcome) -> str:
    """One line for a person."""
    shape = f", length {o.shape.length:.2f} rad" if o.shape else ""
    return f"{o.robot} {o.set} {o.problem} {o.planner}: {o.seconds:.3f} s{shape}, {o.verdict}"


# --- tables -----------------------------------------------------------------------------------------------------------


def overview(outcomes: list[Outcome]) -> str:
    """Markdown: all planners over all problems; path measures are medians over what is proven."""
    rows = []
    for (robot, planner), group in _grouped(outcomes, lambda o: (o.robot, o.planner)).items():
        seconds = [o.seconds for o in group if np.isfinite(o.seconds)]
        proven = [o for o in group if o.proven]
        clearances = [1e3 * o.clearance for o in proven]
        rows.append(
            {
                "robot": robot,
                "planner": WORDS[planner],
                "claimed": f"{sum(o.claimed for o in group)} of {len(group)}",
                "proven": len(proven),
                "time median / p95 [s]": f"{_quantile(seconds, 0.5):.2g} / {_quantile(seconds, 0.95):.2g}",
                **_shapes(proven),
                "proven clearance 5 % / median [mm]": (
                    f"{_quantile(clearances, 0.05):.1f} / {_quantile(clearances, 0.5):.1f}"
                ),
            }
        )
    return markdown_text(rows)


def side_by_side(outcomes: list[Outcome]) -> str:
    """Medians over the problems that both a peer and hdplan proved, so that the two rows of a pair compare;
    empty without such a problem."""
    rows: list[dict[str, Cell]] = []
    proven = {(o.planner, o.robot, o.set, o.problem): o for o in outcomes if o.proven}
    for (robot, planner), group in _grouped(outcomes, lambda o: (o.robot, o.planner)).items():
        pairs = [(o, proven.get(("hdplan", o.robot, o.set, o.problem))) for o in group if o.proven]
        both = [(o, ours) for o, ours in pairs if ours is not None]
        if planner == "hdplan" or not both:
            continue
        for name, column in ((planner, [o for o, _ in both]), ("hdplan", [ours for _, ours in both])):
            clearance = 1e3 * _quantile([o.clearance for o in column], 0.5)
            rows.append(
                {
                    "proven by both": f"{robot} {planner}",
                    "problems": len(both),
                    "planner": name,
                    **_shapes(column),
                    "proven clearance [mm]": f"{clearance:.1f}",
                }
            )
    return markdown_text(rows) if rows else ""


def by_set(outcomes: list[Outcome]) -> str:
    """Proven (claimed) by each planner, set by set."""
    rows = []
    for (robot, name), group in _grouped(outcomes, lambda o: (o.robot, o.set)).items():
        cells = {
            planner: f"{sum(o.proven for o in g)} ({sum(o.claimed for o in g)})"
            for (planner,), g in _grouped(group, lambda o: (o.planner,)).items()
        }
        rows.append({"proven (claimed) of": f"{robot} {name}", "problems": len(group) // len(cells), **cells})
    return markdown_text(rows)


def _shapes(outcomes: list[Outcome]) -> dict[str, Cell]:
    """Medians."""
    shapes = [o.shape for o in outcomes if o.shape]
    return {
        "length [rad]": f"{_quantile([s.length for s in shapes], 0.5):.2f}",
        "∫ acceleration² [rad²]": f"{_quantile([s.acceleration for s in shapes], 0.5):.3g}",
        "∫ jerk² [rad²]": f"{_quantile([s.jerk for s in shapes], 0.5):.2g}",
    }


def _grouped(
    outcomes: list[Outcome], key: Callable[[Outcome], tuple[str, ...]]
) -> dict[tuple[str, ...], list[Outcome]]:
    groups: dict[tuple[str, ...], list[Outcome]] = {}
    for outcome in outcomes:
        groups.setdefault(key(outcome), []).append(outcome)
    return groups


def _quantile(values: list[float], share: float) -> float:
    return float(np.quantile(values, share)) if values else np.nan


# --- command line -----------------------------------------------------------------------------------------------------


def available(names: list[str]) -> dict[str, Planner]:
    """Return the planners, or end where the package of one is missing."""
    found = {}
    for name in names:
        try:
            found[name] = PLANNERS[name]()
        except ImportError as error:
            sys.exit(f"{name}: {error} (pip install -e '.[peers]', or choose others by --planner)")
    return found


def main() -> None:
    """Run the comparison from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", choices=("panda", "ur5"), action="append")
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--every", type=int, default=1, help="take every K-th problem of a set")
    parser.add_argument("--planner", nargs="*", choices=tuple(PLANNERS), default=list(PLANNERS))
    parser.add_argument("--time-limit", type=float, default=10.0, help="[s] for each planner on each problem")
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    planners = available(options.planner)
    outcomes: list[Outcome] = []
    with threadpool_limits(1):
        for robot in options.robot or ["panda"]:
            problems = real_problems(options.folder, robot, options.every, options.set)
            for problem in problems[:1]:
                for name, planner in planners.items():
                    run(name, planner, Task.of(problem.load()), (robot, "", ""), WARM_UP)
            for problem in problems:
                task, where = Task.of(problem.load()), (robot, problem.set, problem.number)
                for name, planner in planners.items():
                    outcomes.append(run(name, planner, task, where, options.time_limit))
                    print(line(outcomes[-1]), file=sys.stderr)
    if not outcomes:
        sys.exit(f"no problems found below {options.folder}")
    print(side_by_side(outcomes), by_set(outcomes), sep="\n", file=sys.stderr)
    print(overview(outcomes))
    if options.csv:
        _write(options.csv, outcomes)


def _write(file: Path, outcomes: list[Outcome]) -> None:
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        words = ("planner", "robot", "set", "problem", "claimed", "proven", "setup_s", "seconds")
        writer.writerow((*words, "length_rad", "acceleration", "jerk", "clearance_m", "verdict"))
        for o in outcomes:
            shape = (o.shape.length, o.shape.acceleration, o.shape.jerk) if o.shape else (np.nan,) * 3
            head = (o.planner, o.robot, o.set, o.problem, o.claimed, o.proven, o.setup, o.seconds)
            writer.writerow((*head, *shape, o.clearance, o.verdict))


if __name__ == "__main__":
    main()
