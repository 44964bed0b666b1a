"""How long a query takes: warm, repeated, the fastest round. Seconds of this machine: read them as ratios."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

ROUNDS = 5  # at least so many are timed
ENOUGH = 0.2  # [s] and at least for so long


def seconds_per_query(run: Callable[[], object], queries: int) -> float:
    """Return the time of one query [s], where ``run()`` answers ``queries`` of them.

    The fastest of several rounds of ``run``: what other processes take does not count, nor does a first round, which
    compiles, fills caches and builds lazily.
    """
    run()
    rounds: list[float] = []
    while len(rounds) < ROUNDS or sum(rounds) < ENOUGH:
        begin = perf_counter()
        run()
        rounds.append(perf_counter() - begin)
    return min(rounds) / queries
