"""Plan problems in narrow places with other bodies, distances, guesses, solvers and rounds of polish, one at a time.

    python benchmarks/narrow_steps.py DIR [--set cage ...] [--every K] [--from J] [--time-limit S] [--give-up N]
        [--processor-time]

DIR is that of `narrow.py`; the set `fetch_cage` are MotionBenchMaker's cages for Fetch, the slowest of its problems,
from mbm/ beside DIR. Prints, for each set, a row per setting: of the problems with free ends how many are certified by
1, 4 and 16 guesses and by any number, and the processor time of those plans; to the error stream, a line per plan.
With another distance than the HD-SDF the search has neither its exact distances nor its trees.
A setting that certifies none of the first --give-up problems of a set gets no more of them, as its row says.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import yaml
from narrow import SCENE, SETS, scenes
from problems import real_problems
from processor_time import add_processor_time, set_clock

import hdplan
from hdplan.planner.search import guesses
from hdplan.planner.studies.report import Cell, markdown_text

STEPS: dict[str, dict[str, Any]] = {  # words: settings of the planner, and the solver; what the search leaves out
    "defaults": {},
    "no trees": {"without": "trees"},
    "no trees, no exact distance": {"without": "exact distance"},
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
WITHOUT: dict[str, tuple[str, Callable[..., Any]]] = {  # a name in the order of guesses, and what stands in its place
    "trees": ("tree_ways", lambda *_: iter(())),
    "exact distance": ("exactly", lambda problem: problem),  # nor do trees grow then
}
GUESSES = (1, 4, 16)
FETCH_CAGE = "fetch_cage"
WARM_UP = 0.5  # [s] of a plan that is not counted, in which the bodies of a setting are fitted


@dataclass(frozen=True)
class Outcome:
    """One plan."""

    set: str
    step: str
    certified: bool
    guesses: int
    seconds: float  # of a processor


def problems(folder: Path, kind: str, every: int, first: int, scratch: Path) -> Iterator[hdplan.Scene]:
    """Yield the scene of every K-th problem of a set, from the J-th."""
    if kind == FETCH_CAGE:
        for problem in real_problems(folder.parent / "mbm", "fetch", sets=("cage",))[first::every]:
            yield problem.load()
        return
    for _, content in scenes(folder, kind, every, first):
        file = scratch / SCENE
        file.write_text(yaml.safe_dump(content, sort_keys=False))
        yield hdplan.load_scene(file)


def run(kind: str, step: str, scene: hdplan.Scene, time_limit: float) -> Outcome | None:
    """Plan with the settings of a step; None where an end is not free."""
    settings = dict(STEPS[step])
    solver, without = settings.pop("solver", "gauss_newton"), settings.pop("without", None)
    scene = replace(scene, planner=replace(scene.planner, **settings))
    began = time.process_time()
    try:
        with mock.patch.object(guesses, *WITHOUT[without]) if without else contextlib.nullcontext():
            found = hdplan.plan(scene, solver=solver, time_limit=time_limit)
    except hdplan.UnsolvableError:
        return None
    return Outcome(kind, step, found.certified, found.attempts, time.process_time() - began)


def planned(options: argparse.Namespace, scratch: Path) -> Iterator[Outcome]:
    """Yield a plan of every problem with every setting."""
    for kind in options.set:
        by_step: dict[str, list[bool]] = {step: [] for step in STEPS}  # of each plan whether it was certified
        warm: set[str] = set()
        for scene in problems(options.folder.absolute(), kind, options.every, options.first, scratch):
            for step, certified in by_step.items():
                if len(certified) >= options.give_up and not any(certified):
                    continue
                if step not in warm:  # the first reads and computes all that settings share, in a plan not counted
                    run(kind, step, scene, WARM_UP if warm else options.time_limit)
                    warm.add(step)
                outcome = run(kind, step, scene, options.time_limit)
                if outcome is None:
                    break  # with other settings the end is no freer
                certified.append(outcome.certified)
                yield outcome


def table(outcomes: list[Outcome]) -> str:
    """Markdown: one row per set and step."""
    rows: list[dict[str, Cell]] = []
    for kind, step in itertools.product(dict.fromkeys(each.set for each in outcomes), STEPS):
        group = [each for each in outcomes if (each.set, each.step) == (kind, step)]
        if not group:
            continue
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
    parser.add_argument(
        "--give-up", type=int, default=math.inf, metavar="N", help="problems of a set without any proof"
    )
    add_processor_time(parser)
    options = parser.parse_args()
    set_clock(options)
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        for outcome in planned(options, Path(scratch)):
            print(outcome, file=sys.stderr, flush=True)
            found.append(outcome)
    print(table(found))


if __name__ == "__main__":
    main()
