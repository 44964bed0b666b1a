"""A scheduler and workers on this machine: a program of its own, which ends when its standard input does.

So nothing stays behind however the process ends that began it, Ctrl-C does not reach the workers, and they import
nothing of the caller's own program. Argument: how many workers. It prints the scheduler's address.
"""

from __future__ import annotations

import logging
import sys

SETTINGS = {
    "distributed.scheduler.allowed-failures": 1,  # a problem whose worker dies is tried once more
    "distributed.scheduler.worker-saturation": 1.0,  # a worker is given one problem, the scheduler keeps the others
    "distributed.worker.daemon": False,  # a compiler is a process of its own
    "distributed.worker.profile.enabled": False,  # its samples take a quarter of a megabyte each second
    "distributed.admin.tick.limit": "1h",  # no warnings of a busy machine
}


def main(workers: int) -> None:
    """Serve until standard input ends."""
    import dask
    from distributed import LocalCluster

    dask.config.set(SETTINGS)
    options = {"threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
    with LocalCluster(n_workers=workers, memory_limit="auto", **options) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.buffer.read()


if __name__ == "__main__":
    main(int(sys.argv[1]))
