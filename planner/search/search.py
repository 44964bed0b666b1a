"""The search of one plan: guess, solve, certify; where the certificate fails, sample more densely there, or continue
from the next guess (`guesses.py`).

A motion counts as found only when it is certified: the certificate works with the robot's real meshes, the solver with
outer bodies at samples, and neither relies on the other.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.assemble import more_closely
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.guesses import Guess
from hdplan.planner.search.objective import objective_of
from hdplan.planner.search.touches import once_more, touched
from hdplan.planner.solvers.solution import (
    RAISE,
    SLOW_DECREASE,
    Budget,
    Iteration,
    Solution,
    Solver,
    SolverStatus,
    is_clear,
)
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import seconds_left
from hdplan.scenes.errors import HdplanError

if TYPE_CHECKING:
    from hdplan.planner.timing.retiming import Retimer

DENSER_ROUNDS = 2  # times that solving continues at denser samples, before a certificate
# relative difference of the costs of a motion and the one from which it was begun, if little changed
LITTLE_CHANGE = 0.05
# activations that a later guess may be inside something where weights free it little: of 660 runs of all guesses some
# 176 were deeper, and one of these was freed by higher weights
STUCK_FACTOR = 3.0
REPAIRS = 3  # times that solving continues from a motion whose certificate failed, before the next guess
CONTACTS = {Status.IN_CONTACT, Status.TOO_CLOSE, Status.NOT_PROVEN}


@dataclass(frozen=True)
class Event:
    """Progress, for displays: a solver's step, or a certificate."""

    attempt: int
    step: Iteration | None = None
    positions: Array | None = None  # (N, n) the waypoints after that step; to be kept, but not changed
    certificate: Certificate | None = None
    motion: Trajectory | None = None  # the motion of the certificate


Slide = Callable[[Problem, Solution, float], Array | None]  # a motion's better end, at most so far away


class Best(NamedTuple):
    """The best motion so far."""

    path: Array  # (N, n) the waypoints
    trajectory: Trajectory  # along them, with times where the scene requires them
    certificate: Certificate
    steps: tuple[Iteration, ...]
    whole: bool  # whether the certificate names every failure
    left: tuple[str, ...] = ()  # the user's own constraints that it leaves, each with how far


