"""The studies of `hdplan study` and `hdplan reproduce` as Markdown, and their pictures where a page wants them.

    python benchmarks/studies.py distance|planning|time|conservativeness|corridor|kinks [--pictures FILE.png ...]
    [--problems DIR] [--every K]

Each is what the command measures without `--quick`. `planning` takes the shipped scenes and every K-th of
MotionBenchMaker's problems below DIR.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

from hdplan.planner.commands.studies import FIGURES, problems_below, shipped_with_obstacles
from hdplan.planner.studies.distance import study_distance
from hdplan.planner.studies.paper_figures import reproduce_kinks
from hdplan.planner.studies.planning import study_planning
from hdplan.planner.studies.report import Report, markdown_text


def measure(name: str, folder: Path, problems: Path | None, every: int) -> Report:
    """Run one study, its files in `folder`."""
    if name == "kinks":
        return reproduce_kinks(folder)
    if name == "distance":
        return study_distance(folder, False, show, lambda: False)
    if name == "planning":
        scenes = [*shipped_with_obstacles(False), *(problems_below(problems, every) if problems else [])]
        return study_planning(folder, scenes, False, show, lambda: False)
    return FIGURES[name](folder, False, show, lambda: False)


def show(done: int, total: int, what: str) -> None:
    """Say how far it is."""
    print(f"{done} of {total}: {what}", file=sys.stderr)


def main() -> None:
    """Run one study from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=("distance", "planning", "kinks", *FIGURES))
    parser.add_argument("--pictures", type=Path, nargs="*", default=[], metavar="FILE.png", help="named as they are")
    parser.add_argument("--problems", type=Path, metavar="DIR")
    parser.add_argument("--every", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        report = measure(options.study, Path(folder), options.problems, options.every)
        for picture in options.pictures:
            shutil.copyfile(Path(folder) / picture.name, picture)
    for title, rows in report.tables.items():
        print(f"{title[0].upper()}{title[1:]}:\n\n{markdown_text(rows)}")
    print("\n".join(f"* {what}: {words}" for what, words in report.notes))


if __name__ == "__main__":
    main()
