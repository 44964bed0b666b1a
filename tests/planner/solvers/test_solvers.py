"""Laws of the solvers: ends and limits kept, the closed-form minimum where there is one, the same bytes every time.

All three on one problem object; none of them makes a claim about freedom here.
"""

from __future__ import annotations

import dataclasses
import itertools
import time

import numpy as np
import pytest

from hdplan.planner.build import build
from hdplan.planner.problem.problem import Problem
from hdplan.planner.solvers import SOLVERS, solve
from hdplan.planner.solvers.solution import EQUAL_COST, Budget, Iteration, Solution, SolverStatus
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Sphere
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.yaml_format.reader import load_scene

MINIMUM = 1e-8  # [rad] from the closed-form minimum
# Iterations that show what a law requires; those of the last two are runs.
SAMPLED = {"gauss_newton": 30, "chomp": 60, "ipopt": 6, "fatrop": 6}

every_solver = pytest.mark.parametrize("solver", SOLVERS)


def arm(*obstacles: Obstacle, waypoints: int = 12, ignore: bool = False) -> Scene:
    """The planar arm between other obstacles; `ignore` leaves out its one pair of links that can meet."""
    scene = load_scene("planar_arm")
    return dataclasses.replace(
        scene,
        obstacles=obstacles or scene.obstacles,
        robot=dataclasses.replace(scene.robot, ignore_pairs=(("pedestal", "forearm"),) if ignore else ()),
        planner=dataclasses.replace(scene.planner, waypoints=waypoints),
    )


FAR_AWAY = Obstacle("far", Box((1.0, 1.0, 1.0)), Pose((5.0, 0.0, 0.0)))


@pytest.fixture(scope="module")
def problem() -> Problem:
    return build(arm())


def line(problem: Problem) -> Array:
    return np.linspace(problem.start, problem.goal, problem.waypoints)


def wild(problem: Problem, spread: float = 0.5) -> Array:
    return line(problem) + spread * np.random.default_rng(1).normal(size=(problem.waypoints, problem.robot.n))


def run(problem: Problem, solver: str, guess: Array | None = None, **budget: object) -> Solution:
    options = {"iterations": SAMPLED[solver], **budget}
    return solve(problem, solver=solver, guess=guess, budget=Budget(**options))


@every_solver
def test_ends_stay_and_limits_hold(problem: Problem, solver: str) -> None:
    """Guesses that break both, after few and many steps."""
    for iterations in (0, 1, 3, SAMPLED[solver]):
        found = run(problem, solver, wild(problem, 4.0), iterations=iterations).trajectory.positions
        np.testing.assert_array_equal(found[[0, -1]], [problem.start, problem.goal])
        assert np.all((found >= problem.robot.lower) & (found <= problem.robot.upper))


@every_solver
def test_limits_hold_where_the_penalty_pushes_against_them(solver: str) -> None:
    """Start and goal sit on a limit, and a body between them pushes the arm beyond it."""
    scene = arm(Obstacle("ball", Sphere(0.1), Pose((-0.7, -0.1, 0.1))), ignore=True)
    ends = {"start": JointTarget("start", (3.1, 0.6)), "goal": JointTarget("goal", (3.1, -0.6))}
    problem = build(dataclasses.replace(scene, **ends))
    assert problem.evaluate(line(problem), 1.0).penalty > 0
    found = run(problem, solver).trajectory.positions
    np.testing.assert_array_equal(found[[0, -1]], [problem.start, problem.goal])
    assert np.all(found <= problem.robot.upper)
    assert problem.evaluate(found, 1e4).cost < problem.evaluate(line(problem), 1e4).cost


@every_solver
@pytest.mark.parametrize("waypoints", [3, 4, 12])
def test_without_penalty_the_minimum_is_the_straight_line(waypoints: int, solver: str) -> None:
    free = build(arm(FAR_AWAY, waypoints=waypoints, ignore=True))
    assert not list(free.terms)
    for guess in (None, wild(free)):
        solution = run(free, solver, guess, iterations=300)
        assert solution.status is SolverStatus.CLEAR
        np.testing.assert_allclose(solution.trajectory.positions, line(free), rtol=0, atol=MINIMUM)


@every_solver
def test_cost_falls(problem: Problem, solver: str) -> None:
    """Every step under one weight, and the whole."""
    solution = run(problem, solver)
    steps = solution.steps
    assert solution.iterations == len(steps) > 0
    assert [step.iteration for step in steps] == list(range(1, len(steps) + 1))
    for before, after in itertools.pairwise(steps):
        assert after.weight >= before.weight
        assert after.weight > before.weight or after.cost <= before.cost * (1 + EQUAL_COST)
    first, last = (problem.evaluate(q, steps[-1].weight) for q in (line(problem), solution.trajectory.positions))
    assert last.penalty < 0.5 * first.penalty
    assert last.cost < first.cost


