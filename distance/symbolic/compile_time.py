"""How long compiling took: a stopwatch that whoever wants to know holds around the work."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass
class Stopwatch:
    """Time that was spent."""

    seconds: float = 0.0


_running: ContextVar[tuple[Stopwatch, ...]] = ContextVar("running", default=())  # of this thread


@contextlib.contextmanager
def compile_time() -> Iterator[Stopwatch]:
    """Give a stopwatch of what this thread spends on compiling within, or on finding what was compiled."""
    watch = Stopwatch()
    token = _running.set((*_running.get(), watch))
    try:
        yield watch
    finally:
        _running.reset(token)


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Let the stopwatches that run take what is done within."""
    began = time.perf_counter()
    try:
        yield
    finally:
        for watch in _running.get():
            watch.seconds += time.perf_counter() - began
