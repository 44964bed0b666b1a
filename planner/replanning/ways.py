"""Ways that are requested beside the steps: the time of a request, its answer, and the place where the robot joins
it."""

from __future__ import annotations

import math
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from hdplan.planner.replanning.held import Held
from hdplan.planner.replanning.nominal import Course
from hdplan.planner.replanning.outlook import Answer, Question, outlook
from hdplan.planner.replanning.picture import Sightings
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.scene import Scene

AHEAD, MOST_AHEAD = 0.1, 1.0  # [s] of the nominal motion before its rest is replaced, at least and at most
LEAST_LEAD = 0.7  # of the last lead: the next one is at least this share of it
LEAD_PER_ANSWER = 1.3  # lead over the time of the last answer
SEARCH_PAUSE = 0.2  # [s] from a way that was not found, or did not help, to the next search


class Ways:
    """The ways of one replanner; its steps alone use them."""

    def __init__(self, robot: Robot, executor: Executor | None) -> None:
        """Take the executor of the search; None: a thread that is made when it is needed."""
        self.robot, self._executor, self._own = robot, executor, executor is None
        self.reaches = True  # whether the way that is driven leads to the goal
        self.why = ""  # no way was found
        self._pending: Future[Answer] | None = None
        self._question: Question | None = None  # what it asks: one that comes back from another process is a copy
        self._pending_view: Sightings | None = None
        self._pending_since, self._not_before, self._lead = -math.inf, -math.inf, AHEAD
        self._waiting: Answer | None = None  # a way that is not driven yet

    def close(self) -> None:
        """End its own thread."""
        if self._own and self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None

    def forget(self, reaches: bool) -> None:
        """Drop the request and its answer; `reaches` says whether the way that is driven leads to the goal."""
        self._pending, self._waiting, self._not_before, self.reaches = None, None, -math.inf, reaches

    def arrives(self, course: Course | None) -> bool:
        """True if the law of a course ends at the goal."""
        return course is not None and self.reaches and course.arrives

    def hear(self, now: float, held: Held, course: Course | None, row: int) -> Course | None:
        """Take an answer, and return the course from a row of the clock: on a new way, where all that is held would
        be the same on it."""
        if self._pending is not None and self._pending.done():
            future, self._pending = self._pending, None
            answer, self.why = _heard(future)
            self._lead = min(
                max(AHEAD, LEAST_LEAD * self._lead, LEAD_PER_ANSWER * (now - self._pending_since)), MOST_AHEAD
            )
            self._waiting = None
            if answer is not None and answer.way is not None and self._question is not None:
                self._waiting = replace(answer, question=self._question)
            if self.why:
                self._not_before = now + SEARCH_PAUSE
        joined = self.waiting(held, course, row)
        if joined is None or self._waiting is None:
            if self._waiting is None or not _stops_there(held, self._waiting.question):
                self._waiting = None
            return course
        if self._waiting.question.standing is None and joined.law[-1, 0] > self._waiting.question.begins:
            return course
        self.taken()
        return joined

    def waiting(self, held: Held, course: Course | None, row: int) -> Course | None:
        """Return the course along the waiting way from a row of the clock; None if there is none, or the
        robot is past its beginning."""
        if self._waiting is None or (way := self._waiting.way) is None:
            return None
        question = self._waiting.question
        if question.standing is not None:
            stands = row >= held.last and _stops_there(held, question)
            return Course(way, row, np.array([[way.begins, 0.0, 0.0]])) if stands else None
        if course is None or course.nominal is not question.nominal:
            return None
        s = float(course.at(row)[0])
        if s > question.begins:
            return None
        return Course(course.nominal.continued(s, question.row, way), course.first, course.law)

    def taken(self) -> None:
        """Note that the robot drives the way that was waiting."""
        self._waiting, self.reaches = None, True

    def ask(
        self,
        scene: Scene,
        seen: Sightings,
        now: float,
        horizon: float,
        held: Held,
        course: Course | None,
        row: int,
        moves: bool,
    ) -> None:
        """Request the way, if nothing is on its way already and something is new: the world, or that no motion is
        proven for a while."""
        if self._pending is not None or self._waiting is not None or now < self._not_before:
            return
        new = seen is not self._pending_view or (not moves and now >= self._pending_since + SEARCH_PAUSE)
        if course is not None and self.reaches and (course.arrives or not new):
            return
        standing = None if course is not None and moves else held.stop
        at = 0
        if course is not None:
            s = float(course.at(row)[0]) + self._lead if standing is None else float(course.law[-1, 0])
            at = course.nominal.row_after(s)
        nominal, new_goal = (None, True) if course is None else (course.nominal, not self.reaches)
        question = Question(scene, self.robot, seen, now, horizon, nominal, new_goal, at, standing, stuck=not moves)
        if self._executor is None:
            self._executor = ThreadPoolExecutor(1, thread_name_prefix="hdplan-outlook")
        self._question, self._pending_since, self._pending_view = question, now, seen
        try:
            self._pending = self._executor.submit(outlook, question)
        except RuntimeError as error:  # it was shut down
            self.why, self._not_before = f"no way is searched: {error}", now + SEARCH_PAUSE


def _stops_there(held: Held, question: Question) -> bool:
    """True if what is held ends where the way of an answer begins at rest."""
    return question.standing is not None and np.array_equal(held.stop, question.standing)


def _heard(future: Future[Answer]) -> tuple[Answer | None, str]:
    """Return an answer, and why it holds no way. A search that failed, in whatever way, holds none: the step that hears
    of it has a command to give."""
    try:
        answer = future.result()
    except Exception as error:
        return None, f"no way was found: the search for it ended with {type(error).__name__}: {error}"
    return answer, answer.why
