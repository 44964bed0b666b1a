"""Planning, whole: guess, solve, certify; where the certificate fails, look there more closely, or guess again.

A motion counts as found when its certificate says so and not before: the certificate works with the robot's real
meshes, the solver with outer bodies at samples, and neither takes the other's word.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from hdplan.planner.certificate import Certifier
from hdplan.planner.problem import Floats, Problem, build
from hdplan.planner.result import PlanResult, Times
from hdplan.planner.robot import Robot
from hdplan.planner.scene_robot import load_scene_robot, resolve_query
from hdplan.planner.seeds import seeds
from hdplan.planner.solvers import Solver, solver_named
from hdplan.planner.solvers.solution import FIRST_WEIGHT, RAISE, Budget, Solution, Status, Step
from hdplan.planner.trajectory import Trajectory
from hdplan.planner.verdict import Certificate
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.model import Goals, JointTarget, PathConstraints, Scene

if TYPE_CHECKING:
    from hdplan.planner.timing import Timekeeper

ENDS_KEEP = 0.5  # share of an end's distance that is asked for where it is below planner.clearance
DETOUR_WEIGHT = FIRST_WEIGHT * RAISE**3  # [1/m²] a guess that leads around obstacles is to stay there
GUESSES = 3  # first guesses for a goal before it is the next one's turn
REPAIRS = 3  # times that a motion whose certificate failed is solved on, before the next guess


@dataclass(frozen=True)
class Event:
    """Progress, for displays: a solver's step, or a certificate."""

    attempt: int
    step: Step | None = None
    positions: Floats | None = None  # (N, n) the waypoints after that step; the caller may keep, not change them
    certificate: Certificate | None = None


def plan(
    scene: Scene,
    *,
    solver: str = "gauss_newton",
    seed: int = 0,
    time_limit: float = 30.0,
    robot: Robot | None = None,
    report: Callable[[Event], None] = lambda event: None,
    stop: Callable[[], bool] = lambda: False,
) -> PlanResult:
    """Find a certified motion from the scene's start to its goal.

    Where the goal leaves a choice, the likely best configurations get a few guesses each in turn; of those certified by
    then the one with the least smoothness cost wins.

    Args:
        scene: what load_scene returns.
        solver: "gauss_newton", "chomp" or "ipopt".
        seed: of the random first guesses; the same seed gives the same result, as far as the time limit allows.
        time_limit: [s] for solving and certifying; the best motion found by then is given back, its status saying
            what it is.
        robot: the scene's robot, if it is loaded already.
        report: called with every step and every certificate.
        stop: asked at every step; once it says True, the best motion so far is certified and given back. A
            KeyboardInterrupt does the same, except in the moments in which a C++ library swallows it.

    Raises:
        InputError: for what scene or robot get wrong, among it a start or goal in collision or off a path constraint,
            and for ipopt with the distance fcl, swept bodies or path constraints.
    """
    run = solver_named(solver)
    if solver == "ipopt" and (lacking := _without_second_derivatives(scene)):
        raise InputError(f"solver ipopt: needs exact second derivatives, which {lacking} does not have")
    began = time.perf_counter()
    robot = robot or load_scene_robot(scene)
    loaded = time.perf_counter()
    certifier = Certifier(scene, robot)
    goals, found = _goals(scene, robot, certifier, seed)
    aims = [replace(scene, goal=goal) for goal in goals]
    clearances = [_reachable_clearance(aim, robot, certifier) for aim in aims]  # ends in collision: before all fitting
    timekeeper = _timekeeper(scene, robot)
    problems = [build(aim, robot) for aim in aims]
    if timekeeper is not None:
        with naming(scene.source):
            timekeeper.check(problems[0].start, problems[0].goal, robot.joint_names)
    built = time.perf_counter()

    searches = [
        _Search(problem, certifier, timekeeper, run, required, built + time_limit, report, stop)
        for problem, (required, _) in zip(problems, clearances, strict=True)
    ]
    try:
        _search_in_turn(searches, seed)
    except KeyboardInterrupt:
        if not any(search.best is not None or search.certify_last() for search in searches):
            raise
    taken = min((i for i, search in enumerate(searches) if search.best), key=lambda i: searches[i].rank())
    best = searches[taken].conclude()
    certified = sum(search.certify_seconds for search in searches)
    solved = time.perf_counter() - built - certified  # guesses included
    compile_ = sum(problem.compile_seconds for problem in problems)
    load, build_ = loaded - began, built - loaded - compile_
    words = (*found, *clearances[taken][1])
    several = isinstance(scene.goal, Goals)
    if several:
        words = (*words, _taken(searches, taken, goals))
    return PlanResult(
        scene=scene.name,
        robot=robot.name,
        trajectory=best.trajectory,
        certificate=best.certificate,
        solver=solver,
        seed=seed,
        attempts=sum(search.attempts for search in searches),
        iterations=sum(search.iterations for search in searches),
        steps=best.steps,
        times=Times(load, build_, compile_, solved, certified),
        notes=(*problems[taken].notes, *words),
        goal=goals[taken] if several else None,
    )


