"""Many problems from Python: their outcomes, as an iterator."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterable, Iterator, Sized
from pathlib import Path

from hdplan.planner.batch.installed import check_installed
from hdplan.planner.batch.job import Job, located, seed_of
from hdplan.planner.batch.outcome import Options, Outcome
from hdplan.planner.batch.worker_pool import Workers, cores, outcomes, worker_pool
from hdplan.planner.solvers import solver_named
from hdplan.scenes.errors import InputError
from hdplan.scenes.progress import tell
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import FilePath, Number, Whole, checked, instance, text, wrong

MOST_WORKERS = 10_000


def plan_many(
    problems: Iterable[Scene | FilePath | Job],
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    solver: str = "gauss_newton",
    seed: int = 0,
    time_limit: float = 60.0,
    in_order: bool = True,
) -> Generator[Outcome, None, None]:
    """Plan many problems on every core of this machine or of a cluster, and yield the outcome of each.

        for outcome in hdplan.plan_many(scenes):
            print(outcome.problem, outcome.status, outcome.text)

    Bad input, an internal error, a crash or a problem that hangs is an outcome like any other, with its cause; the
    others continue. A problem's motion does not depend on the number of workers, unless its time limit ends it. The
    workers end with the iterator, also if it is closed early. Progress is reported to all listeners
    (`hdplan.scenes.progress.listening`).

    Args:
        problems: scenes, files of scenes, or shipped scenes' names; fetched as workers become free, so a generator of
            any length is allowed.
        workers: processes on this machine; None for one on each core.
        scheduler: address of a running dask scheduler, such as "tcp://10.0.0.1:8786", whose workers are used instead.
        solver: as in `plan`.
        seed: of the random guesses; each problem's own seed is drawn from it and the problem's place in the order.
        time_limit: [s] for each problem, reading and building included. A process that has not returned after twice as
            long and 10 s more is ended.
        in_order: whether outcomes come in the order of the problems, or else as they arrive.

    Raises:
        InputError: bad arguments, at once, and if dask is not installed (the extra `batch`); while iterating, a
            scheduler that does not answer or disappears, and a problem that is neither a scene nor a file's name.
    """
    check_installed()
    solver_named(solver)
    seed = checked(Whole(0, 2**63 - 1), seed, "seed")
    options = Options(solver, checked(Number(above=0.0, unit="s"), time_limit, "time_limit"))
    if workers is not None:
        workers = checked(Whole(1, MOST_WORKERS), workers, "workers")
    if scheduler is not None:
        scheduler = checked(text, scheduler, "scheduler")
        if workers is not None:
            raise InputError("workers: the scheduler has workers of its own")
    if isinstance(problems, str) or not isinstance(problems, Iterable):
        raise wrong("scenes, or files of scenes", problems).within("problems")
    numbered = ((i, _job(each, i, seed)) for i, each in enumerate(problems))
    of = f" of {len(problems)}" if isinstance(problems, Sized) else ""
    return _planned(numbered, scheduler or workers or cores(), options, in_order, of)


def _planned(
    numbered: Iterator[tuple[int, Job]], workers: Workers, options: Options, in_order: bool, of: str
) -> Generator[Outcome, None, None]:
    tell("starting the workers")
    with worker_pool(workers) as client:
        waiting: dict[int, Outcome] = {}
        following = certified = 0
        for done, (number, outcome) in enumerate(outcomes(client, numbered, options), start=1):
            certified += outcome.certified
            tell(f"planned {done}{of} problems: {certified} certified, {done - certified} not")
            if not in_order:
                yield outcome
                continue
            waiting[number] = outcome
            while following in waiting:
                yield waiting.pop(following)
                following += 1


def _job(each: Scene | FilePath | Job, number: int, seed: int) -> Job:
    if isinstance(each, Job):
        return each
    if isinstance(each, str | os.PathLike):
        name = f"{Path(each).stem}/{number}"
        return Job(name, "", located(each), seed=seed_of(seed, str(number)))
    instance(each, Scene, f"problems[{number}]")
    return Job(f"{each.name}/{number}", "", each, seed=seed_of(seed, str(number)))
