"""A run: many problems solved into a folder, where nothing that was found is lost.

The folder holds `run.json` (what the run is), `journal` (outcomes as they come) and, once the run ends or is
interrupted, `results.parquet` (a row a problem) and `motions.parquet` (a row for each joint of each row of a motion).
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from hdplan import __version__
from hdplan.planner.batch.crew import crew, outcomes
from hdplan.planner.batch.journal import Journal
from hdplan.planner.batch.outcome import Options, Outcome
from hdplan.planner.batch.problems import Problem
from hdplan.planner.batch.tables import write_tables
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import read_file
from hdplan.scenes.output import write_output
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import FilePath, Number, checked, instance

RUN, JOURNAL = "run.json", "journal"


def plan_many(
    problems: Iterable[Scene | Problem],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    solver: str = "gauss_newton",
    time_limit: float = 60.0,
    in_order: bool = True,
) -> Iterator[Outcome]:
    """Plan many problems on every core, and yield what becomes of each.

    Args:
        problems: scenes, or problems by their files (`problems_of`); taken as workers get free, so that it may be a
            generator of any length.
        workers: processes on this machine; None for one on each core.
        scheduler: address of a running dask scheduler, such as "tcp://10.0.0.1:8786", whose workers are used instead.
        solver: as in `plan`.
        time_limit: [s] for everything that one problem needs. A process that has not returned long after it is ended.
        in_order: whether outcomes come in the order of the problems, or else as they come.

    Bad input, an error, or a crash of a problem is an outcome like any other, with `status`, `cause` and `text`; the
    others go on. A problem's motion is the same whatever the number of workers, as far as no time limit ends it.

    Raises InputError for a scheduler that does not answer, and for what is no scene.
    """
    options = Options(solver, checked(Number(above=0.0, unit="s"), time_limit, "time_limit"))
    numbered = ((i, _problem(each, i)) for i, each in enumerate(problems))
    with crew(workers, scheduler) as client:
        waiting: dict[int, Outcome] = {}
        following = 0
        for number, outcome in outcomes(client, numbered, options):
            if not in_order:
                yield outcome
                continue
            waiting[number] = outcome
            while following in waiting:
                yield waiting.pop(following)
                following += 1


def _problem(each: Scene | Problem, number: int) -> Problem:
    if isinstance(each, Problem):
        return each
    instance(each, Scene, f"problems[{number}]")
    return Problem(f"{each.name}/{number}", each.name, each)


def run_into(
    folder: Path,
    problems: Sequence[Problem],
    options: Options,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    report: Callable[[int, int, Outcome], None] = lambda done, of, outcome: None,
    stop: Callable[[], bool] = lambda: False,
) -> bool:
    """Solve problems into a folder, going on where an earlier run of the same problems stopped.

    `report` is called with the number of problems done, of all, and each outcome; once `stop` returns True the run ends
    with what is there. Returns whether all problems are done. Raises InputError if the folder holds another run, or
    cannot be written.
    """
    said = {"hdplan": __version__, "problems": len(problems), "sha256": _identity(problems), **asdict(options)}
    with claimed(folder, said) as journal:
        left = [(i, each) for i, each in enumerate(problems) if i not in journal.places]
        try:
            if left and not stop():
                with crew(workers, scheduler) as client:
                    for number, outcome in outcomes(client, left, options):
                        journal.add(number, outcome)
                        report(len(journal.places), len(problems), outcome)
                        if stop():
                            break
        finally:
            write_tables(folder, journal)
        return len(journal.places) == len(problems)


@contextlib.contextmanager
def claimed(folder: Path, said: dict[str, object]) -> Iterator[Journal]:
    """Yield the journal of a run, which no other process has at the same time. Raises InputError."""
    import fcntl

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    about = folder / RUN
    if not about.exists() and any(folder.iterdir()):
        raise InputError(f"{folder}: holds files that are no run; name a folder that is empty or new")
    if about.exists():
        before = read_run(folder)
        if unlike := [key for key in said if before.get(key) != said[key]]:
            key = unlike[0]
            words = "other problems, or in another order" if key == "sha256" else f"{key}: {before.get(key)}"
            raise InputError(f"{folder}: holds a run with {words}; name another folder")
    else:
        write_output(about, json.dumps(said, indent=1).encode())
    journal = Journal(folder / JOURNAL)
    try:
        try:
            fcntl.flock(journal.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{folder}: another process is writing this run") from None
        yield journal
    finally:
        journal.close()


def read_run(folder: FilePath) -> dict[str, object]:
    """Return what a run is. Raises InputError if the folder holds none."""
    about = Path(folder) / RUN
    if not os.path.isfile(about):
        raise InputError(f"{folder}: is no folder of a run ({RUN} is missing)")
    try:
        said: dict[str, object] = json.loads(read_file(about))
    except ValueError:
        raise InputError(f"{about}: is no run's description") from None
    return said


def _identity(problems: Sequence[Problem]) -> str:
    """SHA-256 of the problems, whose files must not change while a run goes on."""
    digest = hashlib.sha256()
    for each in problems:
        digest.update(f"{each.name}\0{each.hashed}\0{each.seed}\n".encode())
    return digest.hexdigest()
