"""Plan the problems of MotionBenchMaker and re-check every certified motion by code that shares nothing with hdplan.

    python benchmarks/mbm.py DIR [--robot NAME ...] [--set cage ...] [--every K] [--time-limit S] [--no-recheck]

DIR holds panda/, ur5/, fetch/ and baxter/, each with a robot.yaml and one folder per set; without --robot, problems of
the first two. Prints a table with a row per set, and every problem that is not certified with its cause; to the error
stream, a line per problem. "Certified" is hdplan's own verdict, "refuted" what `recheck` (own kinematics, meshes by
trimesh, contacts by FCL at dense samples) finds wrong with it: it must be 0.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from cells import milliseconds, quantiles
from problems import RealProblem, problem_parser, real_problems
from recheck import recheck

import hdplan
from hdplan.planner.studies.report import markdown_text

PHASES = ("load", "build", "solve", "certify")


@dataclass(frozen=True)
class Outcome:
    """One problem."""

    problem: RealProblem
    status: str  # of the certificate, or "refused" for bad input
    clearance: float  # [m] proven; NaN without proof
    seconds: tuple[float, ...]  # by phase; load includes reading the files
    attempts: int
    recheck: str  # "free", "refuted: …" or "" if not done
    words: str  # certificate's text or the refusal


def run(problem: RealProblem, time_limit: float, check: bool) -> Outcome:
    """Plan one problem with the command's defaults, the reading of its files included."""
    began = time.perf_counter()
    try:
        scene = problem.load()
        read = time.perf_counter() - began
        result = hdplan.plan(scene, time_limit=time_limit)
    except hdplan.InputError as error:
        return Outcome(problem, "refused", np.nan, (0.0,) * len(PHASES), 0, "", str(error))
    times = result.times
    seconds = (read + times.load, times.build + times.compile, times.solve, times.certify)
    verdict = ""
    if check and result.certified:
        with tempfile.TemporaryDirectory() as temporary:
            file = Path(temporary) / "motion.json"
            result.save(file)
            found = recheck(file, problem.scene_file, problem.request_file, problem.robot_file)
        verdict = f"refuted: {found}" if found else "free"
    certificate = result.certificate
    clearance = np.nan if certificate.clearance is None else certificate.clearance
    rest = result.attempts, verdict, certificate.text
    return Outcome(problem, certificate.status.value, clearance, seconds, *rest)


def line(outcome: Outcome) -> str:
    """One line for a person."""
    phases = " ".join(f"{phase} {1e3 * s:.0f}" for phase, s in zip(PHASES, outcome.seconds, strict=True))
    words = "" if outcome.status == "certified" else f"  {outcome.words}"
    return (
        f"{outcome.problem.name}: {outcome.status}, {1e3 * outcome.clearance:.2f} mm, "
        f"{phases} ms, {outcome.attempts} attempt(s) {outcome.recheck}{words}"
    )


def table(outcomes: list[Outcome]) -> str:
    """Markdown: one row per set, one for each robot, and one for all."""
    groups: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        groups.setdefault(f"{outcome.problem.robot} {outcome.problem.set}", []).append(outcome)
    for robot in dict.fromkeys(outcome.problem.robot for outcome in outcomes):
        groups[f"**{robot}, all**"] = [outcome for outcome in outcomes if outcome.problem.robot == robot]
    groups["**all**"] = outcomes
    rows = []
    for name, group in groups.items():
        good = [outcome for outcome in group if outcome.status == "certified"]
        refuted = sum(outcome.recheck.startswith("refuted") for outcome in group)
        before, proof = ([sum(o.seconds[part]) for o in group] for part in (slice(3), slice(3, None)))
        row = {
            "robot, set": name,
            "problems": len(group),
            "certified": len(good),
            "refuted": refuted if any(outcome.recheck for outcome in group) else "not checked",
            "first guess": sum(outcome.attempts == 1 for outcome in good),
            "load + build + solve median / p95 / worst [ms]": milliseconds(before, (0.5, 0.95, 1.0)),
            "certificate median / p95 / worst [ms]": milliseconds(proof, (0.5, 0.95, 1.0)),
            "proven clearance 5 % / median [mm]": quantiles([1e3 * o.clearance for o in good], (0.05, 0.5), 1),
        }
        rows.append(row)
    return markdown_text(rows)


def failures(outcomes: list[Outcome]) -> str:
    """Markdown: why each problem without a certificate has none; or that there is none."""
    failed = [outcome for outcome in outcomes if outcome.status != "certified"]
    if not failed:
        return "Every problem is certified."
    return markdown_text([{"problem": o.problem.name, "cause": cause(o), "words": o.words} for o in failed])


def cause(outcome: Outcome) -> str:
    """Kind of a failure."""
    if outcome.status == "refused":
        known = {"in collision": "an end is in contact", "outside its limits": "an end is beyond a joint limit"}
        return next((words for sign, words in known.items() if sign in outcome.words), "bad input")
    if outcome.status == "not_proven":
        return "grazes a body: neither proven nor refuted"
    return f"local minimum: no free motion from {outcome.attempts} guesses within the time limit"


def main() -> None:
    """Run the benchmark from the command line."""
    parser = problem_parser(__doc__)
    parser.add_argument("--no-recheck", action="store_true")
    options = parser.parse_args()
    outcomes: list[Outcome] = []
    for robot in options.robot or ("panda", "ur5"):
        problems = real_problems(options.folder, robot, options.every, options.set)
        if not outcomes and problems:  # compile and fit once, so that all are measured warm
            run(problems[0], options.time_limit, check=False)
        for problem in problems:
            outcomes.append(run(problem, options.time_limit, not options.no_recheck))
            print(line(outcomes[-1]), file=sys.stderr)
    if not outcomes:
        sys.exit(f"no problems found below {options.folder}")
    print(table(outcomes), failures(outcomes), sep="\n")


if __name__ == "__main__":
    main()