class Search:
    """The attempts of one plan: what they cost, and the best motion among them."""

    def __init__(
        self,
        problem: Problem,
        certifier: Certifier,
        retimer: Retimer | None,
        solver: Solver,
        required: float,
        deadline: float,
        report: Callable[[Event], None],
        stop: Callable[[], bool],
        slide: Slide | None = None,
    ) -> None:
        """Search for a motion that keeps `required` [m], until `deadline` (time.perf_counter()). `slide` finds better
        ends for it where the goal leaves a choice."""
        self.problem, self.certifier, self.retimer = problem, certifier, retimer
        self.solver, self.required = solver, required
        self.objective = objective_of(problem, retimer)
        self.deadline, self.report, self.stop, self.slide = deadline, report, stop, slide
        self.last: Solution | None = None  # solved, not yet certified
        self.best: Best | None = None
        self.steps: tuple[Iteration, ...] = ()  # of the attempt under way
        self.attempts = self.iterations = 0
        self.touches = problem.scene.polish > 0 and self.objective.name == "smoothness" and slide is None
        self.touched = False  # whether the best motion got its last touches
        self.reconsidered = False  # whether CHOMP gave a second opinion
        self.settled = False  # whether a warm start led to a motion like the last one: there is nothing to improve
        self.passed = False  # whether a motion was found that costs more than a certified one to another goal
        self.certify_seconds = 0.0

    def attempt(self, first: Guess, value: float = math.inf) -> bool:
        """Solve from one guess, and continue where the certificate fails; True if the search is over. A motion that
        cannot cost less than `value`, as a certified one to another goal does, is not certified."""
        self.begin()
        if first.last < math.inf and self.problem.scene.polish and self._once_more(first):
            return True
        guess, weight = first.positions, first.weight
        problem = self.problem.resampled(guess)
        stuck = math.inf if self.attempts == 1 else STUCK_FACTOR * self.problem.scene.planner.activation
        for turn in range(1 + REPAIRS):
            problem, solution = self._solve(problem, guess, weight, stuck=stuck)
            if value < math.inf and not self._promises(solution.trajectory.positions, value):
                self._took(solution)
                self.passed = True
                return True
            try:
                better: Sequence[Solution] | None = None
                if turn == 0 and self.touches:
                    self._took(solution)
                    solution = replace(solution, steps=())
                    better = touched(self, solution)
                self.touched = any(self._certify(each)[0].certified for each in better or ())
                if self.touched:
                    return self.certified
                certificate, intervals = self._certify(solution)
                self.touched = better is not None and not better and certificate.certified
            except HdplanError:  # no time law, or too many rows
                if value == math.inf:  # no motion is certified
                    raise
                self.last = None
                return self.over
            left = self.problem.left(solution.trajectory.positions)
            if solution.status is SolverStatus.INTERRUPTED or self.over or (certificate.certified and not left):
                return True
            if turn == 0 and first.as_it_is and self._free_already(solution, guess):
                return True
            if turn == 0 and first.way is not None and self.keep(guess, self.timed(guess, math.inf, first.way)):
                return True
            if solution.status is SolverStatus.STALLED or not certificate.unproven:
                break
            guess, weight = solution.trajectory.positions, solution.weight * RAISE
            problem = problem.resampled(guess).refined(intervals)
        if (closer := more_closely(self.problem)) is not self.problem:
            self.problem = closer
            return self.attempt(first, value)
        return False

    def follows(self, first: Guess) -> bool:
        """True if a warm start leads at once to a certified motion like the last one, without any search."""
        self.begin()
        warm = first.last < math.inf and self.problem.scene.polish > 0
        return warm and self._once_more(first) and self.settled

    def _once_more(self, first: Guess) -> bool:
        """Certify what a warm start leads to at once, as the last motion was improved already; True if that holds."""
        solution = once_more(self, first.positions)
        motions = () if solution is None else self.timed(solution.trajectory.positions, math.inf)
        if solution is None or not self.keep(solution.trajectory.positions, motions):
            return False
        self.settled = self.touched = abs(self.value - first.last) <= LITTLE_CHANGE * first.last
        return True

    def _promises(self, path: Array, value: float) -> bool:
        """True if a motion along waypoints (N, n) would cost less than `value`."""
        return self.objective.least_along(path) < value and bool(self.timed(path, value))

    @property
    def over(self) -> bool:
        """True if the search is to stop: on request, or past the deadline."""
        return self.stop() or time.perf_counter() > self.deadline

    def _solve(
        self,
        problem: Problem,
        guess: Array,
        weight: float,
        slow: float = SLOW_DECREASE,
        solver: Solver | None = None,
        stuck: float = math.inf,
    ) -> tuple[Problem, Solution]:
        """Solve until the motion is clear at the samples that it needs itself, as it may move farther than the guess;
        again at most DENSER_ROUNDS times."""
        budget = Budget(
            self.deadline, first_weight=weight, slow=slow, stuck=stuck, report=self._report_step, stop=self.stop
        )
        for again in range(DENSER_ROUNDS, -1, -1):
            solution = self.last = (solver or self.solver).solve(problem, guess, budget)
            positions = solution.trajectory.positions
            finer = problem.resampled(positions)
            if solution.status is not SolverStatus.CLEAR or not again or is_clear(finer, positions):
                break
            self._took(solution)
            problem, guess, budget = finer, positions, replace(budget, first_weight=solution.weight)
        return finer, solution

    def _took(self, solution: Solution) -> None:
        """Count a solution's iterations."""
        self.iterations += solution.iterations
        self.steps += tuple(self._numbered(step) for step in solution.steps)

    def _free_already(self, solution: Solution, guess: Array) -> bool:
        """True if a guess (N, n) is certified as it is: where outer bodies overlap at an end although the links are
        free, a solver would only make it worse. Not for timed motions: there may be no time law for it."""
        if self.retimer is not None:
            return False
        before = self.best
        trajectory = replace(solution.trajectory, positions=guess)
        certificate, _ = self._certify(replace(solution, trajectory=trajectory, status=SolverStatus.STALLED, steps=()))
        kept = certificate.certified and not self.problem.left(guess)
        if not kept:
            self.best = before
        return kept

    @property
    def value(self) -> float:
        """Cost of the best motion, by the scene's objective."""
        assert self.best is not None
        return self.objective.value(self.best.path, self.best.trajectory)

    def begin(self) -> None:
        """Begin another attempt."""
        self.attempts += 1
        self.steps = ()

    def clear(
        self,
        problem: Problem,
        positions: Array,
        weight: float,
        slow: float = SLOW_DECREASE,
        solver: Solver | None = None,
    ) -> Solution | None:
        """The result of `tried`; None if it does not keep its distance."""
        solution = self.tried(problem, positions, weight, slow, solver)
        return solution if solution.status is SolverStatus.CLEAR else None

    def tried(
        self,
        problem: Problem,
        positions: Array,
        weight: float,
        slow: float = SLOW_DECREASE,
        solver: Solver | None = None,
    ) -> Solution:
        """Solve a problem to this goal from a motion (N, n), by another solver if one is given. Its steps are counted.
        Raises KeyboardInterrupt as the user does."""
        last = self.last
        _, solution = self._solve(problem.resampled(positions), positions, weight, slow, solver)
        self._took(solution)
        if solution.status is not SolverStatus.CLEAR:
            self.last = last
        if solution.status is SolverStatus.INTERRUPTED and not self.stop():
            raise KeyboardInterrupt  # which the solver turned into a status: what was found before counts
        return replace(solution, steps=())

    def led(self, problem: Problem, positions: Array, weight: float) -> tuple[Array, SolverStatus]:
        """Solve a problem to this goal from a guess (N, n); return where it leads (N, n) and why the solver stopped.
        Its steps are counted."""
        _, solution = self._solve(problem.resampled(positions), positions, weight)
        self._took(solution)
        self.last = replace(solution, steps=())
        return solution.trajectory.positions, solution.status

    def timed(self, path: Array, value: float, way: Array | None = None) -> Sequence[Trajectory]:
        """Give times to a path (N, n), or to a way (C, n) that it goes along, where the scene requires them, the
        quickest motion first; none if it can have none, or costs `value` or more."""
        rows = path if way is None else way
        along = Trajectory(self.problem.robot.joint_names, rows, self.problem.robot.locked)
        found = [] if self.retimer else [along]
        if self.retimer is not None:
            with contextlib.suppress(HdplanError):  # there is no time law, or there are too many rows
                for timed in self.retimer.ways(along, self.objective.longest(value)):
                    found.append(timed.trajectory)
        return [each for each in found if self.objective.value(path, each) < value]

    def keep(self, path: Array, motions: Sequence[Trajectory]) -> bool:
        """Keep the first of the motions along a path (N, n) that is certified."""
        for trajectory in motions:
            if self.problem.left(path):
                return False
            certificate = self._certificate(trajectory)
            if certificate.certified:
                self.best = Best(path, trajectory, certificate, self.steps, whole=True)
                return True
        return False

    def _report_step(self, step: Iteration, positions: Array) -> None:
        self.report(Event(self.attempts, step=self._numbered(step), positions=positions))

    def _numbered(self, step: Iteration) -> Iteration:
        """Number a repair's steps on from the attempt's earlier ones."""
        return replace(step, iteration=len(self.steps) + step.iteration)

    @property
    def certified(self) -> bool:
        """True if a certified motion was found that keeps the user's own constraints."""
        return self.best is not None and self.best.certificate.certified and not self.best.left

    def rank(self) -> tuple[float, ...]:
        """Order of searches, best first: certified at the least cost (`value`), then as `_rank`."""
        assert self.best is not None
        return (0.0, self.value) if self.certified else _rank(self.best.certificate, self.best.left)

    @property
    def is_tight(self) -> bool:
        """True if the best motion fails by what it comes too close to or by leaving its path: the bodies and their
        distance may be too loose for the place."""
        if self.best is None:
            return False
        status = self.best.certificate.status
        return status in CONTACTS or (status is Status.OFF_PATH and bool(self.problem.terms.path))

    def certify_last(self) -> bool:
        """Certify a motion whose certificate was interrupted; False if there is none."""
        if self.last is not None:
            self._certify(self.last)
        return self.best is not None

    def conclude(self) -> Best:
        """Return the best motion, with every failure named if it is not certified."""
        assert self.best is not None  # an attempt ends with a certificate
        if not self.best.whole and not self.best.certificate.certified and seconds_left() > 0.0:
            certificate = self._certificate(self.best.trajectory)
            self.best = self.best._replace(certificate=certificate, whole=True)
        return self.best

    def _certificate(self, trajectory: Trajectory) -> Certificate:
        """Certify a motion, with all its failures, and report it."""
        certificate = self.certifier.certify(trajectory, required=self.required)
        self.certify_seconds += certificate.seconds
        self.report(Event(self.attempts, certificate=certificate, motion=trajectory))
        return certificate

    def _certify(self, solution: Solution) -> tuple[Certificate, list[int]]:
        """Certify a motion, and keep it if it is the best so far; also return the waypoint intervals that fail."""
        stalled = solution.status is SolverStatus.STALLED  # rarely certified: the first contact found settles it
        suspect = self._deepest(solution.trajectory.positions) if stalled else None
        for way in self._motions(solution.trajectory, suspect):
            trajectory, parameter, near = way
            certificate = self.certifier.certify(trajectory, required=self.required, suspect=near)
            self.certify_seconds += certificate.seconds
            if certificate.certified:
                break
        self.last = None
        self._took(solution)
        path = solution.trajectory.positions
        left = self.problem.left(path)
        if self.best is None or _rank(certificate, left) < _rank(self.best.certificate, self.best.left):
            self.best = Best(path, trajectory, certificate, self.steps, not stalled, left)
        self.report(Event(self.attempts, certificate=certificate, motion=trajectory))
        failed = set(certificate.unproven)
        if parameter is not None:  # rows in time are denser than waypoints, and lie elsewhere
            last = self.problem.waypoints - 2
            failed = {min(int(parameter[row + end] * (last + 1)), last) for row in failed for end in (0, 1)}
        return certificate, sorted(failed)

    def _motions(
        self, path: Trajectory, suspect: tuple[int, float] | None
    ) -> Iterator[tuple[Trajectory, Array | None, tuple[int, float] | None]]:
        """Yield the motions along a path, the quickest first: each with where its rows are on the path, and a place on
        it in its own intervals."""
        if self.retimer is None:
            yield path, None, suspect
            return
        for timed in self.retimer.ways(path):
            place = None if suspect is None else timed.place_of(sum(suspect) / (self.problem.waypoints - 1))
            yield timed.trajectory, timed.parameter, place

    def _deepest(self, positions: Array) -> tuple[int, float]:
        """Place where a motion (N, n) is deepest inside a margin: a waypoint interval, and a fraction of it."""
        samples = self.problem.resampled(positions).samples
        deepest = int(self.problem.depth(samples.configurations(positions), samples.parameter).argmax())
        return int(samples.interval[deepest]), float(samples.fraction[deepest])


def _rank(certificate: Certificate, left: tuple[str, ...]) -> tuple[float, ...]:
    """Order of motions, best first: certified within the user's own constraints with most clearance, then certified
    alone, then with the shallowest contact or the smallest departure from the path, a radian counted as a metre."""
    if certificate.certified:
        return (0.5 if left else 0.0, -(certificate.clearance or 0.0))
    depths = [-place.distance for place in certificate.failures] + [place.excess for place in certificate.departures]
    return (1.0, max(depths, default=0.0))
