"""A run: many problems solved into a folder, where no result is lost.

The folder holds `run.json` (what the run is), `journal` (outcomes as they come) and, once the run ends or is
interrupted, `results.parquet` (a row a problem) and `motions.parquet` (a row for each joint of each row of a motion).
With `--motions files`, `motions` holds each problem's scene, motion and proof.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from hdplan.planner.batch.files import write_files
from hdplan.planner.batch.job import Job
from hdplan.planner.batch.journal import Journal
from hdplan.planner.batch.lerobot import write_lerobot
from hdplan.planner.batch.outcome import Options, Outcome
from hdplan.planner.batch.tables import write_tables
from hdplan.planner.batch.worker_pool import Workers, outcomes, worker_pool
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import read_file
from hdplan.scenes.output import write_output
from hdplan.scenes.values import FilePath

RUN, JOURNAL, FILES, LEROBOT = "run.json", "journal", "motions", "lerobot"


def run_into(
    folder: Path,
    jobs: Sequence[Job],
    options: Options,
    *,
    workers: Workers,
    report: Callable[[int, int, Outcome], None] = lambda done, of, outcome: None,
    stop: Callable[[], bool] = lambda: False,
) -> bool:
    """Solve problems into a folder, continuing where an earlier run of the same problems stopped.

    `report` is called with the number of problems done, of all, and each outcome; once `stop` returns True the run ends
    with what is there. Returns whether all problems are done. Raises InputError if the folder holds another run, or
    cannot be written.
    """
    with claimed(folder, jobs, options) as journal:
        left = [(i, each) for i, each in enumerate(jobs) if i not in journal.places]
        try:
            if left and not stop():
                with worker_pool(min(workers, len(left)) if isinstance(workers, int) else workers) as client:
                    for number, outcome in outcomes(client, left, options):
                        write_files(folder / FILES, outcome.problem, outcome.files)
                        journal.add(number, outcome)
                        report(len(journal.places), len(jobs), outcome)
                        if stop():
                            break
        finally:
            write_tables(folder, journal)
        return len(journal.places) == len(jobs)


def export_lerobot(folder: Path, jobs: Sequence[Job], options: Options, fps: int) -> int:
    """Make a data set of a run's certified motions, in its folder `lerobot`. Returns the number of episodes, and raises
    InputError as `write_lerobot`."""
    with claimed(folder, jobs, options) as journal:
        groups = ((outcome, jobs[number].group) for number, outcome in journal)
        motions = ((outcome, _does(outcome) + (group and f" in {group}")) for outcome, group in groups)
        return write_lerobot(folder / LEROBOT, motions, fps)


def _does(outcome: Outcome) -> str:
    """Return a description of a motion: the names of a job's stages."""
    marks = () if outcome.trajectory is None else outcome.trajectory.stages
    return ", ".join(mark.name for mark in marks) or "move from start to goal"


@contextlib.contextmanager
def claimed(folder: Path, jobs: Sequence[Job], options: Options) -> Iterator[Journal]:
    """Yield the journal of a run, which no other process has at the same time. Raises InputError."""
    header = {"hdplan": metadata.version("hdplan"), "problems": len(jobs), "sha256": _identity(jobs), **asdict(options)}
    about = folder / RUN
    try:
        folder.mkdir(parents=True, exist_ok=True)
        strange = not about.exists() and any(file.name != JOURNAL for file in folder.iterdir())
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    if strange:
        raise InputError(f"{folder}: holds files that do not belong to a run; name an empty or new folder")
    with contextlib.closing(Journal(folder / JOURNAL)) as journal:
        if not about.exists():
            write_output(about, json.dumps(header, indent=1).encode())
        before = read_run(folder)
        if unlike := [key for key in header if before.get(key) != header[key]]:
            key = unlike[0]
            words = "other problems, or in another order" if key == "sha256" else f"{key}: {before.get(key)}"
            raise InputError(f"{folder}: holds a run with {words}; name another folder")
        yield journal


def read_run(folder: FilePath) -> dict[str, Any]:
    """Return the description of a run. Raises InputError if the folder holds none."""
    about = Path(folder) / RUN
    if not os.path.isfile(about):
        raise InputError(f"{folder}: is not the folder of a run ({RUN} is missing)")
    try:
        header = json.loads(read_file(about))
    except ValueError:
        header = None
    if not isinstance(header, dict) or not isinstance(header.get("problems"), int):
        raise InputError(f"{about}: is not the description of a run")
    return header


def _identity(jobs: Sequence[Job]) -> str:
    """SHA-256 of the problems, whose files must not change during a run."""
    digest = hashlib.sha256()
    for each in jobs:
        digest.update(f"{each.name}\0{each.hashed}\0{each.seed}\n".encode())
    return digest.hexdigest()
