"""What is made once in a process and then shared: a cache in memory that threads may ask at the same time."""

from __future__ import annotations

import functools
import os
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
    """Return an array's view that nobody can write to: what is shared through a cache or a module is the same for
    all."""
    view = array.view()
    view.setflags(write=False)
    return view


def freeze(holder: Any) -> None:
    """Make the arrays that an object holds read-only: a `__post_init__` of what caches share."""
    for name, value in tuple(vars(holder).items()):
        if isinstance(value, np.ndarray):
            object.__setattr__(holder, name, read_only(value))


class Turn:
    """A lock that is open in the child of a fork: the thread that would have opened it is not there."""

    def __init__(self) -> None:
        """Make the lock, and again in each child."""
        self._lock = threading.Lock()
        os.register_at_fork(after_in_child=self._make)

    def __enter__(self) -> None:
        """Wait for one's turn."""
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        """Let the next one on."""
        self._lock.release()

    def _make(self) -> None:
        self._lock = threading.Lock()


def made_once(most: int) -> Callable[[Callable[Arguments, Made]], Callable[Arguments, Made]]:
    """Keep the `most` values of a function that were asked for last, by its arguments, which must be hashable.

    As `functools.lru_cache`, but of threads that ask for the same value at once one makes it and the others wait for
    it: for what takes seconds to make, and for what is to be one and the same object for all. A failure is kept by
    nobody; the next one to ask tries again.
    """

    def decorate(make: Callable[Arguments, Made]) -> Callable[Arguments, Made]:
        made: OrderedDict[Hashable, Made] = OrderedDict()
        under_way: dict[Hashable, threading.Lock] = {}
        changing = Turn()  # of the two above; never held while something is made
        os.register_at_fork(after_in_child=under_way.clear)

        @functools.wraps(make)
        def find(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Made:
            key = (args, tuple(sorted(kwargs.items())))
            with changing:
                if key in made:
                    made.move_to_end(key)
                    return made[key]
                turn = under_way.setdefault(key, threading.Lock())
            with turn:
                with changing:
                    if key in made:  # by the thread whose turn it was before
                        return made[key]
                try:
                    value = make(*args, **kwargs)
                    with changing:
                        made[key] = value
                        while len(made) > most:
                            made.popitem(last=False)
                    return value
                finally:
                    with changing:
                        under_way.pop(key, None)

        return find

    return decorate
