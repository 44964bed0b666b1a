"""`hdplan batch`: plan many problems into a folder, and report the outcomes. `hdplan sample`: draw them."""

from __future__ import annotations

import csv
import io
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from rich.text import Text

from hdplan.planner.batch.cluster_file import ClusterFile
from hdplan.planner.batch.files import MOTION, SCENE, place_of
from hdplan.planner.batch.installed import check_installed
from hdplan.planner.batch.job import Job
from hdplan.planner.batch.journal import read_journal
from hdplan.planner.batch.lerobot import WITHOUT_TIMES
from hdplan.planner.batch.outcome import Options, Outcome
from hdplan.planner.batch.report import Failures, failures_of, groups_of
from hdplan.planner.batch.run import FILES, JOURNAL, LEROBOT, export_lerobot, read_run, run_into
from hdplan.planner.batch.sample import sample
from hdplan.planner.batch.sources import TABLES, jobs_of
from hdplan.planner.batch.tables import MOTIONS, RESULTS, row_of, table_bytes
from hdplan.planner.batch.worker_pool import Workers, cores
from hdplan.planner.pictures.plot import check_picture, write_picture
from hdplan.planner.solvers import solver_named
from hdplan.planner.terminal.console import counting, printing
from hdplan.planner.terminal.tables import columns, table
from hdplan.scenes.errors import InputError
from hdplan.scenes.output import check_writable, ending_of, write_output
from hdplan.scenes.values import Choice, checked

A_FEW = 3  # problems for each worker, after which one can say how long the others take


def run_batch(
    sources: Sequence[str] | None,
    output: Path | None,
    *,
    report: Path | None,
    scene: str | None,
    workers: int | None,
    scheduler: str | None,
    cluster: Path | None,
    solver: str,
    seed: int,
    time_limit: float,
    motions: str,
    proofs: bool,
    diagnosed: bool,
    plot: Path | None,
    export: str | None,
    fps: int,
) -> int:
    """Plan all problems of the sources into the folder `output`; `time_limit` [s] holds for everything that one of them
    needs. Of the folder `report`, print the report alone.

    Returns the exit code: 0 if all are certified, 1 if some are not or it was interrupted.
    """
    if report is not None:
        if sources or output is not None:
            raise typer.BadParameter("--report RUN takes no SOURCE and no --output")
        return show_report(report, plot)
    if not sources or output is None:
        raise typer.BadParameter("needs SOURCE and --output RUN, or --report RUN")
    check_installed()
    solver_named(solver)
    checked(Choice(("parquet", "files")), motions, "motions")
    if plot is not None:
        check_picture(plot)
    if export is not None:
        checked(Choice(("lerobot",)), export, "export")
    if [workers, scheduler, cluster].count(None) < 2:
        raise InputError("--workers, --scheduler and --cluster each say where the workers are: give one of them")
    given: Workers = ClusterFile.read(cluster) if cluster is not None else scheduler or workers or cores()
    jobs = jobs_of(sources, scene, seed)
    if export is not None:
        _check_times(jobs[0])
    with counting("certified", A_FEW * (given if isinstance(given, int) else cores())) as (count, stop):

        def note(done: int, of: int, outcome: Outcome) -> None:
            count(done, of, outcome.certified, "" if outcome.certified else f"{outcome.problem}: {outcome.text}")

        files = proofs or motions == "files"
        options = Options(solver, time_limit, files=files, proofs=proofs, diagnose=diagnosed)
        complete = run_into(output, jobs, options, workers=given, report=note, stop=stop)
    try:
        if export is not None and complete:
            export_lerobot(output, jobs, options, fps)
    finally:
        code = show_report(output, plot)
    return code


def _check_times(job: Job) -> None:
    """Raise InputError, before anything is planned, if motions as a problem's have no times."""
    try:
        timed = job.load().timed
    except InputError:  # a row of its own, later
        return
    if not timed:
        raise InputError(f"--export lerobot: {job.name} and similar scenes: {WITHOUT_TIMES}")


def show_report(folder: Path, plot: Path | None) -> int:
    """Print the report of a run, and draw it. Returns the exit code: 0 if all of its problems are certified, else 1."""
    if plot is not None:
        check_picture(plot)
    of, found = read_run(folder)["problems"], read_journal(folder / JOURNAL)
    rows = [row_of(outcome) for outcome in found]
    certified = sum(outcome.certified for outcome in found)
    missing = f", {len(rows) - certified} not, {of - len(rows)} not planned yet" if len(rows) < of else ""
    if plot is not None and rows:
        from hdplan.planner.batch.sheet import run_sheet

        write_picture(run_sheet(rows, folder.absolute().name), plot)
    with printing() as show:
        show(Text(f"{certified} of {of} problems certified{missing}", style="bold"))
        if rows:
            show(columns(groups_of(rows)))
        lines = [row for failures in failures_of(rows) for row in _lines(failures, folder)]
        files = [folder / name for name in (RESULTS, MOTIONS, FILES, LEROBOT)] + ([plot] if plot and rows else [])
        lines += [("written", str(file)) for file in files if file.exists()]
        if lines:
            show(table(lines))
    return 0 if certified == of else 1


def _lines(failures: Failures, folder: Path) -> list[tuple[str, str]]:
    """Return rows on failures of one cause, with the command that shows one of them if its files are there."""
    lines = [(f"{failures.count} failed", f"{failures.cause}, such as {failures.problem}: {failures.text}")]
    lines += [("helps", failures.advice)] if failures.advice else []
    place = str(place_of(folder / FILES, failures.problem))
    there = [place + ending for ending in (SCENE, MOTION) if os.path.isfile(place + ending)]
    return [*lines, ("look", shlex.join(["hdplan", "view", *there]))] if there else lines


def run_sample(scene: str, output: Path, *, count: int, seed: int, goal: str, jitter: float, resize: float) -> int:
    """Draw problems and write their table. Returns the exit code: 1 if it was interrupted before all were drawn."""
    check_writable(output, TABLES)
    check_installed()
    with counting("drawn") as (note, stop):

        def report(done: int, of: int, what: str) -> None:
            note(done, of, True, "")

        drawn = sample(Path(scene), count, seed=seed, goal=goal, jitter=jitter, resize=resize, report=report, stop=stop)
    write_output(output, _table(drawn.rows, output))
    with printing() as show:
        show(drawn.text)
    return 0 if len(drawn.rows) == count else 1


def _table(rows: list[dict[str, Any]], output: Path) -> bytes:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    if ending_of(output, TABLES) == ".csv":
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return text.getvalue().encode()
    return table_bytes(rows)
