"""Planning a job for the browser, in a thread of its own: of several scenes that are asked for, the newest."""

from __future__ import annotations

import time
from collections.abc import Callable

from hdplan.planner.job.planning import plan_job
from hdplan.planner.search.search import Event
from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.newest import Newest
from hdplan.scenes.errors import HdplanError

SAY_EVERY = 0.5  # [s]
Done = Callable[[EditedJob, EditedJob | None, str], object]


class JobPlanning:
    """The thread that plans."""

    def __init__(self, say: Callable[[str], object], done: Done) -> None:
        """Start it. `say` is called with how it goes on, and `done` with a scene, the same with its motion, or None and
        why there is none; both by this thread."""
        self._say, self._done = say, done
        self._newest: Newest[EditedJob] = Newest("hdplan-plan", self._plan)

    @property
    def running(self) -> bool:
        """True if a job is being planned, or is to be."""
        return self._newest.running

    def ask(self, edited: EditedJob) -> None:
        """Have a job planned; one that is being planned is given up."""
        self._newest.ask(edited)

    def stop(self) -> None:
        """Stop with what was planned so far."""
        self._newest.give_up()

    def end(self) -> None:
        """Stop, and end the thread."""
        self._newest.end()

    def _plan(self, edited: EditedJob, turn: int) -> Callable[[], object] | None:
        found, why = self._planned(edited, turn)
        newer = self._newest.waits or self._newest.ended
        return None if newer else lambda: self._done(edited, found, why)

    def _planned(self, edited: EditedJob, turn: int) -> tuple[EditedJob | None, str]:
        began = said = time.monotonic()
        iterations = 0

        def report(event: Event) -> None:
            nonlocal said, iterations
            iterations += event.step is not None
            if (now := time.monotonic()) > said + SAY_EVERY:
                said = now
                self._say(f"planning the job, {now - began:.0f} s, {iterations} iterations …")

        def stop() -> bool:
            return self._newest.given_up(turn) or self._newest.waits

        try:
            result = plan_job(edited.scene, report=report, stop=stop)
            return edited.done(result.trajectory, result.certificate, result.failure), ""
        except HdplanError as error:
            return None, str(error).removeprefix(f"{edited.scene.source}: ")
        except Exception as error:  # of a library: the viewer continues
            return None, f"{type(error).__name__}: {error}"
