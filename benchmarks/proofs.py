"""Write and check proofs of motions through the problems of MotionBenchMaker.

    python benchmarks/proofs.py DIR [--robot NAME ...] [--set cage ...] [--every K] [--time-limit S]

DIR as in benchmarks/mbm.py. Every problem is planned with the command's defaults, and the proof of each certified
motion is written and checked, about the benchmark's own files. Prints a table with a
row per robot; to the error stream, a line per problem. All times are of the processor: that to certify is one call for
a scene that is set up already; those to write, less that call, and to check include reading scene, robot and meshes.
Of writing, a part is the checker's: it reads the files again, makes its own world of them, compares, and checks each
leaf that is written. "At hand":
written of a plan of this process, as `hdplan plan --proof` does, which neither reads nor certifies again.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from problems import RealProblem, problem_parser, real_problems

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.proof.proof import prove_planned
from hdplan.planner.robot.setup import Setup
from hdplan.planner.studies.report import markdown_text
from hdplan.verify import RejectedError
from hdplan.verify.checking import check


@dataclass(frozen=True)
class Outcome:
    """One problem."""

    robot: str
    problem: str
    status: str  # "accepted", or why there is no whole proof
    size: int = 0  # [bytes]
    leaves: int = 0
    certify: float = np.nan  # [s]
    write: float = np.nan
    checker: float = np.nan  # of it
    at_hand: float = np.nan
    at_hand_checker: float = np.nan  # of it
    verify: float = np.nan
    short: float = np.nan  # [m] by which less is proven than by the certificate


def run(problem: RealProblem, folder: Path, time_limit: float) -> Outcome:
    """Plan, prove and verify one problem."""
    name = f"{problem.set} {problem.number}"
    try:
        result = hdplan.plan(problem.load(), time_limit=time_limit)
    except hdplan.UnsolvableError as error:  # an end is in contact
        return Outcome(problem.robot, name, f"not planned: {error}")
    if not result.certified:
        return Outcome(problem.robot, name, f"not certified: {result.certificate.text}")
    scene, motion, beside = problem.scene_file, folder / "motion.json", problem.beside
    result.save(motion)
    certifier = Certifier(Setup.of(problem.load()))
    certified = time.process_time()
    certifier.certify(result.trajectory)
    began = time.process_time()
    try:
        proof = hdplan.prove(scene, motion, *beside)
    except hdplan.HdplanError as error:
        return Outcome(problem.robot, name, str(error))
    written = time.process_time()
    at_hand = prove_planned(result, scene, motion, *beside)
    again = time.process_time()
    try:
        verdict, _ = check(scene, motion, proof.data, *beside)
    except RejectedError as error:
        return Outcome(problem.robot, name, f"REJECTED: {error}")
    verified = time.process_time()
    least = float(verdict.text.partition("at least ")[2].partition(" ")[0]) / 1e3
    certificate = proof.certificate
    return Outcome(
        problem.robot,
        name,
        "accepted" if verdict.whole else verdict.text.splitlines()[0],
        len(proof.data),
        proof.leaves,
        began - certified,
        written - began - (began - certified),
        proof.checking,
        again - written,
        at_hand.checking,
        verified - again,
        np.nan if certificate.clearance is None else certificate.clearance - least,
    )


def table(outcomes: list[Outcome]) -> str:
    """Markdown: one row per robot."""
    rows = []
    for robot in dict.fromkeys(outcome.robot for outcome in outcomes):
        group = [outcome for outcome in outcomes if outcome.robot == robot]
        good = [outcome for outcome in group if outcome.status == "accepted"]
        rows.append(
            {
                "robot": robot,
                "problems": len(group),
                "accepted": len(good),
                "size median / worst [kB]": _spread([outcome.size / 1e3 for outcome in good]),
                "leaves median / worst": _spread([float(outcome.leaves) for outcome in good], 0),
                "certify median / worst [s]": _spread([outcome.certify for outcome in good], 3),
                "write median / worst [s]": _spread([outcome.write for outcome in good], 3),
                "write / certify median / worst": _spread([outcome.write / outcome.certify for outcome in good], 1),
                "without the checker's part": _spread(
                    [(outcome.write - outcome.checker) / outcome.certify for outcome in good], 1
                ),
                "of a plan at hand": _spread([outcome.at_hand / outcome.certify for outcome in good], 1),
                "at hand, without the checker's part": _spread(
                    [(outcome.at_hand - outcome.at_hand_checker) / outcome.certify for outcome in good], 1
                ),
                "verify median / worst [s]": _spread([outcome.verify for outcome in good], 2),
                "below the certificate median / worst [mm]": _spread([1e3 * outcome.short for outcome in good], 2),
            }
        )
    return markdown_text(rows)


def _spread(values: list[float], digits: int = 1) -> str:
    return f"{np.median(values):.{digits}f} / {max(values):.{digits}f}" if values else ""


def main() -> None:
    """Run the benchmark from the command line."""
    options = problem_parser(__doc__).parse_args()
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        for robot in options.robot or ("panda", "ur5"):
            for problem in real_problems(options.folder, robot, options.every, options.set):
                outcomes.append(run(problem, Path(folder), options.time_limit))
                print(outcomes[-1], file=sys.stderr)
    if not outcomes:
        sys.exit(f"no problems found below {options.folder}")
    print(table(outcomes))


if __name__ == "__main__":
    main()
