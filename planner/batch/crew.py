"""Workers: one process for each core of this machine, or those of a cluster, by dask.distributed."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from hdplan.planner.batch.outcome import PATIENCE, Options, Outcome, failed, solve
from hdplan.planner.batch.problems import Problem
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

AHEAD = 3  # problems that wait for each worker
SETTINGS = {
    "distributed.scheduler.allowed-failures": 1,  # a problem whose worker dies is tried once more
    "distributed.scheduler.worker-saturation": 1.0,  # else a worker's death is blamed on problems that wait for it too
    "distributed.worker.daemon": False,  # a compiler is a process of its own
    "distributed.admin.tick.limit": "1h",  # no warnings of a busy machine
    "distributed.comm.timeouts.connect": "30s",
}


@contextlib.contextmanager
def crew(workers: int | None = None, scheduler: str | None = None) -> Iterator[Client]:
    """Yield a client of `workers` processes on this machine (None: one for each core), or of the cluster whose scheduler
    is at the address `scheduler`. Raises InputError if no scheduler answers there."""
    import logging

    import dask
    from distributed import Client, LocalCluster

    with dask.config.set(SETTINGS):
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        if scheduler is not None:
            try:
                client = Client(scheduler, timeout="10s", set_as_default=False)
            except (OSError, ValueError) as error:
                words = str(error).splitlines()[0] or type(error).__name__
                raise InputError(f"--scheduler {scheduler}: no scheduler answers there ({words})") from None
            with client:
                yield client
            return
        options = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None}
        with (
            LocalCluster(**options, silence_logs=logging.CRITICAL, memory_limit="auto") as cluster,
            Client(cluster, set_as_default=False) as client,
        ):
            yield client


def outcomes(
    client: Client, problems: Iterable[tuple[int, Problem]], options: Options
) -> Iterator[tuple[int, Outcome]]:
    """Yield the outcomes of numbered problems, as they come. Problems are taken from the iterator as workers get free."""
    from distributed import as_completed

    waiting = iter(problems)
    given: dict[str, tuple[int, Problem, float]] = {}
    done = as_completed([], loop=client.loop, with_results=True, raise_errors=False)

    def more() -> None:
        for number, problem in waiting:
            future = client.submit(solve, problem, options, key=f"hdplan-{number}-{time.monotonic_ns()}", pure=False)
            given[future.key] = number, problem, time.monotonic()
            done.add(future)
            if len(given) >= AHEAD * max(1, len(client.scheduler_info(n_workers=-1)["workers"])):
                break

    more()
    for future, result in done:
        number, problem, since = given.pop(future.key)
        yield number, result if isinstance(result, Outcome) else _lost(problem, result, time.monotonic() - since, options)
        future.release()
        more()


def _lost(problem: Problem, result: Any, seconds: float, options: Options) -> Outcome:
    """Return the outcome of a problem that came back as an error of dask's."""
    error = result[1] if isinstance(result, tuple) and len(result) > 1 else result
    if type(error).__name__ == "KilledWorker":
        if seconds > 2 * (options.time_limit * PATIENCE[0] + PATIENCE[1]):
            return failed(problem, "hung", f"it did not return within {PATIENCE[0]:g} times its time limit, tried twice")
        return failed(problem, "ended", "its process ended twice: a crash, or more memory than the worker has")
    words = " ".join(f"{type(error).__name__}: {error}".split())
    return failed(problem, "internal", f"the cluster could not run it ({words})")