@pytest.mark.core
@every_solver
def test_the_same_problem_gives_the_same_bytes(solver: str) -> None:
    one, other = (run(build(arm()), solver) for _ in range(2))
    assert one.trajectory.positions.tobytes() == other.trajectory.positions.tobytes()
    assert one.steps == other.steps


@every_solver
def test_a_guess_deep_in_an_obstacle_stays_finite(solver: str) -> None:
    """The whole arm within a body, its middle where all pushes cancel."""
    scene = arm(Obstacle("sea", Box((6.0, 6.0, 2.0))), Obstacle("ball", Sphere(0.4), Pose((0.5, 0.0, 0.1))))
    problem = build(scene)
    solution = run(problem, solver, wild(problem), iterations=min(10, SAMPLED[solver]))
    assert np.isfinite(solution.trajectory.positions).all()
    assert all(np.isfinite([step.cost, step.depth]).all() for step in solution.steps)
    assert solution.status is not SolverStatus.CLEAR


@every_solver
def test_one_free_waypoint_is_enough(solver: str) -> None:
    problem = build(arm(waypoints=3))
    solution = run(problem, solver)
    assert solution.trajectory.positions.shape == (3, 2)
    weight = solution.steps[-1].weight
    before, after = (problem.evaluate(q, weight) for q in (line(problem), solution.trajectory.positions))
    assert after.cost < before.cost


@every_solver
def test_start_and_goal_may_be_one(solver: str) -> None:
    problem = build(dataclasses.replace(arm(), goal=JointTarget("goal", state="right")))
    found = run(problem, solver).trajectory.positions
    np.testing.assert_allclose(found, line(problem), rtol=0, atol=MINIMUM)


@every_solver
def test_a_deadline_in_the_past_takes_no_step(problem: Problem, solver: str) -> None:
    guess = problem.clip(wild(problem))
    solution = run(problem, solver, guess, deadline=time.perf_counter() - 1)
    assert (solution.status, solution.steps) == (SolverStatus.TIME, ())
    np.testing.assert_array_equal(solution.trajectory.positions, guess)


@every_solver
def test_no_iterations_left_is_reported(problem: Problem, solver: str) -> None:
    assert run(problem, solver, iterations=1).status is SolverStatus.ITERATIONS


@every_solver
def test_an_interrupt_gives_the_best_so_far(problem: Problem, solver: str) -> None:
    seen: list[Iteration] = []

    def interrupt(step: Iteration, _: Array) -> None:
        seen.append(step)
        if len(seen) == 2:
            raise KeyboardInterrupt

    solution = run(problem, solver, report=interrupt)
    assert solution.status is SolverStatus.INTERRUPTED
    assert solution.steps == tuple(seen)
    found = solution.trajectory.positions
    np.testing.assert_array_equal(found[[0, -1]], [problem.start, problem.goal])
    assert problem.evaluate(found, seen[-1].weight).cost == pytest.approx(seen[-1].cost, rel=1e-12)


@every_solver
def test_every_step_is_reported_with_its_waypoints(problem: Problem, solver: str) -> None:
    seen: list[tuple[Iteration, Array]] = []
    solution = run(problem, solver, report=lambda *step: seen.append(step))
    assert solution.steps == tuple(step for step, _ in seen)
    for step, positions in seen:
        assert problem.evaluate(positions, step.weight).cost == pytest.approx(step.cost, rel=1e-12)
    np.testing.assert_array_equal(seen[-1][1], solution.trajectory.positions)


def test_the_weight_goes_up_until_bodies_keep_their_distance(problem: Problem) -> None:
    """The default solver ends clear, after weights that only rise; the first is the budget's."""
    solution = solve(problem, budget=Budget(first_weight=100.0))
    weights = [step.weight for step in solution.steps]
    assert weights[0] == 100.0
    assert weights == sorted(weights)
    assert solution.status is SolverStatus.CLEAR
    assert solution.steps[-1].depth <= problem.scene.planner.activation


def test_an_enclosed_goal_stalls() -> None:
    """Nothing but the ends is within the margin where the two are separated by a wall: the solver says so itself."""
    problem = build(arm(Obstacle("wall", Box((3.0, 0.02, 1.0)), Pose((0.6, 0.0, 0.1)))))
    solution = solve(problem)
    assert solution.status in (SolverStatus.STALLED, SolverStatus.ITERATIONS)
    assert solution.status.value


def test_a_locked_joint_goes_along() -> None:
    problem = build(load_scene("empty"))
    assert solve(problem, budget=Budget(iterations=1)).trajectory.locked == problem.robot.locked


def test_an_unknown_solver_is_refused_and_the_nearest_offered(problem: Problem) -> None:
    with pytest.raises(InputError, match=r"solver: unknown 'gaus_newton' \(did you mean 'gauss_newton'\?\)"):
        solve(problem, solver="gaus_newton")
