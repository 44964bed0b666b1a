"""hdplan beside its peers: the same problems, link hulls, machine and run, each path judged by the same certificate.

    python benchmarks/peers.py DIR [--robot panda|ur5] [--set cage ...] [--every K] [--goals joints|pose]
    [--planner NAME ...] [--time-limit S] [--proofs]

DIR holds MotionBenchMaker's problems as `mbm` takes them. Prints a table of all planners over all problems; to the
error stream, a line per problem and planner, and what is proven by set. The peers need

    pip install -e '.[peers]' roboplan hpp-python hpp-manipulation 'tesseract-robotics-nanobind==0.35.0.3'

(later wheels of the last need a C++ runtime of 2023); without some of them choose by --planner those that are there.

Planners (PLANNERS has their words), all on one core, from the same start to the same goal, each within its time limit,
are described in `peer_drake`, `peer_trajopt`, `peer_ompl`, `peer_roboplan` and `peer_hpp`; those that take a pose of
the hand for a goal plan to it with `--goals pose`. hdplan has its default settings and seed 0, and claims a motion only
with a certificate, whose time is in its own, as is that of the timing. TrajOpt's casts 0.05 or 0.02 rad apart prove no
more and take many times as long; OMPL's own resolution is 1 % of the space's extent, 0.14 rad for Panda; its AORRTC
shortens its path as long as it may.

The peers get the convex hulls of the links' and the obstacles' pieces and the pairs that the certificate compares, and
where they know a margin they keep 5 mm, or half of what the ends keep where that is less. (UR5's forearm is not convex:
where an end touches its hull, a few problems of a hundred, no peer can start.) Everything is judged by hdplan's
continuous certificate against the real meshes: "claimed" is the planner's word, "proven" the certificate's. hdplan's
own motions have no other judge here; `mbm` has them re-checked by independent code. What is proven is then timed within
the limits of `quality` by hdplan's own retiming (`Task.timed`), in time that is not counted, and certified again:
"timed" is how many are; a polyline's corners take most of its time. Means and medians of different problems do not
compare, so length and time are also given as shares of what hdplan's motions have on the problems that both solved.
Time is the processor's, since others may use the machine, from a planner's knowing robot and obstacles to its path;
what comes before, once the hulls are there, is set-up, which counts for hdplan alone. All are run once before. Length
and smoothness as in `peer_task.measure`.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from cells import milliseconds
from peer_task import Answer, Shape, Task, measure
from problems import HANDS, problem_parser, real_problems
from proven import proven
from threadpoolctl import threadpool_limits

import hdplan
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.studies.report import markdown_text

SEED = 1  # OMPL takes no 0
FINE = 0.02  # [rad] joint-space step at which an edge is checked
DISCRETE, BY_BOUNDS = {"validation": "Discretized", "tolerance": 0.05}, {"validation": "Dichotomy", "tolerance": 0.0}
WARM_UP = 1.0  # [s] time limit of the run that is not measured

Planner = Callable[[Task, float], Answer]  # of the task and the time limit [s]


def hdplan_planner(task: Task, time_limit: float) -> Answer:
    began = time.process_time()
    result = hdplan.plan(task.timed_scene, robot=task.robot, time_limit=time_limit)
    motion = result.trajectory if result.certified else None
    return Answer(None if motion is None else motion.positions, 0.0, time.process_time() - began, motion)


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


def apart(script: str, keeps_margin: bool = False, **options: object) -> Planner:
    peer = importlib.import_module("peer_process").Peer(script)

    def run(task: Task, time_limit: float) -> Answer:
        margin = {"margin": task.margin if keeps_margin else 0.0}
        answer: Answer = peer.plan(task, time_limit, **margin, **options)
        return answer

    return run


TRAJOPT = partial(apart, "peer_trajopt.py", segment=0.1)
ROBOPLAN, HPP = partial(apart, "peer_roboplan.py"), partial(apart, "peer_hpp.py")
PLANNERS: dict[str, tuple[str, Callable[[], Planner]]] = {  # with their words in the table
    "hdplan": ("hdplan, timing and proofs included", lambda: hdplan_planner),
    "drake-25": ("Drake, 25 collision samples", partial(drake, 25)),
    "drake-100": ("Drake, 100 collision samples", partial(drake, 100)),
    "trajopt": ("TrajOpt (Tesseract), casts every 0.1 rad, no margin", TRAJOPT),
    "trajopt-5mm": ("TrajOpt (Tesseract), casts every 0.1 rad, 5 mm kept", partial(TRAJOPT, keeps_margin=True)),
    "rrtconnect": (f"OMPL RRTConnect, checked every {FINE:g} rad, 5 mm kept", partial(ompl, "RRTConnect")),
    "rrtconnect-1%": (
        "OMPL RRTConnect, OMPL's own resolution, no margin",
        partial(ompl, "RRTConnect", as_it_comes=True),
    ),
    "aorrtc-1s": ("OMPL AORRTC, 1 s", partial(ompl, "AORRTC", most_seconds=1.0)),
    "aorrtc": ("OMPL AORRTC, to the time limit", partial(ompl, "AORRTC")),
    "roboplan": ("roboplan RRT-Connect, its own resolution (0.05 rad), no margin", partial(ROBOPLAN, step=0.05)),
    "roboplan-fine": ("roboplan RRT-Connect, checked every 0.01 rad, no margin", partial(ROBOPLAN, step=0.01)),
    "hpp": ("HPP bidirectional RRT, checked every 0.05 rad, no margin", partial(HPP, **DISCRETE)),
    "hpp-proven": ("HPP bidirectional RRT, edges proven by itself", partial(HPP, **BY_BOUNDS)),
}
TO_POSES = ("hdplan", "trajopt", "trajopt-5mm", "roboplan", "roboplan-fine")


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
    setup: float  # [s] as in Answer
    seconds: float  # [s] likewise
    shape: Shape | None  # of a claimed path
    clearance: float  # [m] proven, robot to obstacles; NaN without proof
    motion: float  # [s] of the certified motion within the limits; NaN without any
    accepted: bool = False  # whether the path, as it came, has a proof that `hdplan.verify` accepts


def accepted(task: Task, path: Trajectory) -> bool:
    """Write the proof of a certified path, and let the checker read it."""
    with tempfile.TemporaryDirectory() as folder:
        scene, motion = Path(folder) / "scene.yaml", Path(folder) / "motion.json"
        task.scene.save(scene)
        path.save(motion)
        words = proven(scene, motion)
    print(f"proof: {words}", file=sys.stderr)
    return words == "accepted"


def run(
    name: str, planner: Planner, task: Task, where: tuple[str, str, str], time_limit: float, proofs: bool = False
) -> Outcome:
    """Plan, judge and time; with `proofs`, write and check one of each certified path."""
    try:
        answer = planner(task, time_limit)
    except (RuntimeError, hdplan.InputError) as error:
        return Outcome(name, *where, False, False, f"refused: {error}", np.nan, np.nan, None, np.nan, np.nan)
    took = (answer.setup, answer.seconds)
    if answer.path is None:
        return Outcome(name, *where, False, False, "no solution", *took, None, np.nan, np.nan)
    path = Trajectory(task.robot.joint_names, answer.path, task.robot.locked)
    if answer.motion is not None:
        motion: hdplan.Trajectory | None = answer.motion
        certificate = task.timed_certifier.certify(answer.motion)
    else:
        certificate = task.certifier.certify(path)
        motion = task.timed(answer.path) if certificate.certified else None
    duration = motion.duration if motion is not None and certificate.certified else None
    clearance = np.nan if certificate.clearance is None else certificate.clearance
    seconds = np.nan if duration is None else duration
    verdict, proof = (
        (certificate.certified, certificate.text),
        proofs and certificate.certified and accepted(task, path),
    )
    return Outcome(name, *where, True, *verdict, *took, measure(answer.path), clearance, seconds, proof)


def line(o: Outcome) -> str:
    """One line for a person."""
    shape = f", length {o.shape.length:.2f} rad, motion {o.motion:.2f} s" if o.shape else ""
    return f"{o.robot} {o.set} {o.problem} {o.planner}: {o.seconds:.3f} s{shape}, {o.verdict}"


# --- tables -----------------------------------------------------------------------------------------------------------


def overview(outcomes: list[Outcome], proofs: bool = False) -> str:
    """Markdown: all planners over all problems; path measures are medians over what is proven."""
    rows = []
    ours = {(o.robot, o.set, o.problem): o for o in outcomes if o.planner == "hdplan" and o.proven}
    several = len({o.robot for o in outcomes}) > 1
    for (robot, planner), group in _grouped(outcomes, lambda o: (o.robot, o.planner)).items():
        seconds = [o.seconds for o in group if np.isfinite(o.seconds)]
        good = [o for o in group if o.proven]
        pairs = [(o, ours[where]) for o in good if (where := (o.robot, o.set, o.problem)) in ours]
        shapes = [o.shape for o in good if o.shape]
        lengths = [(a.shape.length, b.shape.length) for a, b in pairs if a.shape and b.shape]
        row = {
            **({"robot": robot} if several else {}),
            "planner": PLANNERS[planner][0],
            "claimed": f"{sum(o.claimed for o in group)} of {len(group)}",
            "proven": len(good),
            **({"accepted": sum(o.accepted for o in good)} if proofs else {}),
            "timed": sum(np.isfinite(o.motion) for o in good),
            "planning median / p95 [ms]": milliseconds(seconds),
            "length [rad]": _median([s.length for s in shapes], ".2f"),
            "length / hdplan's [%]": _share(lengths),
            "motion time [s]": _median([o.motion for o in good if np.isfinite(o.motion)], ".2f"),
            "motion time / hdplan's [%]": _share([(a.motion, b.motion) for a, b in pairs if np.isfinite(a.motion)]),
            "∫ acceleration² [rad²]": _median([s.acceleration for s in shapes], ",.0f"),
            "proven clearance median [mm]": _median([1e3 * o.clearance for o in good], ".1f"),
        }
        rows.append(row)
    return markdown_text(rows)


def _share(pairs: list[tuple[float, float]]) -> str | None:
    """Return the sum of a peer's figures over that of hdplan's, in percent; None without any."""
    if not pairs:
        return None
    theirs, own = np.sum(pairs, axis=0)
    return f"{100.0 * theirs / own:.0f}"


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


def _grouped(
    outcomes: list[Outcome], key: Callable[[Outcome], tuple[str, ...]]
) -> dict[tuple[str, ...], list[Outcome]]:
    groups: dict[tuple[str, ...], list[Outcome]] = {}
    for outcome in outcomes:
        groups.setdefault(key(outcome), []).append(outcome)
    return groups


def _median(values: list[float], form: str) -> str | None:
    return format(float(np.median(values)), form) if values else None


# --- command line -----------------------------------------------------------------------------------------------------


def available(names: Sequence[str]) -> dict[str, Planner]:
    """Return the planners, or end where the package of one is missing."""
    found = {}
    for name in names:
        try:
            found[name] = PLANNERS[name][1]()
        except ImportError as error:
            sys.exit(f"{name}: {error} (see --help for what to install, or choose others by --planner)")
    return found


def main() -> None:
    """Run the comparison from the command line."""
    parser = problem_parser(__doc__, time_limit=10.0)
    parser.add_argument("--goals", choices=("joints", "pose"), default="joints")
    parser.add_argument("--planner", nargs="*", choices=tuple(PLANNERS), help="all that can, without it")
    parser.add_argument("--proofs", action="store_true", help="write and check a proof of every certified path")
    options = parser.parse_args()
    able = TO_POSES if options.goals == "pose" else tuple(PLANNERS)
    chosen = able if options.planner is None else options.planner
    if unable := set(chosen).difference(able):
        parser.error(f"to poses plan {', '.join(able)}; not {', '.join(sorted(unable))}")
    planners = available(chosen)
    outcomes: list[Outcome] = []
    with threadpool_limits(1):
        for robot in options.robot or ["panda"]:
            problems = real_problems(options.folder, robot, options.every, options.set)
            hand = HANDS[robot] if options.goals == "pose" else None
            for problem in problems[:1]:
                for name, planner in planners.items():
                    run(name, planner, Task.of(problem.load(), hand), (robot, "", ""), WARM_UP)
            for problem in problems:
                task, where = Task.of(problem.load(), hand), (robot, problem.set, problem.number)
                for name, planner in planners.items():
                    outcomes.append(run(name, planner, task, where, options.time_limit, options.proofs))
                    print(line(outcomes[-1]), file=sys.stderr)
    if not outcomes:
        sys.exit(f"no problems found below {options.folder}")
    print(by_set(outcomes), file=sys.stderr)
    print(overview(outcomes, options.proofs))


if __name__ == "__main__":
    main()
