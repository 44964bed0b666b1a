"""Planning: from a scene to the best motion found and its certificate. The attempts are made by `search`."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.compiled.compile_time import compile_time
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.assemble import assemble
from hdplan.planner.problem.own_term import OwnTerm
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.warm_start import MOVED, begun_at, rows_of, warm_start
from hdplan.planner.result import CUT_SHORT, PlanResult, Times
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.end_clearance import met_by, reachable_clearance
from hdplan.planner.search.guesses import Guess, search_in_turn
from hdplan.planner.search.infeasible import InfeasibilityCheck
from hdplan.planner.search.polish import Stages, Ways, first_motion, polish
from hdplan.planner.search.search import Event, Search, Slide
from hdplan.planner.solvers import solver_named
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import check_time, seconds_left, whole_limit
from hdplan.scenes.errors import UnsolvableError, naming
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import Goals, JointTarget
from hdplan.scenes.values import Number, Whole, checked, functions, instance, is_row, wrong

FOR_MESHES = 0.5  # share of the time left before the deadline, for splitting meshes
RESERVED, MOST_RESERVED = 0.2, 1.0  # share of the time left, and most [s], that is reserved for the certificate

if TYPE_CHECKING:
    from hdplan.planner.timing.retiming import Retimer


def plan(
    scene: Scene,
    *,
    solver: str = "gauss_newton",
    seed: int = 0,
    time_limit: float = 30.0,
    robot: Robot | None = None,
    guess: Trajectory | ArrayLike | None = None,
    report: Callable[[Event], None] = lambda event: None,
    stop: Callable[[], bool] = lambda: False,
    terms: Sequence[OwnTerm] = (),
) -> PlanResult:
    """Find a certified motion from the scene's start to its goal.

    If the goal leaves a choice, the most promising configurations get a few guesses each in turn; of those certified by
    then, the one with the least of `Scene.objective` wins.

    Args:
        scene: from load_scene, or a Scene made in Python.
        solver: "gauss_newton", "chomp", "fatrop" or "ipopt".
        seed: of the random guesses; the same seed gives the same result, as far as the time limit allows.
        time_limit: [s] for solving and certifying; the best motion found by then is returned, its status says how good
            it is, and `ended` what the limit ended. Within `deadline.time_limit` building counts too, and the
            certificate ends with it.
        robot: the scene's robot, if it is already loaded.
        guess: a motion of this robot from which the solver starts (a warm start), such as the last plan's trajectory
            after a small change of the scene, which is followed without further rounds where it costs about as much as
            before, or waypoints (R, n) in the order of the robot's joints. Its ends are moved to the scene's, which is
            noted. It is not trusted: the result is certified like any other motion, and if the guess leads to no
            certified motion, the search continues without it. Of several goals, the one nearest to its end starts with
            it.
        report: called with every step and every certificate.
        stop: called at every step; once it returns True, the best motion so far is certified and returned. A
            KeyboardInterrupt does the same, except at moments in which a C++ library swallows it.
        terms: your own costs, penalties and constraints in symbols. Constraints are kept at the waypoints; a note gives
            the violation of the best motion. The certificate does not know them.

    Raises:
        UnsolvableError: the scene allows no motion, and its `cause` says why: an end is not allowed, or, once guesses
            failed for some time, it is proven that no motion exists (`certificate.infeasibility`).
        TimeLimitError: a `deadline.time_limit` passed before there was a motion.
        InputError: for errors in the scene or robot, including a start or goal in collision or off a path constraint;
            for a guess whose joints are not the robot's, or beyond their limits; and for a term that is not an
            `OwnTerm`, of a wrong size, or not twice differentiable.
    """
    instance(scene, Scene, "scene")
    seed = checked(Whole(0, 2**63 - 1), seed, "seed")
    time_limit = checked(Number(low=0.0, unit="s"), time_limit, "time_limit")
    functions(report=report, stop=stop)
    run = solver_named(solver)
    if not is_row(terms):
        raise wrong("a list of OwnTerms", terms).within("terms")
    for term in terms:
        instance(term, OwnTerm, "terms")
    began = time.perf_counter()
    with naming(scene.source):
        scene.check_effects()
    setup = Setup.of(scene, robot)
    robot = setup.robot
    loaded = time.perf_counter()
    certifier = Certifier(setup)
    rows = None if guess is None else rows_of(guess, robot)
    retimer = _retimer(setup, certifier)
    for goals, found, alone in _choices(certifier, seed, rows):
        aims = [setup.aiming_at(goal) for goal in goals]
        # refuses ends in collision before any fitting
        clearances = [reachable_clearance(aim, certifier) for aim in aims]
        with compile_time() as stopwatch:
            queries = [retimer.standing(aim.query) if retimer else aim.query for aim in aims]
            before = began + min(time_limit, FOR_MESHES * seconds_left())
            problems = [assemble(aim, query, before) for aim, query in zip(aims, queries, strict=True)]
            problems = [functools.reduce(Problem.with_term, terms, problem) for problem in problems]
        if retimer is not None:
            hurried = [retimer.too_short(problem.start, problem.goal) for problem in problems]
            if all(hurried) and not alone:
                raise UnsolvableError(f"{scene.source}: {hurried[0]}", "too_hurried")
        built = time.perf_counter()

        check_time("building the problem")
        left = seconds_left()  # of the deadline, which covers more than this search
        deadline = built + min(time_limit, left - min(RESERVED * left, MOST_RESERVED) if left < math.inf else left)
        searches = [
            Search(
                problem, certifier, retimer, run, required, deadline, report, stop, _slide(certifier, goal, required)
            )
            for problem, goal, (required, _) in zip(problems, goals, clearances, strict=True)
        ]
        warm: list[Guess | None] = [None] * len(problems)
        if guess is not None and rows is not None:
            rows = begun_at(rows, problems[0].start, robot)
            nearest = min(range(len(problems)), key=lambda i: float(np.linalg.norm(problems[i].goal - rows[-1])))
            motion = guess if isinstance(guess, Trajectory) and guess.times is not None else None
            begin, moved = warm_start(problems[nearest], rows, motion is not None)
            warm[nearest] = Guess(begin, as_it_is=True, last=searches[nearest].objective.last(begin, motion))
            if moved > MOVED:
                found = (*found, f"the guess's ends were moved by up to {moved:.3g} rad or m, to the scene's")
        attempts, interrupted = None, False
        try:
            if alone and not (warm[0] and searches[0].follows(warm[0])):
                continue
            stages, ways = Stages(searches), Ways()
            if scene.objective == "time" and scene.polish and guess is None:
                first_motion(searches, stages, seed, ways)
            if not alone:
                search_in_turn(searches, seed, warm, InfeasibilityCheck(searches, goals).refuse)
            attempts = _attempts(searches)
            if (taken := _best(searches)) is not None and searches[taken].certified and not searches[taken].settled:
                polish(searches, taken, stages, seed, ways)
        except KeyboardInterrupt:
            if not any(search.best is not None or search.certify_last() for search in searches):
                raise
            interrupted = True
        break
    taken = _best(searches)
    assert taken is not None
    late = time.perf_counter() > deadline and not interrupted and not stop()
    ended = _ended(searches, taken, min(time_limit, whole_limit())) if late else ""
    best = searches[taken].conclude()
    certified = sum(search.certify_seconds for search in searches)
    solved = time.perf_counter() - built - certified  # guesses included
    load, build_ = loaded - began, built - loaded - stopwatch.seconds
    notes = (*found, *clearances[taken][1])
    if seconds_left() == 0.0 and not best.certificate.certified:
        notes = (*notes, CUT_SHORT)
    goal = JointTarget(goals[taken].field, tuple(best.path[-1].tolist())) if isinstance(scene.goal, Goals) else None
    if goal is not None:
        notes = (*notes, _taken(searches, taken, goal))
    elif taken == 0:
        notes = (*notes, *setup.turned)
    notes = (*best.left, *notes)
    return PlanResult(
        scene=scene.name,
        robot=robot.name,
        trajectory=best.trajectory,
        certificate=best.certificate,
        solver=solver,
        seed=seed,
        attempts=_attempts(searches) if attempts is None else attempts,
        iterations=sum(search.iterations for search in searches),
        steps=best.steps,
        times=Times(load, build_, stopwatch.seconds, solved, certified),
        notes=tuple(dict.fromkeys((*filter(None, [ended]), *problems[taken].notes, *best.certificate.notes, *notes))),
        objective=searches[taken].objective.achieved(best.path, best.trajectory),
        goal=goal,
        requested=scene,
        ended=ended,
    )


def _attempts(searches: Sequence[Search]) -> int:
    return sum(search.attempts for search in searches)


def _ended(searches: Sequence[Search], taken: int, seconds: float) -> str:
    """Return the part of the search, in words, that a time limit of so many seconds ended; empty if it was complete."""
    reached = f"time limit of {seconds:g} s reached"
    if not searches[taken].certified:
        guesses = _attempts(searches)
        return f"{reached} after {guesses} guess{'es' * (guesses != 1)}; more time may help"
    if searches[taken].problem.scene.polish:
        return f"{reached} while the motion was improved; more time may improve it"
    return f"{reached} while other goals were tried; more time may find a better one" if len(searches) > 1 else ""


def _best(searches: Sequence[Search]) -> int | None:
    """Return the search with the best motion; None if no search has any."""
    return min((i for i, search in enumerate(searches) if search.best), key=lambda i: searches[i].rank(), default=None)


def _choices(
    certifier: Certifier, seed: int, rows: Array | None
) -> Iterator[tuple[tuple[JointTarget, ...], tuple[str, ...], bool]]:
    """Yield the configurations to plan to, with notes: where a guess of waypoints (R, n) ends, alone, if the scene's
    goal is met and a motion may end there; then all that the scene leaves."""
    setup, goal = certifier.setup, certifier.scene.goal
    if rows is not None and isinstance(goal, Goals) and len(goal.targets) == 1:
        from hdplan.planner.search.goals import may_end

        (target,) = goal.targets
        end = begun_at(rows, setup.robot.configuration(setup.scene.start, setup.scene.from_request), setup.robot)[-1]
        if certifier.ends.off_goal(end) is None and may_end(certifier, end):
            yield (JointTarget(target.field, tuple(end.tolist())),), (), True
    yield *_goals(certifier, seed), False


def _goals(certifier: Certifier, seed: int) -> tuple[tuple[JointTarget, ...], tuple[str, ...]]:
    """Return the configurations to plan to, and notes on how they were found if the scene leaves a choice."""
    setup, goal = certifier.setup, certifier.scene.goal
    if isinstance(goal, JointTarget):
        if not setup.turned:
            return (goal,), ()
        near = replace(goal, positions=tuple(setup.query.goal.tolist()), by_name=None, state=None)
        return (near, goal), ()  # something may stand in the short way
    from hdplan.planner.search.goals import goal_choice

    return goal_choice(certifier, seed)


def _retimer(setup: Setup, certifier: Certifier) -> Retimer | None:
    """Return the retimer, if the scene requires times; a robot that moves is to brake without meeting anything."""
    if not setup.scene.timed:
        return None
    from hdplan.planner.timing.retiming import Retimer

    return Retimer(setup, functools.partial(met_by, certifier))


def _slide(certifier: Certifier, goal: JointTarget, required: float) -> Slide | None:
    """Return the function that moves a motion's end along the goal set, if there is a choice and the motion is
    improved."""
    if isinstance(certifier.scene.goal, JointTarget) or not certifier.scene.polish:
        return None
    from hdplan.planner.search.goal_slide import sliding

    return sliding(certifier, goal, required)


def _taken(searches: Sequence[Search], taken: int, goal: JointTarget) -> str:
    """Return the chosen goal, in words, and the number of goals."""
    tried = sum(search.attempts > 0 for search in searches)
    found = sum(search.certified for search in searches)
    joints = zip(searches[taken].problem.robot.joint_names, goal.positions or (), strict=True)
    return (
        f"goal chosen of {tried} tried, {found} certified, by least {searches[taken].objective.name}: "
        f"{goal.field} at " + ", ".join(f"{joint} {value:.4g}" for joint, value in joints)
    )
