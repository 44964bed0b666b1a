"""Planning a job for the browser, in a thread of its own: of several scenes that are asked for, the newest."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from hdplan.planner.job.planning import plan_job
from hdplan.planner.search.search import Event
from hdplan.planner.view.edited_job import EditedJob
from hdplan.scenes.errors import HdplanError

SAY_EVERY = 0.5  # [s]
Done = Callable[[EditedJob, EditedJob | None, str], object]


class JobPlanning:
    """The thread that plans."""

    def __init__(self, say: Callable[[str], object], done: Done) -> None:
        """Start it. `say` is called with how it goes on, and `done` with a scene, the same with its motion, or None and
        why there is none; both by this thread."""
        self._say, self._done = say, done
        self._changed = threading.Condition()
        self._wish: EditedJob | None = None
        self._busy = self._stopped = self._ended = False
        self._thread = threading.Thread(target=self._run, name="hdplan-plan", daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """True if a job is being planned, or is to be."""
        return self._busy or self._wish is not None

    def ask(self, edited: EditedJob) -> None:
        """Have a job planned; one that is being planned is given up."""
        with self._changed:
            self._wish = edited
            self._changed.notify_all()

    def stop(self) -> None:
        """Stop with what was planned so far."""
        with self._changed:
            self._wish, self._stopped = None, True

    def end(self) -> None:
        """Stop, and end the thread."""
        with self._changed:
            self._wish, self._ended = None, True
            self._changed.notify_all()
        self._thread.join(timeout=30.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wish is not None or self._ended)
                if self._ended or self._wish is None:
                    return
                edited, self._wish = self._wish, None
                self._busy, self._stopped = True, False
            found, why = self._planned(edited)
            with self._changed:
                self._busy = False
                newer = self._wish is not None or self._ended
            if not newer:
                self._done(edited, found, why)

    def _planned(self, edited: EditedJob) -> tuple[EditedJob | None, str]:
        began = said = time.monotonic()
        iterations = 0

        def report(event: Event) -> None:
            nonlocal said, iterations
            iterations += event.step is not None
            if (now := time.monotonic()) > said + SAY_EVERY:
                said = now
                self._say(f"planning the job, {now - began:.0f} s, {iterations} iterations …")

        def stop() -> bool:
            return self._ended or self._stopped or self._wish is not None

        try:
            result = plan_job(edited.scene, report=report, stop=stop)
            return edited.done(result.trajectory, result.certificate, result.failure), ""
        except HdplanError as error:
            return None, str(error).removeprefix(f"{edited.scene.source}: ")
        except Exception as error:  # of a library: the viewer continues
            return None, f"{type(error).__name__}: {error}"
