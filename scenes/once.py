"""Values made once per process and then shared: a cache in memory that threads may use at the same time."""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

Arguments = ParamSpec("Arguments")
Made = TypeVar("Made")
Number = TypeVar("Number", bound=np.generic)


def read_only(array: NDArray[Number]) -> NDArray[Number]:
    """Return a read-only view of an array, which can safely be shared through a cache or a module."""
    view = array.view()
    view.setflags(write=False)
    return view


def freeze(holder: Any) -> None:
    """Make an object's arrays read-only, so that caches may share it."""
    own = vars(holder)
    for name, value in own.items():
        if isinstance(value, np.ndarray) and value.flags.writeable:
            own[name] = read_only(value)


class ReadOnly:
    """Base of dataclasses whose arrays are made read-only."""

    def __post_init__(self) -> None:
        """Make them so."""
        freeze(self)


def after_fork(call: Callable[[], None]) -> None:
    """Let each child of a fork make a call first; Windows has no forks."""
    if sys.platform != "win32":
        os.register_at_fork(after_in_child=call)


class ForkSafeLock:
    """A lock that is released in the child of a fork, where the thread that held it does not exist."""

    def __init__(self) -> None:
        """Make the lock, and a new one in each child process."""
        self._lock = threading.Lock()
        after_fork(self._make)

    def __enter__(self) -> None:
        """Acquire the lock."""
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        """Release the lock."""
        self._lock.release()

    def _make(self) -> None:
        self._lock = threading.Lock()


class _Turn:
    """The lock of a value under way, and the number of callers that hold it or wait."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.callers = 0


def made_once(most: int) -> Callable[[Callable[Arguments, Made]], Callable[Arguments, Made]]:
    """Cache the `most` last used values of a function, by its arguments, which must be hashable.

    Like `functools.lru_cache`, but when several threads require the same value at once, one makes it and the others
    wait: for values that take seconds to make, and for those that must be one and the same object for all. Errors are
    not cached; the next caller tries again.
    """

    def decorate(make: Callable[Arguments, Made]) -> Callable[Arguments, Made]:
        made: OrderedDict[Hashable, Made] = OrderedDict()
        under_way: dict[Hashable, _Turn] = {}
        changing = ForkSafeLock()  # guards the two above; never held while a value is made
        after_fork(under_way.clear)

        @functools.wraps(make)
        def find(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Made:
            key = (args, tuple(sorted(kwargs.items())))
            with changing:
                if key in made:
                    made.move_to_end(key)
                    return made[key]
                turn = under_way.setdefault(key, _Turn())
                turn.callers += 1
            try:
                with turn.lock:
                    with changing:
                        if key in made:  # by the thread that had the lock before
                            return made[key]
                    value = make(*args, **kwargs)
                    with changing:
                        made[key] = value
                        while len(made) > most:
                            made.popitem(last=False)
                    return value
            finally:
                with changing:  # kept for those who wait: after an error, one of them tries, and no newcomer beside it
                    turn.callers -= 1
                    if not turn.callers and under_way.get(key) is turn:
                        del under_way[key]

        return find

    return decorate
