"""One thread that does what the browsers request, so that no two threads touch the viewer at once.

Requests come faster than they can be handled (a slider sends one for every pixel), so only the newest of each kind
waits; kinds take turns in the order of their first request.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

Job = Callable[[], None]


class Worker:
    """Does jobs one after the other; of waiting jobs of one kind only the newest is done."""

    def __init__(self, complain: Callable[[Exception], None]) -> None:
        """Start the thread; `complain` is told of a job that failed, and the next one is done."""
        self._complain = complain
        self._waiting: dict[str, Job] = {}
        self._changed = threading.Condition()
        self._busy = self._ended = False
        self._thread = threading.Thread(target=self._run, name="hdplan-view", daemon=True)
        self._thread.start()

    def ask(self, kind: str, job: Job) -> None:
        """Have a job done; one of the same kind that still waits is dropped."""
        with self._changed:
            self._waiting[kind] = job
            self._changed.notify_all()

    def settle(self, timeout: float | None = None) -> bool:
        """Wait until nothing is left to do; False if that takes longer than `timeout` [s]. Not from within a job."""
        with self._changed:
            return self._changed.wait_for(lambda: self._ended or not (self._waiting or self._busy), timeout)

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
                job = self._waiting.pop(next(iter(self._waiting)))
                self._busy = True
            try:
                job()
            except Exception as error:  # one bad request must not end the viewer
                self._complain(error)
            finally:
                with self._changed:
                    self._busy = False
                    self._changed.notify_all()
