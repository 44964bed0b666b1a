"""Ctrl-C and `kill`: a command ends promptly and cleanly at any time.

Python drops an exception that is raised in a destructor or in a callback of a C library, and the command would continue
as if nothing had happened. So the exception is raised again until it propagates; a command that already has something
to show notes Ctrl-C instead, and ends at its next step.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

INTERRUPTED, TERMINATED = 130, 143  # exit codes after Ctrl-C and after `kill`, as shells have them
RERAISE_DELAY = 0.1  # [s] until an exception that was dropped is raised again
EXCEPTIONS: dict[int, Callable[[], BaseException]] = {
    signal.SIGINT: KeyboardInterrupt,
    signal.SIGTERM: lambda: SystemExit(TERMINATED),
}


def end_at_once() -> None:
    """Let Ctrl-C end the program with one line, from now until `ended_by_signals`: while libraries are imported, which
    make errors of their own of a KeyboardInterrupt. Ignored signals stay ignored."""

    def ended(*_: object) -> None:
        os.write(2, b"hdplan: interrupted before anything was found\n")
        os._exit(INTERRUPTED)

    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, ended)


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let Ctrl-C (KeyboardInterrupt) and `kill` (SystemExit) end the block, even where the exception is dropped.

    An error that a library makes of Ctrl-C in its callback counts as Ctrl-C. Ignored signals stay ignored.
    """
    ending: Callable[[], BaseException] | None = None

    def on_signal(number: int, _: object) -> None:
        nonlocal ending
        ending = EXCEPTIONS[number]
        _alarm(RERAISE_DELAY)
        raise ending()

    def again(*_: object) -> None:
        if ending is not None and not _propagating():
            raise ending()

    def unraisable(lost: Any) -> None:
        if not issubclass(lost.exc_type, KeyboardInterrupt | SystemExit):  # these are raised again
            hook(lost)

    hook = sys.unraisablehook
    asking = [number for number in EXCEPTIONS if signal.getsignal(number) is not signal.SIG_IGN]
    handlers: dict[int, Callable[..., None]] = dict.fromkeys(asking, on_signal)
    if sys.platform != "win32":
        handlers[signal.SIGALRM] = again
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    sys.unraisablehook = unraisable
    try:
        yield
    except Exception as error:
        if ending is None:
            raise
        raise ending() from error
    finally:
        _alarm(0.0)
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)


@contextlib.contextmanager
def until_ctrl_c() -> Iterator[None]:
    """Treat Ctrl-C as the regular end of the block."""
    try:
        yield
    except KeyboardInterrupt:
        _alarm(0.0)  # handled


def _alarm(seconds: float) -> None:
    """Set an alarm, again and again, or none; Windows has no alarms, and there an exception that is dropped is lost."""
    if sys.platform != "win32":
        signal.setitimer(signal.ITIMER_REAL, seconds, seconds)


def _propagating() -> bool:
    """True if the exception is propagating already: what runs now is cleaning up."""
    error = sys.exception()
    while error is not None and not isinstance(error, KeyboardInterrupt | SystemExit):
        error = error.__context__
    return error is not None


class Note:
    """Notes Ctrl-C after the first call; a second Ctrl-C ends the command at once."""

    def __init__(self) -> None:
        """Leave the signal's handler as it is until the first call."""
        self._event = threading.Event()
        self.pressed = self._event.is_set
        self.before = signal.getsignal(signal.SIGINT) or signal.SIG_DFL

    def __call__(self) -> None:
        """Begin to note, in place of a solver's own handler too, or begin again after a library has restored the
        handler."""
        if not self._event.is_set() and signal.getsignal(signal.SIGINT) != self._note:
            signal.signal(signal.SIGINT, self._note)

    def _note(self, *_: object) -> None:
        self._event.set()
        signal.signal(signal.SIGINT, self.before)


@contextlib.contextmanager
def noting() -> Iterator[Note]:
    """Note Ctrl-C within the block, and restore the signal's handler after it."""
    note = Note()
    try:
        yield note
    finally:
        signal.signal(signal.SIGINT, note.before)
