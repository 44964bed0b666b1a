"""Workers: one process for each core of this machine, or those of a cluster, by dask.distributed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdplan.distance.compiled.loops import warn_without_loops
from hdplan.planner.batch.cluster_file import ClusterFile
from hdplan.planner.batch.job import Job
from hdplan.planner.batch.local_cluster import SETTINGS
from hdplan.planner.batch.outcome import Options, Outcome, failed, solve
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    from distributed import Client

ONE_BY_ONE = {"_data_producer": True}  # dask: the scheduler keeps what waits, so that a worker's death is its problem's
QUEUED_PROBLEMS = 3  # problems that wait for each worker
RECOUNT = 1.0  # [s] after which workers are counted again: those of a cluster come and go
ENDING = 10.0  # [s] in which workers may end by themselves


Workers = int | str | ClusterFile
"""So many on this machine; those of the scheduler at an address; those of a cluster that is started."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    from dask.system import CPU_COUNT

    return int(CPU_COUNT)


@contextlib.contextmanager
def worker_pool(workers: Workers) -> Iterator[Client]:
    """Yield a client of workers. Raises InputError if their scheduler does not answer."""
    with contextlib.ExitStack() as stack:
        address = stack.enter_context(_local(workers)) if isinstance(workers, int) else workers
        import dask
        from distributed import Client

        _silence()
        if isinstance(address, ClusterFile):
            stack.enter_context(dask.config.set(SETTINGS))
            address = stack.enter_context(address.started())
        try:
            if isinstance(workers, str):
                _check_address(workers)
            client = Client(address, timeout="20s", set_as_default=False)
        except (OSError, ValueError) as error:
            words = str(error).splitlines()[0] or type(error).__name__
            raise InputError(f"scheduler {address}: does not answer ({words})") from None
        stack.enter_context(client)
        if not isinstance(workers, int):  # those of this machine have the same cache
            from hdplan.planner.batch.caches import Caches, packed

            with contextlib.suppress(OSError):  # a worker that ends meanwhile: its problems will say so
                client.register_plugin(Caches(packed()))
        yield client


def _check_address(address: str) -> None:
    """Raise ValueError for an address where no client can begin. A client that cannot would wait for 40 s when it is
    dropped, and then print a traceback of its own."""
    from distributed.comm.addressing import get_address_host_port
    from distributed.security import Security

    get_address_host_port(address)
    if address.startswith("tls:") and Security().get_connection_args("client").get("ssl_context") is None:
        raise ValueError("TLS needs certificates, which dask's configuration names: distributed.comm.tls")


def _silence() -> None:
    """Keep dask from telling of lost workers in its own way: dask gives some of its loggers levels of their own."""
    import logging

    for name in ("distributed", *logging.root.manager.loggerDict):
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextlib.contextmanager
def _local(workers: int) -> Iterator[str]:
    """Yield the address of a scheduler on this machine, with workers."""
    warn_without_loops()  # here, as nobody reads what the workers write
    command = [sys.executable, "-P", str(Path(__file__).with_name("local_cluster.py")), str(workers)]
    within = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}  # it finds what we found
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, env=within, start_new_session=True, **pipes) as process:  # type: ignore[call-overload]
        try:
            import distributed  # noqa: F401  # a second, while the other process starts

            address = process.stdout.readline().decode().strip()
            if not address:
                raise InputError("the workers of this machine did not start: not enough memory, processes or ports")
            yield address
        finally:
            process.stdin.close()
            try:
                process.wait(ENDING)
            except BaseException:
                if sys.platform == "win32":
                    process.kill()
                else:
                    os.killpg(process.pid, signal.SIGKILL)
                raise


def outcomes(
    client: Client, jobs: Iterable[tuple[int, Job]], options: Options
) -> Generator[tuple[int, Outcome], None, None]:
    """Yield the outcomes of numbered problems, as they come. Problems are taken from the iterator as workers get free.

    Raises InputError if the scheduler goes away.
    """
    from distributed import as_completed

    waiting = iter(jobs)
    given: dict[Any, tuple[int, Job, float]] = {}
    done = as_completed([], loop=client.loop, with_results=True, raise_errors=False)
    count, counted = 0, -RECOUNT

    def more() -> None:
        nonlocal count, counted
        if time.monotonic() - counted >= RECOUNT:
            count, counted = client.scheduler_info(n_workers=0)["total_threads"], time.monotonic()
        while len(given) < QUEUED_PROBLEMS * max(1, count) and (following := next(waiting, None)) is not None:
            number, job = following
            key = f"hdplan-{number}-{time.monotonic_ns()}"
            future = client.submit(solve, job, options, key=key, pure=False, **ONE_BY_ONE)
            given[future.key] = number, job, time.monotonic()
            done.add(future)

    more()
    for future, result in done:
        number, job, since = given.pop(future.key)
        if future.status == "cancelled":
            raise InputError("the scheduler disappeared; the results so far are kept")
        yield number, result if isinstance(result, Outcome) else _lost(job, result, time.monotonic() - since, options)
        future.release()
        more()


def _lost(job: Job, result: Any, seconds: float, options: Options) -> Outcome:
    """Return the outcome of a problem that came back as an error of dask's."""
    error = result[1] if isinstance(result, tuple) and len(result) > 1 else result
    if type(error).__name__ == "KilledWorker":
        if seconds > 2 * options.longest:
            return failed(job, "hung", f"it did not return within {options.longest:g} s, tried twice")
        return failed(job, "ended", "its process ended twice: a crash, or more memory than the worker has")
    words = " ".join(f"{type(error).__name__}: {error}".split())
    return failed(job, "internal", f"the cluster could not run it ({words})")
