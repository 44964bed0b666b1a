"""Work done by several threads at once, which Python makes take turns as often as it can."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import TypeVar

Found = TypeVar("Found")

THREADS = 8
TURN = 1e-6  # [s] after which Python lets another thread run


def together(work: Callable[[int], Found], count: int = THREADS) -> list[Found]:
    """Return the results of `work` for 0 … count − 1, each in a thread of its own; all begin at the same moment. Raises
    what the first of them raises."""
    found: list[Found | None] = [None] * count
    raised: list[BaseException] = []
    ready = threading.Barrier(count)

    def run(index: int) -> None:
        try:
            ready.wait()
            found[index] = work(index)
        except BaseException as error:
            raised.append(error)

    threads = [threading.Thread(target=run, args=(index,)) for index in range(count)]
    before = sys.getswitchinterval()
    sys.setswitchinterval(TURN)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    if raised:
        raise raised[0]
    return found  # type: ignore[return-value]
