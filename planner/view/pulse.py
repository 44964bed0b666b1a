"""The pulse of the closest pair, and the age of what a robot reported last, while anybody looks: a few small messages a
second."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

MESSAGE_STEP, PERIOD = 0.15, 1.2  # [s] between its messages, and of the whole pulse


class Pulse:
    """The thread that beats it."""

    def __init__(self, viewer: Viewer) -> None:
        """Start it."""
        self._viewer = viewer
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="hdplan-pulse", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        viewer = self._viewer
        while not self._ended.wait(MESSAGE_STEP):
            if viewer.server.get_clients():
                viewer.worker.ask("pulse", self._beat)

    def _beat(self) -> None:
        viewer = self._viewer
        viewer.stage.closest.pulse(time.monotonic() / PERIOD % 1.0)
        viewer.stage.name(viewer.reported.newest)  # perhaps one that is getting old