def _goals(
    scene: Scene, robot: Robot, certifier: Certifier, seed: int
) -> tuple[tuple[JointTarget, ...], tuple[str, ...]]:
    """Return the configurations to plan to, and words on how they were found, where the scene leaves a choice."""
    if isinstance(scene.goal, JointTarget):
        return (scene.goal,), ()
    from hdplan.planner.goal_search import goal_choice

    return goal_choice(scene, robot, certifier, seed)


def _timekeeper(scene: Scene, robot: Robot) -> Timekeeper | None:
    """Return what gives motions their times, where the scene asks for them."""
    if not scene.timed:
        return None
    from hdplan.planner.timing import Timekeeper

    return Timekeeper(scene, robot)


class _Best(NamedTuple):
    """The best motion so far."""

    solution: Solution
    trajectory: Trajectory  # its motion, with times where the scene asks for them
    certificate: Certificate
    steps: tuple[Step, ...]
    whole: bool  # whether the certificate names every failure


class _Search:
    """The attempts of one plan: what they cost, and the best motion among them."""

    def __init__(
        self,
        problem: Problem,
        certifier: Certifier,
        timekeeper: Timekeeper | None,
        solver: Solver,
        required: float,
        deadline: float,
        report: Callable[[Event], None],
        stop: Callable[[], bool],
    ) -> None:
        self.problem, self.certifier, self.timekeeper = problem, certifier, timekeeper
        self.solver, self.required = solver, required
        self.deadline, self.report, self.stop = deadline, report, stop
        self.last: Solution | None = None  # solved, not yet certified
        self.best: _Best | None = None
        self.steps: tuple[Step, ...] = ()  # of the attempt under way
        self.attempts = self.iterations = 0
        self.certify_seconds = 0.0

    def attempt(self, guess: Floats) -> bool:
        """Solve from one guess, and solve on where the certificate fails; True if the search is over."""
        self.attempts += 1
        self.steps = ()
        problem = self.problem.resampled(guess)
        weight = FIRST_WEIGHT if self.attempts == 1 else DETOUR_WEIGHT
        for _ in range(1 + REPAIRS):
            budget = Budget(self.deadline, first_weight=weight, report=self._report_step, stop=self.stop)
            solution = self.last = self.solver(problem, guess, budget)
            certificate, intervals = self._certify(solution)
            if solution.status is Status.INTERRUPTED or self.stop() or budget.spent():
                return True
            if certificate.certified:
                return True
            if solution.status is Status.STALLED or not certificate.unproven:
                break
            guess, weight = solution.trajectory.positions, solution.weight * RAISE
            problem = problem.resampled(guess).refined(intervals)
        return False

    def _report_step(self, step: Step, positions: Floats) -> None:
        self.report(Event(self.attempts, step=self._numbered(step), positions=positions))

    def _numbered(self, step: Step) -> Step:
        """A repair's steps go on counting where the attempt's earlier ones ended."""
        return replace(step, iteration=len(self.steps) + step.iteration)

    @property
    def certified(self) -> bool:
        """Whether a certified motion was found."""
        return self.best is not None and self.best.certificate.certified

    def rank(self) -> tuple[float, ...]:
        """Order of searches, best first: certified with the least smoothness cost, then as `_rank`."""
        assert self.best is not None
        if not self.certified:
            return _rank(self.best.certificate)
        smoothness, _ = self.problem.smoothness.value(self.best.solution.trajectory.positions)
        return (0.0, smoothness)

    def certify_last(self) -> bool:
        """Certify a motion whose certificate was interrupted; False if there is none."""
        if self.last is not None:
            self._certify(self.last)
        return self.best is not None

    def conclude(self) -> _Best:
        """Return the best motion, with every failure named if it is not certified."""
        assert self.best is not None  # an attempt ends with a certificate
        if not self.best.whole and not self.best.certificate.certified:
            certificate = self.certifier.certify(self.best.trajectory, required=self.required)
            self.certify_seconds += certificate.seconds
            self.report(Event(self.attempts, certificate=certificate))
            self.best = self.best._replace(certificate=certificate, whole=True)
        return self.best

    def _certify(self, solution: Solution) -> tuple[Certificate, list[int]]:
        """Certify a motion, and keep it if it is the best so far; return the waypoint intervals that fail, too."""
        hopeless = solution.status is Status.STALLED  # seldom certified: the first contact found settles it
        trajectory, parameter = solution.trajectory, None
        if self.timekeeper is not None:
            trajectory, parameter = self.timekeeper(trajectory)
        certificate = self.certifier.certify(trajectory, required=self.required, stop_at_contact=hopeless)
        self.last = None
        self.iterations += solution.iterations
        self.certify_seconds += certificate.seconds
        self.steps += tuple(self._numbered(step) for step in solution.steps)
        if self.best is None or _rank(certificate) < _rank(self.best.certificate):
            self.best = _Best(solution, trajectory, certificate, self.steps, whole=not hopeless)
        self.report(Event(self.attempts, certificate=certificate))
        failed = set(certificate.unproven)
        if parameter is not None:  # rows in time lie closer than waypoints, and elsewhere
            last = self.problem.waypoints - 2
            failed = {min(int(parameter[row + end] * (last + 1)), last) for row in failed for end in (0, 1)}
        return certificate, sorted(failed)


