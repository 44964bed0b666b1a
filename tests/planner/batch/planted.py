"""Problems that end their worker; workers import them from here."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Mapping
from typing import Any

from hdplan.planner.batch import outcome
from hdplan.planner.batch.job import Job
from hdplan.scenes.scene import Scene

PATIENCE = 0.0, 1.0  # of a worker that is given one that hangs


class Crashing(Job):
    def load(self) -> Scene:
        os.kill(os.getpid(), signal.SIGSEGV)
        raise AssertionError


class Broken(Job):
    def load(self) -> Scene:
        raise ValueError("planted\nerror")


class Hanging(Job):
    def load(self) -> Scene:
        threading.Event().wait()
        raise AssertionError

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        outcome.PATIENCE = PATIENCE
        self.__dict__.update(state)
