"""One thread that does what the browsers request, so that no two threads touch the viewer at once.

Requests come faster than they can be handled (a slider sends one for every pixel), so only the newest of each kind
waits; kinds take turns in the order of their first request. An urgent one goes before them, though never twice in a row
while others wait.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable

Job = Callable[[], None]


class Worker:
    """Does jobs one after the other; of waiting jobs of one kind only the newest is done."""

    def __init__(self, complain: Callable[[Exception], None]) -> None:
        """Start the thread; `complain` is called with a job that failed, and the next one is done."""
        self._complain = complain
        self._waiting: dict[str, Job] = {}
        self._urgent: set[str] = set()
        self._was_urgent = False  # the last one
        self._doing = ""  # the kind under way
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="hdplan-view", daemon=True)
        self._thread.start()

    def ask(self, kind: str, job: Job, urgent: bool = False) -> None:
        """Request a job; one of the same kind that still waits is dropped. An `urgent` kind goes before others: for
        short jobs that come steadily, as the frames of a motion do."""
        with self._changed:
            self._waiting[kind] = job
            if urgent:
                self._urgent.add(kind)
            self._changed.notify_all()

    def done(self, kind: str, timeout: float) -> bool:
        """Wait until nothing of a kind is left to do; False if that takes longer than `timeout` [s]."""
        with self._changed:
            return self._changed.wait_for(
                lambda: self._ended or not (kind in self._waiting or kind == self._doing), timeout
            )

    def settle(self, timeout: float | None = None) -> bool:
        """Wait until nothing is left to do; False if that takes longer than `timeout` [s]. Not from within a job."""
        with self._changed:
            return self._changed.wait_for(lambda: self._ended or not (self._waiting or self._doing), timeout)

    def end(self) -> None:
        """Drop what waits and end the thread once the job under way is done."""
        with self._changed:
            self._waiting.clear()
            self._ended = True
            self._changed.notify_all()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: bool(self._waiting) or self._ended)
                if self._ended:
                    return
                self._doing = self._next()
                job = self._waiting.pop(self._doing)
            try:
                job()
            except Exception as error:  # one bad request must not end the viewer
                with contextlib.suppress(Exception):  # nor does its message
                    self._complain(error)
            finally:
                with self._changed:
                    self._doing = ""
                    self._changed.notify_all()

    def _next(self) -> str:
        """Return the kind whose turn it is: the first urgent one, or after such a one the first of the others."""
        kind = min(self._waiting, key=lambda kind: (kind in self._urgent) == self._was_urgent)
        self._was_urgent = kind in self._urgent
        return kind
