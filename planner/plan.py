"""Planning, whole: guess, solve, certify; where the certificate fails, look there more closely, or guess again.

A motion counts as found when its certificate says so and not before: the certificate works with the robot's real meshes, the
solver with outer bodies at samples, and neither takes the other's word.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hdplan.planner.certificate import Certificate, Certifier
from hdplan.planner.problem import Problem, build
from hdplan.planner.result import PlanResult, Times
from hdplan.planner.robot import Robot, load_scene_robot
from hdplan.planner.seeds import seeds
from hdplan.planner.solvers import SOLVERS
from hdplan.planner.solvers.solution import FIRST_WEIGHT, RAISE, Budget, Solution, Status, Step
from hdplan.planner.trajectory import Trajectory
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.model import Scene

ENDS_KEEP = 0.9  # share of an end's distance that is asked for where it is below planner.clearance
REPAIRS = 3  # times that a motion whose certificate failed is solved on, before the next guess


@dataclass(frozen=True)
class Event:
    """Progress, for displays: a solver's step, or a certificate."""

    attempt: int
    step: Step | None = None
    certificate: Certificate | None = None


def plan(
    scene: Scene,
    *,
    solver: str = "gauss_newton",
    seed: int = 0,
    time_limit: float = 30.0,
    robot: Robot | None = None,
    report: Callable[[Event], None] = lambda event: None,
) -> PlanResult:
    """Find a certified motion from the scene's start to its goal.

    Args:
        scene: what load_scene returns.
        solver: "gauss_newton", "chomp" or "ipopt".
        seed: of the random first guesses; the same seed gives the same result, as far as the time limit allows.
        time_limit: [s] for solving and certifying; the best motion found by then is given back, its status saying what it is.
        robot: the scene's robot, if it is loaded already.
        report: called with every step and every certificate.

    Raises:
        InputError: for what scene or robot get wrong, among it a start or goal in collision.
    """
    if solver not in SOLVERS:
        raise InputError(f"solver: unknown '{solver}'{nearest(solver, SOLVERS)}")
    began = time.perf_counter()
    robot = robot or load_scene_robot(scene)
    loaded = time.perf_counter()
    problem = build(scene, robot)
    certifier = Certifier(scene, robot)
    required, words = _reachable_clearance(problem, certifier)
    built = time.perf_counter()

    deadline = built + time_limit
    solved = certified = 0.0
    iterations = attempt = 0
    best: tuple[tuple[float, ...], Solution, Trajectory, Certificate] | None = None
    interrupted = False
    for attempt, guess in enumerate(seeds(problem, seed), start=1):
        work, positions, weight = problem, guess, FIRST_WEIGHT
        for _ in range(1 + REPAIRS):
            budget = Budget(deadline=deadline, first_weight=weight, report=lambda step: report(Event(attempt, step=step)))
            started = time.perf_counter()
            solution = SOLVERS[solver](work, positions, budget)
            solved += time.perf_counter() - started
            iterations += solution.iterations
            trajectory = Trajectory(robot.joint_names, solution.positions, robot.locked)
            certificate = certifier.certify(trajectory, required=required)
            certified += certificate.seconds
            report(Event(attempt, certificate=certificate))
            rank = _rank(certificate)
            if best is None or rank < best[0]:
                best = rank, solution, trajectory, certificate
            interrupted = solution.status is Status.INTERRUPTED
            if certificate.certified or interrupted or solution.status is Status.STALLED or budget.spent():
                break
            work = work.refined(sorted({place.interval for place in certificate.failures}))
            positions, weight = solution.positions, solution.weight * RAISE
        if best[3].certified or interrupted or time.perf_counter() > deadline:
            break

    assert best is not None  # the loop ran at least once
    _, solution, trajectory, certificate = best
    return PlanResult(
        scene=scene.name,
        robot=robot.name,
        trajectory=trajectory,
        certificate=certificate,
        solver=solver,
        seed=seed,
        attempts=attempt,
        iterations=iterations,
        steps=solution.steps,
        times=Times(loaded - began, built - loaded - problem.compile_seconds, problem.compile_seconds, solved, certified),
        notes=(*problem.notes, *words),
    )


def _reachable_clearance(problem: Problem, certifier: Certifier) -> tuple[float, tuple[str, ...]]:
    """The clearance that can be asked for [m]: the scene's, or less, with a word, where its own ends are closer than that.

    Raises InputError if an end is in collision.
    """
    required, words = problem.scene.planner.clearance, []
    for field, q in (("start", problem.start), ("goal", problem.goal)):
        contacts = certifier.contacts(q)
        if contacts:
            said = "; ".join(
                f"{c.link} and {c.other} " + (f"overlap by {c.depth * 1e3:.3g} mm" if c.depth else "touch") for c in contacts[:3]
            )
            raise InputError(f"{problem.scene.source}: {field}: in collision: {said}")
        nearest_obstacle = certifier.closest_obstacle(q)
        if nearest_obstacle is not None and nearest_obstacle.distance <= required:
            required = ENDS_KEEP * nearest_obstacle.distance
            words.append(
                f"{field} is {nearest_obstacle.distance * 1e3:.3g} mm from {nearest_obstacle.other}: "
                f"{required * 1e3:.3g} mm are proven for the whole motion instead of planner.clearance"
            )
    return required, tuple(words)


def _rank(certificate: Certificate) -> tuple[float, ...]:
    """Order of attempts, best first: certified, then fewest failing intervals, then the shallowest contact."""
    failing = {place.interval for place in certificate.failures}
    deepest = min((place.distance for place in certificate.failures), default=0.0)
    return (not certificate.certified, len(failing), -deepest)
