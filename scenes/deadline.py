"""The time that a command may take: set once around all of its work, and checked wherever the work may take long.

It holds for the thread that set it and is kept in a context variable, so no function in between has to take it as an
argument. A library that cannot check it runs in a process of its own, for at most `seconds_left()`.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator
from contextvars import ContextVar

from hdplan.scenes.errors import TimeLimitError

_until: ContextVar[float] = ContextVar("until", default=math.inf)  # time.perf_counter()
_whole: ContextVar[float] = ContextVar("whole", default=math.inf)  # [s] the limit that ends then, from its beginning


@contextlib.contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Limit the time of the block; an outer limit that ends earlier still holds. None sets no limit."""
    until = math.inf if seconds is None else time.perf_counter() + seconds
    if seconds is None or until >= _until.get():
        yield
        return
    with _set(until, seconds):
        yield


@contextlib.contextmanager
def no_limit() -> Iterator[None]:
    """Let the block take its time, whatever the limits around it: for judging what was found within them."""
    with _set(math.inf, math.inf):
        yield


@contextlib.contextmanager
def _set(until: float, whole: float) -> Iterator[None]:
    tokens = _until.set(until), _whole.set(whole)
    try:
        yield
    finally:
        _until.reset(tokens[0])
        _whole.reset(tokens[1])


def seconds_left() -> float:
    """Return the time left [s], at least 0; inf without a limit."""
    return max(0.0, _until.get() - time.perf_counter())


def most_seconds() -> float | None:
    """Return the timeout [s] for another process, as `subprocess` takes it: the time left."""
    left = seconds_left()
    return None if math.isinf(left) else left


def whole_limit() -> float:
    """Return the limit in force [s], from its beginning; inf without one."""
    return _whole.get()


def check_time(doing: str) -> None:
    """Raise TimeLimitError once the limit has passed, saying what was being done."""
    if seconds_left() == 0.0:
        reached = f"time limit of {whole_limit():g} s reached while {doing}"
        raise TimeLimitError(f"{reached}; nothing was found by then; more time may help (--time-limit)")
