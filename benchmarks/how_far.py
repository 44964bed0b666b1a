"""How far proofs reach: plan, prove and verify motions of every kind of problem, and count what is accepted.

    python benchmarks/how_far.py DIR [--group NAME ...] [--most N] [--time-limit S]

DIR as in benchmarks/mbm.py, with the narrow places of benchmarks/narrow.py beside it, in DIR/../opof. The problems: all
shipped scenes and jobs, all of MotionBenchMaker for Panda and UR5, a hundred each for Fetch and Baxter, and fifty of
each set of narrow places, or N of each at most, all evenly spread. Each is planned with the command's defaults; of the
motion's file a proof is written, and checked. Prints a row for each group, and what is lacking with how often; to the
error stream, a line per problem.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import narrow
import numpy as np
import yaml
from problems import real_problems
from proven import proven

import hdplan
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.yaml_format.reader import shipped_jobs, shipped_scenes

MANY = {"panda": 350, "ur5": 350, "fetch": 100, "baxter": 100}  # at most, of MotionBenchMaker
NARROW, WHOLE = 50, 500  # problems of a set in narrow places: that are taken, and in all
GROUPS = ("shipped", *MANY, *narrow.SETS)
KINDS = ("accepted", "in part", "not written", "rejected")  # whole, in part: accepted
Problem = tuple[str, Path, tuple[Path, str] | None]  # name and files: the scene, and what goes beside it


def problems(group: str, folder: Path, most: int, place: Path) -> Iterator[Problem]:
    """Yield those of a group; scenes that have no file are written into `place`."""
    if group == "shipped":
        for name, file in {**shipped_scenes(), **shipped_jobs()}.items():
            yield name, file, None
    elif group in MANY:
        found = real_problems(folder, group)
        for i in np.unique(np.linspace(0, len(found) - 1, min(len(found), MANY[group], most)).round().astype(int)):
            yield f"{found[i].set} {found[i].number}", found[i].scene_file, found[i].beside
    else:
        for number, scene in narrow.scenes(folder.absolute().parent / "opof", group, WHOLE // min(NARROW, most), 0):
            (place / narrow.SCENE).write_text(yaml.safe_dump(scene, sort_keys=False))
            yield number, place / narrow.SCENE, None


def outcome(file: Path, beside: tuple[Path, str] | None, place: Path, time_limit: float) -> str:
    """Plan, prove and check: "accepted", or what is lacking."""
    scene = hdplan.load_scene(file, *beside) if beside else hdplan.load_scene(file)
    motion = place / "motion.json"
    try:
        result = (hdplan.plan_job if scene.job else hdplan.plan)(scene, time_limit=time_limit)
    except hdplan.UnsolvableError as error:
        return f"no ends: {error}"
    if not result.certified:
        return f"not planned: {result.certificate.text}"
    result.save(motion)
    return proven(file, motion, *beside or (), job=scene.job is not None)


def table(found: dict[str, dict[str, str]]) -> str:
    """Markdown: one row per group."""
    rows = []
    for group, each in found.items():
        kinds = Counter(x.partition(":")[0] for x in each.values())
        free, planned = len(each) - kinds["no ends"], sum(kinds[x] for x in KINDS)
        row = {"group": group, "problems": len(each), "ends are free": free, "certified": planned}
        columns = "accepted whole", "accepted in part", *KINDS[2:]
        rows.append(row | {column: kinds[kind] for column, kind in zip(columns, KINDS, strict=True)})
    return markdown_text(rows)


def lacking(found: dict[str, dict[str, str]]) -> str:
    """Text: what is not accepted whole, one line for each reason, numbers left out."""
    reasons = Counter[str]()
    for group, each in found.items():
        for name, text in each.items():
            kind = text.partition(":")[0]
            if kind in KINDS[1:]:
                what = f"{name}: " if group == "shipped" else ""
                reasons[f"{group}, {what}{re.sub(r'-?[0-9]+[.0-9e-]*', '…', text)}"] += 1
    return "\n".join(f"* {reason} ({count})" for reason, count in sorted(reasons.items()))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--group", nargs="+", choices=GROUPS, default=GROUPS)
    parser.add_argument("--most", type=int, default=350, metavar="N", help="problems of a group")
    parser.add_argument("--time-limit", type=float, default=10.0)
    options = parser.parse_args()
    found: dict[str, dict[str, str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for group in options.group:
            done = found[group] = {}
            for name, file, beside in problems(group, options.folder, options.most, Path(folder)):
                done[name] = outcome(file, beside, Path(folder), options.time_limit).replace(folder, "")
                print(group, name, done[name], file=sys.stderr, flush=True)
    print(table(found), lacking(found), sep="\n\n")


if __name__ == "__main__":
    main()
