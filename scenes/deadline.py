"""The time that a command may take: set once around all of its work, asked wherever the work may take long.

It holds for the thread that set it, and is carried by a context variable: nothing in between needs to hand it on. A
library that cannot ask runs in a process of its own, for `seconds_left()` at most.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from contextvars import ContextVar

from hdplan.scenes.errors import OutOfTime

_until: ContextVar[float] = ContextVar("until", default=math.inf)  # time.perf_counter()


@contextlib.contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Bound what is done within; an outer limit that ends earlier still holds. None is no limit."""
    before = _until.get()
    token = _until.set(before if seconds is None else min(before, time.perf_counter() + seconds))
    try:
        yield
    finally:
        _until.reset(token)


def seconds_left() -> float:
    """Return how long the work may still take [s], not below 0; inf without a limit."""
    return max(0.0, _until.get() - time.perf_counter())


def most_seconds(otherwise: float | None = None) -> float | None:
    """Return how long another process may take [s], as `subprocess` wants it: what is left, or `otherwise`."""
    left = seconds_left()
    return otherwise if math.isinf(left) else left if otherwise is None else min(left, otherwise)


def check_time(doing: str) -> None:
    """Raise OutOfTime, saying what was being done, once the limit has passed."""
    if seconds_left() == 0.0:
        raise OutOfTime(f"the time limit passed while {doing}; nothing was found by then (--time-limit)")
