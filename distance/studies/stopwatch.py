"""Time of a query: warm, repeated, the fastest round. Seconds of this machine: read them as ratios."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import process_time

LEAST_ROUNDS = 5  # at least so many are timed
LEAST_TIME = 0.2  # [s] and at least for so long


def seconds_per_query(run: Callable[[], object], queries: int, clock: Callable[[], float] = process_time) -> float:
    """Return the time of one query [s], where ``run()`` answers ``queries`` of them.

    The fastest of several rounds of ``run``: what other processes take does not count, nor does a first round, which
    compiles, fills caches and builds lazily. ``clock``: processor time of this process, all of its threads together,
    so that a loaded machine tells the same; where another device works, ``perf_counter``.
    """
    run()
    fastest, total, rounds = math.inf, 0.0, 0
    while rounds < LEAST_ROUNDS or total < LEAST_TIME:
        begin = clock()
        run()
        taken = clock() - begin
        fastest, total, rounds = min(fastest, taken), total + taken, rounds + 1
    return fastest / queries
