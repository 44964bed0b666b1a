"""One thread that works on the newest request: outdated requests are dropped.

`Worker` does short jobs for whoever asks; this one does what takes seconds, as planning does, and lets it be given up.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Wish = TypeVar("Wish")
After = Callable[[], object]


class Newest(Generic[Wish]):
    """The newest wish, and the thread that works on it."""

    def __init__(self, name: str, work: Callable[[Wish, int], After | None], patience: float = 30.0) -> None:
        """Start the thread of this name. `work` is called with a wish and its turn, checks now and then whether this is
        `given_up`, and returns a function to be called after it has ended, or None. `end` waits for it so long [s]."""
        self._work, self._patience = work, patience
        self._changed = threading.Condition()
        self._wishes: list[Wish] = []  # at most one
        self._turn = 0  # how often what is worked on was given up
        self._busy = self.ended = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def waits(self) -> bool:
        """True if a newer request waits than the current one."""
        return bool(self._wishes)

    @property
    def running(self) -> bool:
        """True if something is worked on, or is to be."""
        return self._busy or self.waits

    def given_up(self, turn: int) -> bool:
        """True if what began in this turn comes too late."""
        return self.ended or turn != self._turn

    def ask(self, wish: Wish) -> None:
        """Request work on a wish, in place of one that waits."""
        with self._changed:
            self._wishes = [wish]
            self._changed.notify_all()

    def give_up(self) -> None:
        """Drop the waiting request, and give up the current one."""
        with self._changed:
            self._wishes = []
            self._turn += 1

    def settle(self, timeout: float) -> bool:
        """Wait until no work is left; False if that takes longer than `timeout` [s]."""
        with self._changed:
            return self._changed.wait_for(lambda: not self.running, timeout)

    def end(self) -> None:
        """Give up, and end the thread."""
        with self._changed:
            self._wishes, self.ended = [], True
            self._changed.notify_all()
        self._thread.join(timeout=self._patience)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self.waits or self.ended)
                if self.ended:
                    return
                wish, turn, self._busy = self._wishes.pop(), self._turn, True
            after: After | None = None
            try:
                after = self._work(wish, turn)
            finally:
                with self._changed:
                    self._busy = False
                    self._changed.notify_all()
            if after is not None:
                after()
