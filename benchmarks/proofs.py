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
from cells import quantiles
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
    try:
        result = hdplan.plan(problem.load(), time_limit=time_limit)
    except hdplan.UnsolvableError as error:  # an end is in contact
        return Outcome(problem.robot, f"not planned: {error}")
    if not result.certified:
        return Outcome(problem.robot, f"not certified: {result.certificate.text}")
    scene, motion, beside = problem.scene_file, folder / "motion.json", problem.beside
    result.save(motion)
    certifier = Certifier(Setup.of(problem.load()))
    certified = time.process_time()
    certifier.certify(result.trajectory)
    began = time.process_time()
    try:
        proof = hdplan.prove(scene, motion, *beside)
    except hdplan.HdplanError as error:
        return Outcome(problem.robot, str(error))
    written = time.process_time()
    at_hand = prove_planned(result, scene, motion, *beside)
    again = time.process_time()
    try:
        verdict, _ = check(scene, motion, proof.data, *beside)
    except RejectedError as error:
        return Outcome(problem.robot, f"REJECTED: {error}")
    verified = time.process_time()
    least = float(verdict.text.partition("at least ")[2].partition(" ")[0]) / 1e3
    status = "accepted" if verdict.whole else verdict.text.splitlines()[0]
    certify, clearance = began - certified, proof.certificate.clearance
    times = certify, written - began - certify, proof.checking, again - written, at_hand.checking, verified - again
    short = np.nan if clearance is None else clearance - least
    return Outcome(problem.robot, status, len(proof.data), proof.leaves, *times, short)


def table(outcomes: list[Outcome]) -> str:
    """Markdown: one row per robot."""
    rows = []
    for robot in dict.fromkeys(outcome.robot for outcome in outcomes):
        group = [outcome for outcome in outcomes if outcome.robot == robot]
        good = [outcome for outcome in group if outcome.status == "accepted"]
        columns: dict[str, tuple[int, list[float]]] = {  # digits and values
            "size median / worst [kB]": (1, [o.size / 1e3 for o in good]),
            "leaves median / worst": (0, [o.leaves for o in good]),
            "certify median / worst [s]": (3, [o.certify for o in good]),
            "write median / worst [s]": (3, [o.write for o in good]),
            "write / certify median / worst": (1, [o.write / o.certify for o in good]),
            "without the checker's part": (1, [(o.write - o.checker) / o.certify for o in good]),
            "of a plan at hand": (1, [o.at_hand / o.certify for o in good]),
            "at hand, without the checker's part": (1, [(o.at_hand - o.at_hand_checker) / o.certify for o in good]),
            "verify median / worst [s]": (2, [o.verify for o in good]),
            "below the certificate median / worst [mm]": (2, [1e3 * o.short for o in good]),
        }
        spreads = {words: quantiles(values, (0.5, 1.0), digits) for words, (digits, values) in columns.items()}
        rows.append({"robot": robot, "problems": len(group), "accepted": len(good), **spreads})
    return markdown_text(rows)


def main() -> None:
    """Run the benchmark from the command line."""
    options = problem_parser(__doc__).parse_args()
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        for robot in options.robot or ("panda", "ur5"):
            for problem in real_problems(options.folder, robot, options.every, options.set):
                outcomes.append(run(problem, Path(folder), options.time_limit))
                print(problem.name, outcomes[-1], file=sys.stderr)
    if not outcomes:
        sys.exit(f"no problems found below {options.folder}")
    print(table(outcomes))


if __name__ == "__main__":
    main()
