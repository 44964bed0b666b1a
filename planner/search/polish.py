"""Better motions, in rounds: each improves one motion, and its result is kept only if it is certified and better.

Better is less of what `Scene.objective` requires (`objective`). The first round improves the motion as it is, where
time counts before its certificate, which is for what comes of it (`first_motion`). Each that follows improves the most
promising of what is left (`Ways`) and of MORE motions from further guesses, to each goal in turn, or of WAYS where
nothing is left, none of which is one of those before (SAME_WAY): perhaps there is a better way around, or a better
goal. To improve a motion is to solve until it has converged, with the
penalty setting in ever closer to obstacles (CLOSER_ACTIVATIONS), where time is the objective with the cost of its path
speed, and with its end sliding along the goal set; and at last, where that leaves more to gain, with the duration of
the fastest law itself (`PathDuration`), which also knows accelerations and torques. What promises most is retimed and
certified; if it is not certified, the next.

Rounds are counted, not timed, so that the same seed gives the same motion on every machine.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.assemble import EVEN, closer, exactly
from hdplan.planner.problem.path_duration import PathDuration
from hdplan.planner.problem.path_speed import PathSpeed
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.smoothness import Smoothness
from hdplan.planner.search.guesses import Guess
from hdplan.planner.search.roadmap import seeds
from hdplan.planner.search.search import Search
from hdplan.planner.search.touches import NOTHING_LEFT
from hdplan.planner.solvers.methods import gauss_newton
from hdplan.planner.solvers.solution import DETOUR_WEIGHT, FIRST_WEIGHT, SolverStatus, ends_overlap
from hdplan.scenes.array_types import Array

CLOSER_ACTIVATIONS = (0.5, 0.2)  # of the activation
LEAST_ACTIVATION = 1e-3  # [m] of it
MOST_REPEATS = 2  # of the last stage,
REPEATED_GAIN = 0.01  # [–] as long as the one before it gained this much
GAIN = 1e-3  # [–] by which a motion must be better than another to take its place
UNCHANGED_STEP = 1e-4  # [rad] or [m] by which a motion changes at most that does not
# weight of the acceleration [–] beside the duration: with half of it, laws are stretched for their jerk
HURRIED_WEIGHT = 0.06
CONVERGED = 1e-4  # relative decrease of the cost by a step, below which a motion has converged
LONGEST_SLIDE = 0.3  # [rad] or [m] that an end may slide at once
SLIDE_FACTOR = 0.3  # on this length where a slide did not help
SAME_WAY = 0.05  # [rad] or [m] between two ways, at most, that are one
WAYS, MORE = 8, 4  # that are compared in a round, before the most promising one is improved


class Stages:
    """Problems to each goal, for a first guess and, with penalties that begin ever closer to obstacles, for the
    resulting motion. Their distances are exact where the bodies overlap at an end: what is too loose there bars the
    best way, or moves it."""

    def __init__(self, searches: Sequence[Search]) -> None:
        """Take the searches; a problem is assembled on first use."""
        self.searches = searches
        self._first: dict[int, Problem] = {}
        self._closer: dict[int, tuple[Problem, ...]] = {}

    def first(self, i: int) -> Problem:
        """Return the problem of search i for a first guess."""
        if i not in self._first:
            problem = self.searches[i].problem
            self._first[i] = exactly(problem) if ends_overlap(problem) else problem
        return self._first[i]

    def __getitem__(self, i: int) -> tuple[Problem, ...]:
        """Return the problems of search i that follow it."""
        if i not in self._closer:
            search = self.searches[i]
            activation = search.problem.scene.planner.activation
            chosen = [share * activation for share in CLOSER_ACTIVATIONS if share * activation >= LEAST_ACTIVATION] or [
                activation
            ]
            made = (closer(search.problem, each, search.objective.name == "time") for each in chosen)
            self._closer[i] = tuple(exactly(each) if self.first(i).exact else each for each in made)
        return self._closer[i]


class Way(NamedTuple):
    """A motion to a goal that may be improved."""

    promise: float  # a lower bound of the objective along it
    search: int  # to which goal
    path: Array  # (N, n)


class Ways:
    """The motions that were found so far, and those of them that were improved."""

    def __init__(self) -> None:
        """Begin with none."""
        self.found: list[Way] = []
        self.improved: list[Array] = []  # (N, n) as they were before

    @property
    def promise(self) -> float:
        """The least promise of those that are left."""
        return min((way.promise for way in self.found), default=np.inf)

    def take(self) -> Way | None:
        """Return the most promising one of those that were not improved, nor are like one that was; None if none is
        left."""
        self.found = [
            way for way in self.found if all(np.abs(way.path - other).max() > SAME_WAY for other in self.improved)
        ]
        if not self.found:
            return None
        way = self.found.pop(min(range(len(self.found)), key=lambda k: self.found[k][:2]))
        self.improved.append(way.path)
        return way


def first_motion(searches: Sequence[Search], stages: Stages, seed: int, ways: Ways) -> None:
    """First motion of a search in which time counts: solve from the first guess to each goal that may be reached sooner
    than the ways before it promise, and certify what the most promising of these is improved to, or else itself, or
    else the next. The others are left for `polish`.

    Raises KeyboardInterrupt as the user does, once what was found is certified."""
    interrupted = False
    least = min(search.objective.least(search.problem) for search in searches)
    for i, search in enumerate(searches):
        if search.over or interrupted or search.objective.least(search.problem) >= ways.promise:
            continue
        search.begin()
        path, status = search.led(stages.first(i), next(seeds(search.problem, seed)), FIRST_WEIGHT)
        interrupted = status is SolverStatus.INTERRUPTED
        if status is SolverStatus.CLEAR:
            ways.found.append(Way(search.objective.least_along(path), i, path))
    while (way := ways.take()) is not None:
        search, path = searches[way.search], way.path
        if not (motions := search.timed(path, np.inf)):
            continue
        value = search.objective.value(path, motions[0])
        better = not interrupted and value > (1.0 + NOTHING_LEFT) * least
        if (better and _improve(search, stages[way.search], path, value)) or search.keep(path, motions):
            break
    if interrupted and not searches[0].stop():
        raise KeyboardInterrupt  # which the solver turned into a status: what was found before counts


def polish(searches: Sequence[Search], taken: int, stages: Stages, seed: int, ways: Ways) -> None:
    """Better the certified motion of search `taken`, one of several to different goals, in the scene's rounds: the
    search with the best motion has another one then, or another search a better one. Where one of the `ways` was
    improved, or it had its last touches, that was the first round."""
    further = _further(searches, seed)
    for turn in range(searches[taken].problem.scene.polish):
        best, value = searches[taken].best, searches[taken].value
        assert best is not None
        least = min(search.objective.least(search.problem) for search in searches)
        if searches[taken].over or value <= (1.0 + NOTHING_LEFT) * least:
            break
        if turn == 0:
            if not ways.improved:
                ways.improved.append(best.path)
                if not searches[taken].touched:
                    _improve(searches[taken], stages[taken], best.path, value)
            continue
        for i, draw in itertools.islice(further, MORE if ways.found else WAYS):
            search = searches[i]
            if search.objective.least(search.problem) >= value:
                continue
            guess = draw()
            search.begin()
            if solution := search.clear(stages.first(i), guess.positions, guess.weight):
                path = solution.trajectory.positions
                ways.found.append(Way(search.objective.least_along(path), i, path))
        if (way := ways.take()) is not None:
            search = searches[way.search]
            if not search.objective.unimprovable(way.promise, value) and _improve(
                search, stages[way.search], way.path, value
            ):
                taken = way.search


def _improve(search: Search, stages: Sequence[Problem], path: Array, value: float) -> bool:
    """Go on from a motion (N, n) through problems to its goal, one after the other, each from where the one before it
    led, and its end slid to where that helps, the last again where much was gained; keep the most promising motion that
    is certified, if it costs less than `value`."""
    promise, goal, farthest = search.objective.least_along, path[-1], LONGEST_SLIDE
    found: list[tuple[float, Array]] = []
    led = [np.inf]  # what each stage promised
    for turn, stage in enumerate([*stages, *MOST_REPEATS * [stages[-1]]]):
        if turn >= len(stages) and led[-1] > (1.0 - REPEATED_GAIN) * led[-2]:
            break
        problem = replace(stage, goal=goal)
        solution = search.clear(problem, path, DETOUR_WEIGHT, CONVERGED)
        if solution is None:
            break
        before, path = path, solution.trajectory.positions
        if (
            found and np.abs(path - before).max() < UNCHANGED_STEP
        ):  # nothing is close: it is the same for those that follow
            break
        found.append((promise(path), path))
        end = search.slide(problem, solution, farthest) if search.slide else None
        if end is not None:
            moved = path + np.linspace(0.0, 1.0, len(path))[:, None] * (end - goal)
            solution = search.clear(replace(stage, goal=end), moved, solution.weight, CONVERGED)
            slid = promise(solution.trajectory.positions) if solution else np.inf
            if solution and slid < found[-1][0]:
                found.append((slid, path := solution.trajectory.positions))
                goal = end
            else:
                farthest *= SLIDE_FACTOR
        led.append(found[-1][0])
    found.sort(key=lambda each: each[0])
    enough = (1.0 - GAIN) * value
    return any(search.keep(path, motions) for path, motions in _timed(search, stages[-1], found, enough))


def _timed(
    search: Search, stage: Problem, found: Sequence[tuple[float, Array]], enough: float
) -> Iterator[tuple[Array, Sequence[Trajectory]]]:
    """Yield paths (N, n) of those found, with their promises in order, and motions along them that cost less than
    `enough`. Where time counts, the first is what the most promising one is hurried to, or itself if its motion is
    quicker: promises know of no jerk."""
    ahead = found[:1]
    if ahead and (hurried := _hurried(search, stage, *ahead[0])):
        ahead = [hurried, *ahead]
    timed = [(path, search.timed(path, enough)) for least, path in ahead if least < enough]
    timed = [each for each in timed if each[1]]
    yield from sorted(timed, key=lambda each: search.objective.value(each[0], each[1][0]))
    for least, path in found[1:]:
        if least >= enough or (least > 0.0 and not timed):  # those behind one without motions promise even less
            break
        timed = [(path, motions)] if (motions := search.timed(path, enough)) else []
        yield from timed


def _hurried(search: Search, stage: Problem, promise: float, path: Array) -> tuple[float, Array] | None:
    """Go on from a motion (N, n) with the duration of the fastest law as the cost; return what it leads to, with its
    promise. None if that is no better, or if there is little to gain: where the law takes no longer than the slowest
    joint needs with its jerk."""
    retimer, speed = search.retimer, stage.path_speed
    if retimer is None or not isinstance(speed, PathSpeed) or not retimer.slopes_known:
        return None
    if not retimer.shortest(path[0], path[-1]) < promise < np.inf:
        return None
    cost, smoothness = PathDuration(speed, retimer.slope_along), Smoothness(stage.waypoints, HURRIED_WEIGHT, EVEN)
    problem = replace(stage, goal=path[-1], path_speed=cost, smoothness=smoothness)
    solution = search.clear(problem, path, DETOUR_WEIGHT, CONVERGED, gauss_newton.SOLVER)
    if solution is None:
        return None
    path = solution.trajectory.positions
    better = search.objective.least_along(path)
    return (better, path) if better < promise else None


def _further(searches: Sequence[Search], seed: int) -> Iterator[tuple[int, Callable[[], Guess]]]:
    """Yield a search and what draws a guess for it, in turn, without end; the first guesses of untried goals come
    first. A guess that is not used costs nothing."""
    ways = [seeds(search.problem, seed + 1) for search in searches]
    lines = [next(guesses) for guesses in ways]
    for i, line in enumerate(lines):
        if not searches[i].attempts:
            yield i, functools.partial(Guess, line, FIRST_WEIGHT)
    while True:
        yield from ((i, lambda guesses=guesses: Guess(next(guesses))) for i, guesses in enumerate(ways))
