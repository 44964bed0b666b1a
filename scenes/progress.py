"""Progress of long work, sent to a listener: in a library nobody, on the command line the progress line.

As with the time limit (`deadline`), nothing in between needs to pass it along.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar

_listener: ContextVar[Callable[[str], None] | None] = ContextVar("listener", default=None)  # of this thread


@contextlib.contextmanager
def listening(listener: Callable[[str], None]) -> Iterator[None]:
    """Hand all reports within to a listener."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def tell(doing: str) -> None:
    """Show what is being done now."""
    listener = _listener.get()
    if listener is not None:
        listener(doing)
