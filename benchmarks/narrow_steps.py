"""Plan problems in narrow places with other bodies, distances, solvers, guesses and rounds of polish, one at a time.

    python benchmarks/narrow_steps.py DIR [--set cage ...] [--every K] [--from J] [--time-limit S]

DIR is that of `narrow.py`; the set `fetch_cage` are MotionBenchMaker's cages for Fetch, the slowest of its problems,
from mbm/ beside DIR. Prints, for each set, a row per setting: of the problems with free ends how many are certified by
1, 4 and 16 guesses and by any number, and the processor time of those plans; to the error stream, a line per plan.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from narrow import SCENE, SETS, scenes
from problems import real_problems

import hdplan
from hdplan.planner.studies.report import Cell, markdown_text

STEPS: dict[str, dict[str, Any]] = {  # words: settings of the planner, and the solver
    "defaults": {},
    "capsules": {"link_bodies": "capsule"},
    "exact hulls": {"link_bodies": "hull"},
    "more normals": {"normals": "sphere"},
    "exact distance by FCL": {"distance": "fcl"},
    "exact hulls, exact distance by FCL": {"link_bodies": "hull", "distance": "fcl"},
    "chomp": {"solver": "chomp"},
    "fatrop": {"solver": "fatrop"},
    "no polish": {"polish": 0},
    "three rounds of polish": {"polish": 3},
}
GUESSES = (1, 4, 16)
FETCH_CAGE = "fetch_cage"


@dataclass(frozen=True)
class Outcome:
    """One plan."""

    set: str
    step: str
    number: str
    certified: bool
    guesses: int
    seconds: float  # of a processor


def problems(folder: Path, kind: str, every: int, first: int, scratch: Path) -> Iterator[tuple[str, hdplan.Scene]]:
    """Yield number and scene of every K-th problem of a set, from the J-th."""
    if kind == FETCH_CAGE:
        for problem in real_problems(folder.parent / "mbm", "fetch", sets=("cage",))[first::every]:
            yield problem.number, problem.load()
        return
    for number, said in scenes(folder, kind, every, first):
        file = scratch / SCENE
        file.write_text(yaml.safe_dump(said, sort_keys=False))
        yield number, hdplan.load_scene(file)


def run(kind: str, step: str, number: str, scene: hdplan.Scene, time_limit: float) -> Outcome | None:
    """Plan with the settings of a step; None where an end is not free."""
    settings = dict(STEPS[step])
    solver = settings.pop("solver", "gauss_newton")
    began = time.process_time()
    try:
        found = hdplan.plan(
            replace(scene, planner=replace(scene.planner, **settings)), solver=solver, time_limit=time_limit
        )
    except hdplan.UnsolvableError:
        return None
    return Outcome(kind, step, number, found.certified, found.attempts, time.process_time() - began)


def table(outcomes: list[Outcome]) -> str:
    """Markdown: one row per set and step."""
    rows: list[dict[str, Cell]] = []
    for kind, step in dict.fromkeys((each.set, each.step) for each in outcomes):
        group = [each for each in outcomes if (each.set, each.step) == (kind, step)]
        good = [each for each in group if each.certified]
        times = [each.seconds for each in good]
        row: dict[str, Cell] = {"set": kind, "setting": step, "certified": f"{len(good)} of {len(group)}"}
        for most in GUESSES:
            row[f"by {most} guess{'es' * (most > 1)}"] = sum(each.guesses <= most for each in good)
        row["time median / worst [s]"] = f"{np.median(times):.2f} / {max(times):.2f}" if times else ""
        rows.append(row)
    return markdown_text(rows)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--set", nargs="+", choices=(*SETS, FETCH_CAGE), default=(*SETS, FETCH_CAGE))
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--from", type=int, default=0, dest="first", help="the first problem of a set")
    parser.add_argument("--time-limit", type=float, default=10.0)
    options = parser.parse_args()
    outcomes = []
    with tempfile.TemporaryDirectory() as scratch:
        for kind in options.set:
            by_step: dict[str, list[Outcome]] = {step: [] for step in STEPS}
            folder = options.folder.absolute()
            for number, scene in problems(folder, kind, options.every, options.first, Path(scratch)):
                for step, found in by_step.items():
                    if not found:  # what is read and fitted once is not counted
                        run(kind, step, number, scene, options.time_limit)
                    if outcome := run(kind, step, number, scene, options.time_limit):
                        print(outcome, file=sys.stderr, flush=True)
                        found.append(outcome)
            outcomes += [each for found in by_step.values() for each in found]
    print(table(outcomes))


if __name__ == "__main__":
    main()
