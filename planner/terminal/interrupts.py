"""Ctrl-C and `kill`: a command ends soon, and in order, wherever they meet it.

Python drops an exception that is raised in a destructor or in a callback of a C library, and the command would go on
as if nothing had been asked. So the wish to end is raised again and again until it is on its way up; a command that
has something to show by then notes Ctrl-C instead, and ends at its next step.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

INTERRUPTED, TERMINATED = 130, 143  # what shells say of a command ended by Ctrl-C, or by `kill`
AGAIN = 0.1  # [s] until a wish that was lost is raised again
WISHES: dict[int, Callable[[], BaseException]] = {
    signal.SIGINT: KeyboardInterrupt,
    signal.SIGTERM: lambda: SystemExit(TERMINATED),
}


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let Ctrl-C (KeyboardInterrupt) and `kill` (SystemExit) end what is within, even where one of them gets lost.

    An error that a library makes of Ctrl-C in its callback counts as Ctrl-C. Signals that are ignored stay so.
    """
    wish: Callable[[], BaseException] | None = None

    def asked(number: int, _: object) -> None:
        nonlocal wish
        wish = WISHES[number]
        signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
        raise wish()

    def again(*_: object) -> None:
        if wish is not None and not _on_its_way():
            raise wish()

    def unraisable(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt | SystemExit):  # these come again
            hook(lost)

    hook = sys.unraisablehook
    handlers: dict[int, Callable[..., None]] = {signal.SIGALRM: again}
    handlers |= {number: asked for number in WISHES if signal.getsignal(number) is not signal.SIG_IGN}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    sys.unraisablehook = unraisable
    try:
        yield
    except Exception as error:
        if wish is None:
            raise
        raise wish() from error
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


@contextlib.contextmanager
def until_ctrl_c() -> Iterator[None]:
    """Take Ctrl-C for the proper end of what is within."""
    try:
        yield
    except KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, 0.0)  # heard


def _on_its_way() -> bool:
    """Whether the wish to end is being handled: what runs now tidies up."""
    error = sys.exception()
    while error is not None and not isinstance(error, KeyboardInterrupt | SystemExit):
        error = error.__context__
    return error is not None


class Note:
    """Notes Ctrl-C from the first call on; a second one ends at once."""

    def __init__(self) -> None:
        """Leave the signal as it is until the first call."""
        self._event = threading.Event()
        self.pressed = self._event.is_set
        self.before = signal.getsignal(signal.SIGINT) or signal.SIG_DFL

    def __call__(self) -> None:
        """Begin to note, or begin again where a library has taken the signal for itself."""
        if not self._event.is_set() and signal.getsignal(signal.SIGINT) is self.before:
            signal.signal(signal.SIGINT, self._note)

    def _note(self, *_: object) -> None:
        self._event.set()
        signal.signal(signal.SIGINT, self.before)


@contextlib.contextmanager
def noting() -> Iterator[Note]:
    """Note Ctrl-C, and leave the signal as it was."""
    note = Note()
    try:
        yield note
    finally:
        signal.signal(signal.SIGINT, note.before)