def _search_in_turn(searches: Sequence[_Search], seed: int) -> None:
    """Give each goal its first guesses, then each the next ones, until one is certified after a whole round or time is
    over. With one goal that is one guess after another."""
    lines = [(search, seeds(search.problem, seed)) for search in searches]
    while not any(search.certified for search in searches):
        for search, guesses in lines:
            over = any(search.attempt(guess) for guess in itertools.islice(guesses, GUESSES))
            if over and not search.certified:
                return


def _taken(searches: Sequence[_Search], taken: int, goals: Sequence[JointTarget]) -> str:
    """Say which goal was taken, of how many."""
    tried = sum(search.attempts > 0 for search in searches)
    found = sum(search.certified for search in searches)
    joints = zip(searches[taken].problem.robot.joint_names, goals[taken].positions or (), strict=True)
    return (
        f"goal taken of {tried} tried, {found} certified, by least smoothness cost: {goals[taken].field} at "
        + ", ".join(f"{joint} {value:.4g}" for joint, value in joints)
    )


def _without_second_derivatives(scene: Scene) -> str | None:
    """Name what the scene asks for that has no exact second derivatives."""
    lacking = {
        "planner.swept: true": scene.planner.swept,
        "the distance fcl": scene.planner.distance == "fcl",
        "a path constraint (section path)": scene.path != PathConstraints(),
        "a torque limit (limits.torque)": scene.limits.torque is not None,
        "an obstacle that moves": any(obstacle.motion is not None for obstacle in scene.obstacles),
    }
    return next((name for name, asked in lacking.items() if asked), None)


def _reachable_clearance(scene: Scene, robot: Robot, certifier: Certifier) -> tuple[float, tuple[str, ...]]:
    """The clearance that can be asked for [m]: the scene's, or less, with a word, where its own ends are closer than
    that.

    Raises InputError if an end is in collision, or breaks a path constraint.
    """
    required, words = scene.planner.clearance, []
    lenient = {obstacle.name for obstacle in scene.obstacles if obstacle.clearance is None}
    query = resolve_query(robot, scene)
    for field, q, time_ in ((scene.start.field, query.start, 0.0), (scene.goal.field, query.goal, scene.end_time)):
        contacts = certifier.contacts(q, time_)
        if contacts:
            said = "; ".join(
                f"{c.link} and {c.other} " + (f"overlap by {c.depth * 1e3:.3g} mm" if c.depth else "touch")
                for c in contacts[:3]
            )
            raise InputError(f"{scene.source}: {field}: in collision: {said}")
        if departures := certifier.off_path(q):
            raise InputError(f"{scene.source}: {field}: off the path: {'; '.join(each.words for each in departures)}")
        if overload := certifier.overload(q):
            raise InputError(f"{scene.source}: {field}: {overload.words}")
        close = certifier.too_close(q, required, time_)
        for place, asked in close:
            if place.other not in lenient:
                raise InputError(
                    f"{scene.source}: {field}: {place.link} is {place.distance * 1e3:.3g} mm from {place.other}, "
                    f"{asked * 1e3:g} mm are asked for (obstacles[].clearance, self_collision.clearance)"
                )
        if close:
            place, _ = close[0]
            required = ENDS_KEEP * place.distance
            words.append(
                f"{field} is {place.distance * 1e3:.3g} mm from {place.other}: "
                f"{required * 1e3:.3g} mm are proven for the whole motion instead of planner.clearance"
            )
    return required, tuple(words)


def _rank(certificate: Certificate) -> tuple[float, ...]:
    """Order of motions, best first: certified with most clearance, then with the shallowest contact or the smallest
    departure from the path, a radian counted as a metre."""
    if certificate.certified:
        return (0.0, -(certificate.clearance or 0.0))
    depths = [-place.distance for place in certificate.failures] + [place.excess for place in certificate.departures]
    return (1.0, max(depths, default=0.0))
