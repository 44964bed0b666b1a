"""Planning a job for the browser, in a thread of its own: of several requested scenes, the newest."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from hdplan.planner.job.planning import plan_job
from hdplan.planner.job.result import JobResult
from hdplan.planner.search.search import Event
from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.newest import Newest
from hdplan.planner.view.words import failure_words

Run = Callable[[Callable[[Event], None], Callable[[], bool]], JobResult]
"""A maker of plans, given what takes its events, and what tells whether to stop."""
SAY_EVERY = 0.5  # [s]
Done = Callable[[EditedJob, EditedJob | None, str], object]


class JobPlanning:
    """The thread that plans."""

    def __init__(self, say: Callable[[str], object], done: Done) -> None:
        """Start it. `say` is called with its progress, and `done` with a scene, that scene with its motion, or None and
        the reason why there is none; both by this thread."""
        self._say, self._done = say, done
        self._newest: Newest[EditedJob] = Newest("hdplan-plan", self._plan)
        self._elsewhere = False  # whether one is planned by `follow`, and shown here
        self._stopped = threading.Event()

    @property
    def running(self) -> bool:
        """True if a job is being planned, or is to be."""
        return self._elsewhere or self._newest.running

    def ask(self, edited: EditedJob) -> None:
        """Request a plan of a job; one that is being planned is given up."""
        self._newest.ask(edited)

    def stop(self) -> None:
        """Stop with what was planned so far, here or elsewhere."""
        self._stopped.set()
        self._newest.give_up()

    def give_up(self) -> None:
        """Stop what is planned here, as it is of another scene by now."""
        self._newest.give_up()

    def follow(self, edited: EditedJob, run: Run) -> JobResult:
        """Make a plan elsewhere: `run` is called, by this thread, with what takes its events and what tells whether to
        stop. Returns its result, or raises what it raises, and has it reported."""
        self._elsewhere = True
        self._stopped.clear()
        try:
            result = run(self._report(), self._stopped.is_set)
        except BaseException as error:  # among them Ctrl-C
            self._elsewhere = False
            self._done(edited, None, failure_words(edited.scene, error))
            raise
        found = edited.done(result.trajectory, result.certificate, result.failure)
        self._elsewhere = False
        self._done(edited, found, "")
        return result

    def end(self) -> None:
        """Stop, and end the thread."""
        self._newest.end()

    def _plan(self, edited: EditedJob, turn: int) -> Callable[[], object] | None:
        found, why = self._planned(edited, turn)
        newer = self._newest.waits or self._newest.ended
        return None if newer else lambda: self._done(edited, found, why)

    def _planned(self, edited: EditedJob, turn: int) -> tuple[EditedJob | None, str]:
        def stop() -> bool:
            return self._newest.given_up(turn) or self._newest.waits

        try:
            result = plan_job(edited.scene, report=self._report(), stop=stop)
            return edited.done(result.trajectory, result.certificate, result.failure), ""
        except Exception as error:  # of a library, too: the viewer continues
            return None, failure_words(edited.scene, error)

    def _report(self) -> Callable[[Event], None]:
        """Return the receiver of the events of a plan that begins now, which shows its progress."""
        began = reported = time.monotonic()
        iterations = 0

        def report(event: Event) -> None:
            nonlocal reported, iterations
            iterations += event.step is not None
            if (now := time.monotonic()) > reported + SAY_EVERY:
                reported = now
                self._say(f"planning the job, {now - began:.0f} s, {iterations} iterations …")

        return report
