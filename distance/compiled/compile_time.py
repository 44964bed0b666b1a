"""The time spent on compiling: a stopwatch around any piece of work."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass
class Stopwatch:
    """The time spent so far."""

    seconds: float = 0.0


_running: ContextVar[tuple[Stopwatch, ...]] = ContextVar("running", default=())  # of this thread


@contextlib.contextmanager
def compile_time() -> Iterator[Stopwatch]:
    """Give a stopwatch of the time that this thread spends within on compiling, or on loading what was compiled."""
    watch = Stopwatch()
    token = _running.set((*_running.get(), watch))
    try:
        yield watch
    finally:
        _running.reset(token)


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Count the time spent within on all running stopwatches."""
    began = time.perf_counter()
    try:
        yield
    finally:
        for watch in _running.get():
            watch.seconds += time.perf_counter() - began
