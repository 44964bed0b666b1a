"""Besiege hdplan: seeded campaigns of hostile cases, each judged by code that shares nothing with it.

    python benchmarks/siege.py
        [certificate|input|semantics|meshes-files|distance|control|robots-files|threads ...]
        [--count N] [--seed S] [--seconds T] [--jobs J] [--first K] [--output FOLDER]

Case k of a campaign depends on seed and k alone. Prints a table, one row for each campaign, with the number of cases
and what was tried in them (motions, inputs, poses, steps); to the error stream, what came out of each one, findings and
worst times. "Wrong": certified and refuted, another meaning, another number; "over": a limit of time or memory. Each
finding is kept in the output folder as `case_K`: its files, and what the judge found in judge.json. Exit code 1 if
there is any.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from sieges import campaign

from hdplan.planner.studies.report import markdown_text

CAMPAIGNS = {  # what is tried, how many cases by default, and the processor time for one [s]
    "certificate": ("hostile meshes, random trees, curves right at limits, things that move", 4_500, 60.0),
    "input": ("mutated scenes, MoveIt pairs, motions, URDFs, SRDFs, meshes", 20_000, 20.0),
    "semantics": ("distances, text and back, in MoveIt's words", 5_000, 60.0),
    "meshes-files": ("meshes of every format, legal or spoilt, against Assimp", 5_000, 20.0),
    "distance": ("poses: random, aligned, touching, overlapping", 250, 300.0),
    "control": ("steps of many robots, obstacles beside the arm, some that come", 4_000, 300.0),
    "robots-files": ("URDF, SRDF and xacro in odd syntax or made wrong, against urdfdom", 5_000, 60.0),
    "threads": ("eight against one, bit for bit", 200, 300.0),
}


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaigns", nargs="*", metavar="CAMPAIGN", help=f"of {', '.join(CAMPAIGNS)}; default: all")
    parser.add_argument("--count", type=int, help="cases of each; the default is the whole campaign")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="after which a campaign begins no new case")
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time, each in a process")
    parser.add_argument("--first", type=int, default=0, help="the first case")
    parser.add_argument("--output", type=Path, default=Path("out/siege"), help="where findings are kept")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if unknown := set(given.campaigns) - set(CAMPAIGNS):
        parser.error(f"CAMPAIGN {', '.join(unknown)}, allowed are {', '.join(CAMPAIGNS)}")
    if given.worker is not None:
        (name,) = given.campaigns
        attack = importlib.import_module(f"sieges.{name.replace('-', '_')}").attack
        campaign.serve(attack, name, given.seed, given.worker)
        return 0
    rows, findings = [], 0
    for name in given.campaigns or CAMPAIGNS:
        words, count, limit = CAMPAIGNS[name]
        output, more = (
            given.output.resolve() / name,
            {"seconds": given.seconds, "jobs": given.jobs, "first": given.first},
        )
        tally = campaign.run(name, given.count or count, given.seed, output, limit, **more)
        print(tally.words(name), file=sys.stderr)
        counted = {"cases": f"{tally.cases:,}", "tried": f"{tally.tried:,}"}
        rows.append({"campaign": f"`{name}`: {words}", **counted, **tally.faults()})
        findings += len(tally.findings)
    print(markdown_text(rows))
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
