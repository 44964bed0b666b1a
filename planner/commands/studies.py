"""`hdplan study` and `hdplan reproduce`: measure, write the files, print the tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rich.text import Text

from hdplan.planner.studies.distance import study_distance
from hdplan.planner.studies.paper_corridor import reproduce_corridor
from hdplan.planner.studies.paper_figures import reproduce_conservativeness, reproduce_kinks, reproduce_time
from hdplan.planner.studies.planning import study_planning
from hdplan.planner.studies.report import Report, Reporter, Stopper
from hdplan.planner.terminal.console import measuring, printing, waiting
from hdplan.planner.terminal.tables import columns, table
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes

FIGURES: dict[str, Callable[[Path, bool, Reporter, Stopper], Report]] = {
    "time": reproduce_time,
    "conservativeness": reproduce_conservativeness,
    "corridor": reproduce_corridor,
}
LESS = {  # what `--quick` measures, and what it leaves out
    "distance": "one pair of bodies of three, half of the poses, four sets of normals and two orders of smoothness; no "
    "Hessians, no unions",
    "planning": "the Panda's scenes alone, half of the configurations, slow plans timed twice instead of four times, 4 "
    "rounds of polish instead of 16; no Ipopt, and of most settings fewer values",
    "time": "three pairs of solids of 15",
    "conservativeness": "15,000 configurations instead of 500,000, two sets of normals instead of five",
    "corridor": "the first 5 s of 60; no settings changed one at a time",
}


def run_distance_study(output: Path, *, quick: bool) -> int:
    """Measure what accuracy of the distance costs. Returns the exit code: 0, or 1 if it was interrupted."""
    with measuring() as (report, stop):
        found = study_distance(output, quick, report, stop)
    return _shown(found, LESS["distance"] * quick)


def run_planning_study(output: Path, *, quick: bool, problems: Path | None, every: int) -> int:
    """Measure what accuracy costs when planning. Returns the exit code: 0, or 1 if it was interrupted."""
    scenes = [*shipped_with_obstacles(quick), *(problems_below(problems, every) if problems else [])]
    with measuring() as (report, stop):
        found = study_planning(output, scenes, quick, report, stop)
    return _shown(found, LESS["planning"] * quick)


def run_figure(output: Path, name: str, *, quick: bool) -> int:
    """Reproduce one of FIGURES. Returns the exit code: 0, or 1 if it was interrupted."""
    with measuring() as (report, stop):
        found = FIGURES[name](output, quick, report, stop)
    return _shown(found, LESS[name] * quick)


def run_kinks(output: Path) -> int:
    """Follow the distances of two squares that pass each other. Returns the exit code: 0."""
    with waiting("following the squares"):
        found = reproduce_kinks(output)
    return _shown(found)


def shipped_with_obstacles(only_panda: bool) -> list[Scene]:
    """Load the shipped scenes that have obstacles."""
    scenes = [load_scene(file) for file in shipped_scenes().values()]
    return [scene for scene in scenes if scene.obstacles and (not only_panda or scene.robot.name == "panda")]


def problems_below(folder: Path, every: int) -> list[Scene]:
    """Load every K-th problem below a folder, named by its path in it, as `hdplan batch` finds them."""
    if every < 1:
        raise InputError(f"--every: found {every}, allowed is a whole number of at least 1")
    from hdplan.planner.batch.sources import jobs_of

    return [replace(job.load(), name=job.name) for job in jobs_of([str(folder)])[::every]]


def _shown(report: Report, less: str = "") -> int:
    """Print what was measured, and what a quick run left out (`less`). Returns the exit code: 0, or 1 if it was
    interrupted."""
    with printing() as show:
        for title, rows in report.tables.items():
            show(Text(title, style="bold"))
            show(columns(rows))
        partial = [] if report.complete else [("partial", "interrupted: tables and files hold the results so far")]
        quick = [("quick", f"{less}: figures to look at, not to quote")] if less else []
        show(table([*partial, *quick, *report.notes, *(("written", str(file)) for file in report.files)]))
    return 0 if report.complete else 1
