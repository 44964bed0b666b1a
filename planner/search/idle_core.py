"""Work ahead on a second core: what a search may need later is begun by a thread while its guesses are solved.

Items come as from their iterator alone, in its order: whichever is ready first, a search takes the same guesses and
finds the same motion. Where no second core is idle, as in a batch (`one_core`), each item is made when it is taken.
"""

from __future__ import annotations

import contextlib
import contextvars
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from types import TracebackType
from typing import Generic, TypeVar

POLL_PERIOD = 0.02  # [s] between two checks whether a search is over while it waits for an item

Item = TypeVar("Item")

_one_core: contextvars.ContextVar[bool] = contextvars.ContextVar("one_core", default=False)


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Let searches within the block use one core, as others have work for the rest."""
    token = _one_core.set(True)
    try:
        yield
    finally:
        _one_core.reset(token)


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class IdleCore:
    """A thread for one search, which begins when there is work for it and has ended when the search has."""

    def __init__(self, deadline: float) -> None:
        """Work until then (time.perf_counter()), or until the block ends."""
        self._deadline, self._left = deadline, threading.Event()
        self._pool = ThreadPoolExecutor(1, "hdplan ahead") if usable_cores() > 1 and not _one_core.get() else None

    def __enter__(self) -> IdleCore:
        """Begin the block."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End the work under way, which is no longer needed."""
        self._left.set()
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    def ahead(
        self, items: Callable[[Callable[[], bool]], Iterator[Item | None]], over: Callable[[], bool]
    ) -> Ahead[Item]:
        """Return the items of an iterator, to be made ahead. The iterator gets a function that says whether to stop;
        `over` is that of the search, which its own thread alone calls."""
        return Ahead(self._pool, items, over, lambda: self._left.is_set() or time.perf_counter() > self._deadline)


class Ahead(Generic[Item]):
    """Items of an iterator that are made ahead, once that has begun."""

    def __init__(
        self,
        pool: ThreadPoolExecutor | None,
        items: Callable[[Callable[[], bool]], Iterator[Item | None]],
        over: Callable[[], bool],
        left: Callable[[], bool],
    ) -> None:
        """See `IdleCore.ahead`."""
        self._pool, self._over, self._given_up = pool, over, threading.Event()
        stop = over if pool is None else lambda: left() or self._given_up.is_set()
        self._items = items(stop)
        self._next: Future[Item | None] | None = None

    def begin(self) -> None:
        """Have the next item made, if a core is idle."""
        if self._pool is not None and self._next is None:
            context, items = contextvars.copy_context(), self._items
            self._next = self._pool.submit(lambda: context.run(lambda: next(items, None)))

    def take(self) -> Item | None:
        """Return the next item, None at the end, and have the one after it made."""
        found = self._taken()
        self.begin()
        return found

    def _taken(self) -> Item | None:
        made, self._next = self._next, None
        if made is None or made.cancel():  # it had not begun, as the thread works for another goal
            return next(self._items, None)
        while not wait([made], POLL_PERIOD).done:
            if self._over():
                self._given_up.set()
        return made.result()
