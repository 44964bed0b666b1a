"""Besiege hdplan: seeded campaigns of hostile cases, each judged by code that shares nothing with it.

    python benchmarks/siege.py certificate|input|semantics|distance|control|threads
        [--count N] [--seed S] [--seconds T] [--jobs J] [--first K] [--output FOLDER]

Case k of a campaign depends on seed and k alone. Prints a table: what was tried, what came out, findings, worst times.
Each finding is kept in the output folder as `case_K`: its files, and what the judge found in judge.json. Exit code 1 if
there is any.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from sieges import campaign

CAMPAIGNS = {  # how many cases by default, and the processor time for one [s]
    "certificate": (4_500, 60.0),
    "input": (20_000, 20.0),
    "semantics": (5_000, 60.0),
    "distance": (250, 300.0),
    "control": (4_000, 300.0),
    "threads": (200, 300.0),
}


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", choices=CAMPAIGNS)
    parser.add_argument("--count", type=int, help="cases; the default is the whole campaign")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="after which no new case is begun")
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time, each in a process")
    parser.add_argument("--first", type=int, default=0, help="the first case")
    parser.add_argument("--output", type=Path, default=Path("out/siege"), help="where findings are kept")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    name = given.campaign
    if given.worker is not None:
        attack = importlib.import_module(f"sieges.{name}").attack
        campaign.serve(attack, name, given.seed, given.worker)
        return 0
    count, limit = CAMPAIGNS[name]
    tally = campaign.run(
        name,
        given.count or count,
        given.seed,
        given.output.resolve() / name,
        limit,
        seconds=given.seconds,
        jobs=given.jobs,
        first=given.first,
    )
    print(tally.table(name))
    return int(bool(tally.findings))


if __name__ == "__main__":
    sys.exit(main())
