"""Laws that any planner of this kind keeps, whatever its internals: exact derivatives, symmetries of the world, closed
forms, indifference to what is far away, the same bytes, and a sane end from any first guess.

Written against `plan`, `build`, `Problem.evaluate` and `solve` alone.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan.planner.build import build
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.roadmap import seeds
from hdplan.planner.solvers import SOLVERS, solve
from hdplan.planner.solvers.solution import Budget, Solution, SolverStatus
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Points, Sphere
from hdplan.scenes.targets import JointTarget
from tests.planner.problem.whole_graph import whole_matrix

from ..urdf import joint_text, link_text, write_robot

# Derivatives, relative to the largest number compared. Fourth-order differences with steps of STEP: the distance bends
# over its shaping length of 1 mm, so their error is about (STEP / 1 mm)⁴; rounding adds 1e-16 / STEP.
STEP, DIFFERENCE = 1e-5, 1e-8
WITNESS = 1e-6  # the same where the distance comes from an iteration, whose last digits are noise
ROUNDING = 1e-11  # the same sums in another order or in another frame; relative
PATH = 1e-8  # [rad] between two motions that are one but for rounding: some 30 steps amplify 1e-16 to 1e-11 at most
FITTED = 1e-6  # [rad] the same where the links' bodies are symmetric only as far as their fit converges, 1e-7 m
MINIMUM = 1e-8  # [rad] from a closed-form minimum
# Iterations within which the laws are tested. A gradient step of chomp makes two runs that are one but for rounding,
# or for their bodies' fit, part by some four times more; where the steps have come down to rounding, that decides which
# of them are taken, and both runs are right. those of ipopt and fatrop are runs of 5 steps.
FEW = {"gauss_newton": 60, "chomp": 7, "ipopt": 2, "fatrop": 2}
PATIENCE = 20.0  # [s] after which a run from a wild guess counts as hanging; none needs more than 2

every_solver = pytest.mark.parametrize("solver", SOLVERS)


# --- scenes -----------------------------------------------------------------------------------------------------------


@functools.cache
def shipped(name: str, waypoints: int | None = None) -> Scene:
    scene = hdplan.load_scene(name)
    return scene if waypoints is None else with_waypoints(scene, waypoints)


def with_waypoints(scene: Scene, count: int) -> Scene:
    return dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, waypoints=count))


def between(scene: Scene, start: Array, goal: Array) -> Scene:
    ends = {"start": JointTarget("start", tuple(start.tolist())), "goal": JointTarget("goal", tuple(goal.tolist()))}
    return dataclasses.replace(scene, **ends)


def ignoring(scene: Scene, *names: str) -> Scene:
    """Without the pairs of links among which one of these links is; without any if no name is given."""
    pairs = [pair for pair in build(scene).robot.self_pairs if not names or set(pair) & set(names)]
    known = scene.robot.ignore_pairs
    return dataclasses.replace(scene, robot=dataclasses.replace(scene.robot, ignore_pairs=(*known, *pairs)))


def moved(pose: Pose, by: Pose) -> Pose:
    """A pose carried along by a motion of the world."""
    (x1, y1, z1, w1), (x2, y2, z2, w2) = by.quaternion_xyzw, pose.quaternion_xyzw
    turn = (
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
    )
    return Pose(tuple((by.matrix @ pose.matrix)[:3, 3].tolist()), turn)


def carried(scene: Scene, by: Pose) -> Scene:
    obstacles = tuple(dataclasses.replace(each, pose=moved(each.pose, by)) for each in scene.obstacles)
    return dataclasses.replace(scene, obstacles=obstacles)


def about(axis: tuple[float, float, float], angle: float, position: tuple[float, float, float] = (0, 0, 0)) -> Pose:
    unit = np.array(axis) / np.linalg.norm(axis)
    return Pose(position, (*(np.sin(angle / 2) * unit).tolist(), float(np.cos(angle / 2))))


def mirrored(obstacle: Obstacle) -> Obstacle:
    """Reflected in the x-z plane: S R S is a rotation again, of the shape's own mirror image."""
    (x, y, z), (qx, qy, qz, qw) = obstacle.pose.position, obstacle.pose.quaternion_xyzw
    shape = obstacle.shape
    if isinstance(shape, Points):
        shape = Points(tuple((a, -b, c) for a, b, c in shape.points))
    return Obstacle(obstacle.name, shape, Pose((x, -y, z), (-qx, qy, -qz, qw)))


def line(problem: Problem) -> Array:
    return np.linspace(problem.start, problem.goal, problem.waypoints)


def run(scene: Scene, solver: str, guess: Array | None = None) -> Solution:
    return solve(build(scene), solver=solver, guess=guess, budget=Budget(iterations=FEW[solver]))


def assert_same_motion(one: Solution, other: Array, solution: Solution, tolerance: float) -> None:
    """Both runs took the same steps and ended with the same waypoints; `other` are the second's, carried back."""
    assert one.iterations == solution.iterations
    np.testing.assert_allclose(one.trajectory.positions, other, rtol=0, atol=tolerance)
    assert np.abs(one.trajectory.positions - np.linspace(*one.trajectory.positions[[0, -1]], len(other))).max() > 0.05


# --- derivatives ------------------------------------------------------------------------------------------------------


def differences(function: Callable[[Array], Array], x: Array) -> Array:
    """Fourth-order central differences of a function of x (m,), along the last axis."""

    def along(unit: Array) -> Array:
        near, far = (function(x + k * STEP * unit) - function(x - k * STEP * unit) for k in (1, 2))
        return np.asarray((8 * near - far) / (12 * STEP))

    return np.stack([along(unit) for unit in np.eye(len(x))], axis=-1)


def close(found: Array, expected: Array, tolerance: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * float(np.abs(expected).max()))


@functools.cache
def term(name: str, what: str) -> Problem:
    """A problem of few waypoints with one term beside smoothness."""
    scene = shipped(name, 4)
    return build(ignoring(scene) if what == "obstacles" else dataclasses.replace(scene, obstacles=()))


def in_contact(problem: Problem, count: int) -> list[Array]:
    """The worst of some random motions: contacts of centimetres."""
    rng = np.random.default_rng(1)
    drawn = [problem.clip(problem.robot.draw(rng, problem.waypoints)) for _ in range(150)]
    worst = sorted(drawn, key=lambda q: -problem.evaluate(q, 1.0).penalty)[:count]
    assert problem.evaluate(worst[-1], 1.0).penalty > 1e-5
    return worst


def interior(problem: Problem, positions: Array, part: str, weight: float = 1.0) -> Callable[[Array], Array]:
    """A part of the evaluation, flat, as a function of the interior waypoints (M n,)."""

    def function(x: Array) -> Array:
        changed = positions.copy()
        changed[1:-1] = x.reshape(changed[1:-1].shape)
        return np.squeeze(np.ravel(getattr(problem.evaluate(changed, weight), part)))

    return function


def penalty_gradient(problem: Problem, positions: Array) -> Array:
    with_penalty, without = (problem.evaluate(positions, weight).gradient for weight in (1e6, 0.0))
    return (with_penalty - without).ravel() / 1e6


def gauss_newton(problem: Problem, positions: Array) -> Array:
    """The penalty's Gauss-Newton matrix (M n, M n), from its blocks."""
    state = problem.evaluate(positions, 1.0)
    return whole_matrix(state.diagonal, state.coupling)


every_term = pytest.mark.parametrize(
    ("name", "what"),
    [
        ("planar_arm", "obstacles"),
        ("panda_corridor", "obstacles"),
        ("panda_corridor", "self-collision"),
        ("ur5_table", "obstacles"),
        ("ur5_table", "self-collision"),
    ],
)


@pytest.mark.parametrize(
    ("name", "distance", "tolerance"),
    [
        ("planar_arm", "hdsdf", DIFFERENCE),
        ("panda_corridor", "hdsdf", DIFFERENCE),
        ("ur5_table", "hdsdf", DIFFERENCE),
        ("planar_arm", "fcl", WITNESS),
        ("panda_corridor", "fcl", WITNESS),
    ],
)
def test_the_gradient_is_that_of_the_cost(name: str, distance: str, tolerance: float) -> None:
    """Smoothness and penalty weigh about the same. The exact distance has kinks; a random motion
    misses them."""
    scene = shipped(name, 4)
    problem = build(dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, distance=distance)))
    for positions in in_contact(problem, 3):
        x = positions[1:-1].ravel()
        cost, gradient = (interior(problem, positions, part, 1e4) for part in ("cost", "gradient"))
        close(gradient(x), differences(cost, x), tolerance)


@every_term
def test_the_gradient_of_each_term_is_that_of_its_cost(name: str, what: str) -> None:
    problem = term(name, what)
    for positions in in_contact(problem, 3):
        expected = differences(interior(problem, positions, "penalty"), positions[1:-1].ravel())
        close(penalty_gradient(problem, positions), expected, DIFFERENCE)


@every_term
def test_the_curvature_of_each_term_is_made_of_its_gradients(name: str, what: str) -> None:
    """P = ½ |r|² has the gradient Jᵀr, so 2 P JᵀJ − ∇P∇Pᵀ = Jᵀ(|r|² − r rᵀ)J is never negative."""
    problem = term(name, what)
    for positions in in_contact(problem, 3):
        slope, matrix = penalty_gradient(problem, positions), gauss_newton(problem, positions)
        rest = 2 * problem.evaluate(positions, 1.0).penalty * matrix - np.outer(slope, slope)
        assert np.linalg.eigvalsh(rest)[0] >= -ROUNDING * np.abs(matrix).max()


@pytest.mark.parametrize(
    ("name", "what"), [("planar_arm", "obstacles"), ("panda_corridor", "obstacles"), ("ur5_table", "self-collision")]
)
def test_the_curvature_of_one_residual_is_the_outer_product_of_its_gradient(name: str, what: str) -> None:
    """The same vanishes where only one pair at one sample is within its margin: where a motion has just come there."""
    problem = term(name, what)
    for positions in in_contact(problem, 3):
        grazing = just_in_contact(problem, positions)
        slope = penalty_gradient(problem, grazing)
        close(2 * problem.evaluate(grazing, 1.0).penalty * gauss_newton(problem, grazing), np.outer(slope, slope), 1e-8)


def just_in_contact(problem: Problem, touching: Array) -> Array:
    """A motion between this one and standing still in the open, with a penalty of 1e-12 m²: 1e-5 m at one sample."""
    drawn = problem.robot.draw(np.random.default_rng(3), 100)
    resting = (np.tile(q, (problem.waypoints, 1)) for q in drawn)
    free = next(motion for motion in resting if problem.evaluate(motion, 1.0).penalty == 0)
    low, high = 0.0, 1.0
    for _ in range(60):
        share = (low + high) / 2
        penalty = problem.evaluate((1 - share) * free + share * touching, 1.0).penalty
        low, high = (share, high) if penalty < 1e-12 else (low, share)
    return (1 - high) * free + high * touching


@pytest.mark.parametrize("name", ["panda_corridor", "ur5_table"])
def test_terms_add_up(name: str) -> None:
    """Cost, gradient and curvature of a scene are those of its obstacles alone plus those of its links alone."""
    whole = build(shipped(name, 4))
    parts = [term(name, what) for what in ("obstacles", "self-collision")]
    for positions in in_contact(parts[1], 2):
        one = whole.evaluate(positions, 1.0)
        others = [part.evaluate(positions, 1.0) for part in parts]
        assert all(other.penalty > 0 for other in others)
        assert one.penalty == pytest.approx(sum(other.penalty for other in others), rel=ROUNDING)
        close(one.diagonal, sum(other.diagonal for other in others), ROUNDING)
        close(penalty_gradient(whole, positions), sum(penalty_gradient(p, positions) for p in parts), 1e-8)
        np.testing.assert_array_equal(one.depth, np.max([other.depth for other in others], axis=0))


def test_smoothness_is_quadratic_and_its_hessian_exact() -> None:
    """Second differences of a quadratic are exact at any step, so they are taken with steps of 1 rad."""
    problem = build(dataclasses.replace(ignoring(shipped("planar_arm", 7)), obstacles=()))
    rng = np.random.default_rng(2)
    n, positions = problem.robot.n, problem.robot.draw(rng, 7)
    gradient = interior(problem, positions, "gradient")
    x = positions[1:-1].ravel()
    hessian = np.stack([(gradient(x + unit) - gradient(x - unit)) / 2 for unit in np.eye(len(x))], axis=-1)
    close(hessian, np.kron(problem.smoothness.matrix[1:-1, 1:-1], np.eye(n)), ROUNDING)
    cost = interior(problem, positions, "smoothness")
    step = rng.normal(size=len(x))
    assert cost(x + step) == pytest.approx(cost(x) + gradient(x) @ step + step @ hessian @ step / 2, rel=ROUNDING)
    close(gradient(x), differences(cost, x), DIFFERENCE)


# --- symmetries of the world ------------------------------------------------------------------------------------------

arms_and_solvers = pytest.mark.parametrize(
    ("name", "solver"),
    [
        *(("planar_arm", solver) for solver in SOLVERS),
        *(("panda_cage", solver) for solver in SOLVERS),
        *(("ur5_table", solver) for solver in SOLVERS),
    ],
)

ELSEWHERE = about((0.3, -0.5, 0.7), 2.0, (1.3, -2.1, 0.7))


@arms_and_solvers
def test_robot_and_obstacles_moved_together_give_the_same_motion(name: str, solver: str) -> None:
    """Bodies, planes and broad phase live in the bodies' own frames: the world's frame enters by rounding alone."""
    scene = shipped(name)
    there = carried(dataclasses.replace(scene, robot=dataclasses.replace(scene.robot, base=ELSEWHERE)), ELSEWHERE)
    one, other = run(scene, solver), run(there, solver)
    assert_same_motion(one, other.trajectory.positions, other, PATH)


@pytest.mark.parametrize(
    ("name", "base_link", "solver"),
    [
        ("planar_arm", "pedestal", "gauss_newton"),
        ("planar_arm", "pedestal", "chomp"),
        ("panda_corridor", "panda_link0", "gauss_newton"),
        ("ur5_table", "base_link", "gauss_newton"),
        ("ur5_table", "base_link", "chomp"),
    ],
)
def test_obstacles_turned_about_the_first_joint_turn_the_motion(name: str, base_link: str, solver: str) -> None:
    """Every motion's first joint is off by that angle. The base's own link does not turn along: it is left out."""
    scene, angle = ignoring(shipped(name), base_link), 0.7
    shift = np.zeros(build(scene).robot.n)
    shift[0] = angle
    problem = build(scene)
    turned = between(carried(scene, about((0, 0, 1), angle)), problem.start + shift, problem.goal + shift)
    one, other = run(scene, solver), run(turned, solver)
    assert_same_motion(one, other.trajectory.positions - shift, other, PATH)


BLOCK = Obstacle("block", Box((0.2, 0.15, 0.3)), about((0, 0, 1), 0.4, (0.9, 0.05, 0.1)))


def in_hulls(scene: Scene) -> Scene:
    """The scene with the hulls of the links, which are their own mirror images; fitted bodies need not be."""
    return dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, link_bodies="hull"))


def assert_mirrored(scene: Scene, signs: Array, solver: str) -> None:
    """The motion is that of the mirrored scene, whose joints turn by these signs."""
    problem = build(scene)
    image = between(scene, signs * problem.start, signs * problem.goal)
    image = dataclasses.replace(image, obstacles=tuple(map(mirrored, scene.obstacles)))
    one, other = run(scene, solver), run(image, solver)
    assert_same_motion(one, signs * other.trajectory.positions, other, FITTED)


@every_solver
def test_a_mirrored_plane_gives_the_mirrored_motion(solver: str) -> None:
    """The planar arm seen in the x-z plane: q → −q."""
    scene = shipped("planar_arm")
    assert_mirrored(in_hulls(dataclasses.replace(scene, obstacles=(*scene.obstacles, BLOCK))), -np.ones(2), solver)


SIGNS = np.array([-1.0, 1.0, -1.0, 1.0])  # of joints about z, y, x, y in the x-z plane's mirror


@pytest.fixture(scope="module")
def symmetric_arm(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Four square bars, each its own mirror image, on joints about z, y, x and y; a leaning slab in their way."""
    file = tmp_path_factory.mktemp("arm") / "bars.urdf"
    axes, lengths = ("0 0 1", "0 1 0", "1 0 0", "0 1 0"), (0.12, 0.4, 0.35, 0.25)
    parts, parent, height = [link_text("base")], "base", 0.2
    for k, (axis, length) in enumerate(zip(axes, lengths, strict=True)):
        parts.append(link_text(f"bar{k}", box=f"0.05 0.05 {length + 0.05}", at=f"0 0 {length / 2}"))
        parts.append(joint_text(f"joint{k}", parent, f"bar{k}", axis, at=f"0 0 {height}", limits=(-2.9, 2.9)))
        parent, height = f"bar{k}", length
    write_robot(file, *parts)
    slab = Obstacle("slab", Box((0.2, 0.12, 0.5)), about((1, 0.3, 1), 0.3, (0.7, 0.05, 0.35)))
    scene = Scene(
        "bars",
        file,
        RobotSpec(urdf=file),
        (slab,),
        JointTarget("start", state="none"),
        JointTarget("goal", state="none"),
    )
    return between(in_hulls(scene), np.array([-0.7, 1.0, 0.3, 0.6]), np.array([0.8, 1.2, -0.2, 0.4]))


ROUND = (Sphere(0.13), Cylinder(0.1, 0.4), Capsule(0.1, 0.3))


@pytest.mark.parametrize("shape", ROUND, ids=["sphere", "cylinder", "capsule"])
def test_round_bodies_are_mirrored_too(symmetric_arm: Scene, shape: Sphere | Cylinder | Capsule) -> None:
    """Their planes stand for them in the problem, and are their own mirror images."""
    leaning = Obstacle("round", shape, about((1, 0.3, 1), 0.3, (0.7, 0.05, 0.5)))
    assert_mirrored(dataclasses.replace(symmetric_arm, obstacles=(leaning,)), SIGNS, "gauss_newton")


@every_solver
def test_a_mirrored_scene_gives_the_mirrored_motion(symmetric_arm: Scene, solver: str) -> None:
    assert_mirrored(symmetric_arm, SIGNS, solver)


# --- symmetries of time -----------------------------------------------------------------------------------------------

# A problem has no time yet: its motions are paths over a parameter from 0 to 1. What is left of a shift in time is that
# neither direction nor number of samples means anything: the way back is the way there, and a path costs what it costs.


@arms_and_solvers
def test_the_way_back_is_the_way_there(name: str, solver: str) -> None:
    """The straight line as guess, and one that is reversed as well."""
    scene = shipped(name)
    problem = build(scene)
    back = between(scene, problem.goal, problem.start)
    bent = line(problem) + 0.2 * np.sin(np.linspace(0, 3, problem.waypoints))[:, None]
    for guess in (None, bent):
        one, other = run(scene, solver, guess), run(back, solver, None if guess is None else guess[::-1])
        assert_same_motion(one, other.trajectory.positions[::-1], other, PATH)


@pytest.mark.core
@pytest.mark.parametrize("name", ["planar_arm", "panda_corridor"])
def test_a_plan_back_is_the_plan_there(name: str) -> None:
    scene = shipped(name)
    problem = build(scene)
    there, back = hdplan.plan(scene), hdplan.plan(between(scene, problem.goal, problem.start))
    assert there.certified
    assert there.attempts == back.attempts == 1  # CHOMP's second opinion ends some steps sooner or later, by rounding
    np.testing.assert_allclose(there.trajectory.positions, back.trajectory.positions[::-1], rtol=0, atol=PATH)
    assert there.certificate.clearance == pytest.approx(back.certificate.clearance, rel=1e-6)


def test_a_path_costs_the_same_however_many_waypoints_show_it() -> None:
    """½ ∫|q'|² + ½ α ∫|q''|²: for a line exactly, for q = t² to the first order of 1/N."""
    alpha = build(shipped("planar_arm")).smoothness.acceleration
    errors = []
    for count in (20, 39, 77):
        problem = build(dataclasses.replace(ignoring(shipped("planar_arm", count)), obstacles=()))
        straight = problem.evaluate(line(problem), 1.0)
        assert straight.cost == pytest.approx(np.sum((problem.goal - problem.start) ** 2) / 2, rel=1e-9)
        bent = np.repeat(np.linspace(0, 1, count)[:, None] ** 2, 2, axis=1)  # two joints, q' = 2 t, q'' = 2
        errors.append(problem.evaluate(bent, 1.0).cost / (4 / 3 + 4 * alpha) - 1)
    assert all(abs(after) <= 0.55 * abs(before) for before, after in itertools.pairwise(errors))
    assert abs(errors[-1]) < 2e-3


@pytest.mark.parametrize("name", ["planar_arm", "panda_corridor"])
def test_standing_still_in_contact_costs_the_same_however_often_it_is_looked_at(name: str) -> None:
    few, many = (build(shipped(name, count)) for count in (5, 40))
    q = max((motion[1] for motion in in_contact(few, 8)), key=lambda q: few.evaluate(np.tile(q, (5, 1)), 1.0).penalty)
    still, longer = np.tile(q, (5, 1)), np.tile(q, (40, 1))
    expected = few.evaluate(still, 1.0)
    assert expected.penalty > 0
    for problem, positions in ((many, longer), (few.refined([0, 2]), still), (few.resampled(line(few)), still)):
        state = problem.evaluate(positions, 1.0)
        assert state.penalty == pytest.approx(expected.penalty, rel=ROUNDING)
        assert state.depth.max() == pytest.approx(expected.depth.max(), rel=ROUNDING)


# --- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["empty", "ur5_table"])
@every_solver
def test_an_empty_scene_is_solved_by_the_straight_line(name: str, solver: str) -> None:
    """Any guess will do."""
    scene = dataclasses.replace(shipped(name), obstacles=())
    problem = build(ignoring(scene))  # a wild guess may leave links on the wrong side of each other
    for words, guess in {"line": line(problem), **wild_guesses(problem, 20)}.items():
        solution = solve(problem, solver=solver, guess=guess)
        assert solution.status is SolverStatus.CLEAR, words
        np.testing.assert_allclose(solution.trajectory.positions, line(problem), rtol=0, atol=MINIMUM, err_msg=words)


# --- what is far away -------------------------------------------------------------------------------------------------

SHAPES = (
    Box((1.0, 2.0, 1.0)),
    Sphere(0.5),
    Cylinder(0.3, 1.0),
    Capsule(0.2, 0.5),
    Points(((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))),
)


def far_away(count: int) -> list[Obstacle]:
    """Bodies of every shape, 8 to 80 m off, turned at random."""
    rng = np.random.default_rng(5)
    places = rng.normal(size=(count, 3))
    places *= rng.uniform(8, 80, (count, 1)) / np.linalg.norm(places, axis=1, keepdims=True)
    turns = rng.normal(size=(count, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    return [
        Obstacle(f"far{k}", SHAPES[k % len(SHAPES)], Pose(tuple(place), tuple(turn)))
        for k, (place, turn) in enumerate(zip(places.tolist(), turns.tolist(), strict=True))
    ]


@pytest.mark.parametrize("name", ["panda_corridor", "ur5_table"])
def test_a_plan_does_not_see_what_is_far_away(name: str) -> None:
    """Not by a byte of the motion or of its certificate, wherever in the list it stands."""
    scene, far = shipped(name), far_away(40)
    crowded = dataclasses.replace(scene, obstacles=(*far[:20], *scene.obstacles, *far[20:]))
    one, other = hdplan.plan(scene), hdplan.plan(crowded)
    assert one.trajectory.positions.tobytes() == other.trajectory.positions.tobytes()
    assert one.steps == other.steps
    assert (one.certificate.clearance, one.certificate.worst) == (other.certificate.clearance, other.certificate.worst)


@pytest.mark.parametrize("name", ["panda_corridor", "ur5_table"])
def test_obstacles_in_reach_but_never_near_change_nothing(name: str) -> None:
    """Such bodies are in the problem's tables; the motion is the same but for the order of sums."""
    scene = shipped(name)
    under, above = Obstacle("under", Box((0.5, 0.5, 0.1)), Pose((0, 0, -0.4))), Obstacle("above", Sphere(0.1))
    crowd = (under, *scene.obstacles, dataclasses.replace(above, pose=Pose((-0.5, 0, 1.0))))
    one, other = run(scene, "gauss_newton"), run(dataclasses.replace(scene, obstacles=crowd), "gauss_newton")
    assert_same_motion(one, other.trajectory.positions, other, PATH)


# --- the same bytes ---------------------------------------------------------------------------------------------------

BETWEEN_WALLS = """
import dataclasses, hashlib, hdplan
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.shapes import Box
from hdplan.scenes.targets import JointTarget
scene = hdplan.load_scene("planar_arm")
walls = tuple(Obstacle(f"wall{x}", Box((3.0, 0.02, 1.0)), Pose((x, 0.0, 0.1))) for x in (1.85, -1.85))
scene = dataclasses.replace(
    scene, obstacles=walls, start=JointTarget("start", (-0.3, 0.0)), goal=JointTarget("goal", (0.3, 0.0)),
    planner=dataclasses.replace(scene.planner, waypoints=12),
)
events = []
result = hdplan.plan(scene, seed=7, report=events.append, stop=lambda: len(events) >= 150)
print(hashlib.sha256(result.trajectory.positions.tobytes()).hexdigest())
print(result.attempts, result.iterations, result.certificate.text, [step for step in result.steps])
"""


def test_the_same_seed_gives_the_same_bytes_in_another_process() -> None:
    """Many guesses at a problem without a solution, ended after a fixed number of steps, not by the clock."""
    messages = [
        subprocess.run(
            [sys.executable, "-c", BETWEEN_WALLS],
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        ).stdout
        for hash_seed in ("1", "2")
    ]
    assert messages[0] == messages[1]
    assert int(messages[0].split()[1]) > 1, "random guesses were among them"


def test_an_earlier_plan_leaves_no_trace() -> None:
    """A process keeps the same of a robot for every scene."""
    scene = shipped("panda_corridor")
    first = hdplan.plan(scene)
    hdplan.plan(shipped("panda_cage"), time_limit=1.0)
    hdplan.plan(dataclasses.replace(ignoring(scene), obstacles=tuple(far_away(5))))
    again = hdplan.plan(scene)
    assert first.trajectory.positions.tobytes() == again.trajectory.positions.tobytes()
    assert first.steps == again.steps


# --- any first guess --------------------------------------------------------------------------------------------------


def test_guesses_deep_inside_an_obstacle_come_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """All waypoints at once deep in the ball or the prism, and paths through there, each as a plan's first guess. A
    hinge pushes out to the nearest side, which may be the wrong one: a few need a second guess, none is lost."""
    scene = shipped("planar_arm")
    problem = build(scene)
    drawn = problem.robot.draw(np.random.default_rng(0), 600)
    depth = [problem.evaluate(np.tile(q, (problem.waypoints, 1)), 1.0).depth.max() for q in drawn]
    deep = drawn[np.array(depth) > 0.1][:10]
    assert len(deep) == 10
    half = problem.waypoints // 2
    attempts = []
    for q in deep:
        through = [np.linspace(problem.start, q, half), np.linspace(q, problem.goal, problem.waypoints - half)]
        for guess in (np.tile(q, (problem.waypoints, 1)), np.vstack(through)):
            first = problem.clip(guess)
            monkeypatch.setattr(
                "hdplan.planner.search.guesses.seeds",
                lambda problem, seed, first=first: iter([first, *first_guesses(problem, seed)]),
            )
            result = hdplan.plan(scene)
            assert result.certified, result.certificate.text
            attempts.append(result.attempts)
    assert attempts.count(1) > len(attempts) / 2


def first_guesses(problem: Problem, seed: int) -> list[Array]:
    return list(itertools.islice(seeds(problem, seed), 5))


def test_a_straight_line_through_the_middle_of_an_obstacle_comes_out() -> None:
    """Balls and blocks centred on the forearm or the tip halfway: all are planned around, most from that line."""
    scene = shipped("planar_arm")
    problem = build(scene)
    shoulder, elbow = line(problem)[problem.waypoints // 2]
    upper, fore = (np.array([np.cos(angle), np.sin(angle), 0]) for angle in (shoulder, shoulder + elbow))
    attempts = []
    for along, shape in itertools.product((0.3, 0.4, 0.5), (Sphere(0.08), Sphere(0.12), Box((0.15, 0.15, 0.2)))):
        place = Pose(tuple((np.array([0, 0, 0.1]) + 0.5 * upper + along * fore).tolist()))
        result = hdplan.plan(dataclasses.replace(scene, obstacles=(Obstacle("middle", shape, place),)))
        assert result.certified, result.certificate.text
        attempts.append(result.attempts)
    assert attempts.count(1) > len(attempts) / 2


def wild_guesses(problem: Problem, count: int) -> dict[str, Array]:
    """First guesses that nobody would give; most break limits and ends."""
    rng, shape = np.random.default_rng(8), (problem.waypoints, problem.robot.n)
    low, high = problem.robot.lower, problem.robot.upper
    guesses = {
        "lower limits": np.tile(low, (shape[0], 1)),
        "upper limits": np.tile(high, (shape[0], 1)),
        "from limit to limit": np.where(np.arange(shape[0])[:, None] % 2 == 0, low, high),
        "all at the start": np.tile(problem.start, (shape[0], 1)),
        "there and back and there": line(problem)[np.abs(np.arange(shape[0]) * 3 % (2 * shape[0] - 2) - shape[0] + 1)],
        "a million": 1e6 * rng.normal(size=shape),
        "tiny": 1e-300 * rng.normal(size=shape),
    }
    for k in range(count):
        guesses[f"drawn {k}"] = problem.robot.draw(rng, shape[0])
        guesses[f"all at one {k}"] = np.tile(problem.robot.draw(rng, 1), (shape[0], 1))
    return guesses


def assert_ends_well(problem: Problem, solver: str, guess: Array, words: str, iterations: int = 1000) -> None:
    began = time.perf_counter()
    budget = Budget(deadline=began + PATIENCE, iterations=iterations)
    solution = solve(problem, solver=solver, guess=guess, budget=budget)
    found = solution.trajectory.positions
    assert time.perf_counter() - began < PATIENCE, words
    assert np.isfinite(found).all(), words
    assert np.isfinite([[step.cost, step.smoothness, step.depth] for step in solution.steps]).all(), words
    np.testing.assert_array_equal(found[[0, -1]], [problem.start, problem.goal])
    assert np.all((found >= problem.robot.lower) & (found <= problem.robot.upper)), words


@pytest.mark.parametrize(
    ("name", "solver", "waypoints", "count", "iterations"),
    [
        ("planar_arm", "gauss_newton", 12, 15, 1000),
        ("planar_arm", "chomp", 12, 5, 1000),
        ("planar_arm", "ipopt", 12, 5, 1000),
        ("planar_arm", "fatrop", 12, 5, 1000),
        ("panda_cage", "gauss_newton", 16, 2, 1000),
        ("panda_cage", "chomp", 16, 0, 1000),
        ("ur5_table", "gauss_newton", 16, 2, 1000),
    ],
)
def test_every_guess_ends_in_time_with_numbers(
    name: str, solver: str, waypoints: int, count: int, iterations: int
) -> None:
    problem = build(shipped(name, waypoints))
    for words, guess in wild_guesses(problem, count).items():
        assert_ends_well(problem, solver, guess, words, iterations)


@every_solver
def test_a_guess_that_is_none_is_refused(solver: str) -> None:
    problem = build(shipped("planar_arm", 12))
    for wrong in (np.nan, np.inf, -np.inf, 1e300):
        guess = line(problem)
        guess[5, 0] = wrong
        with pytest.raises(InputError, match=r"^guess: waypoint 5, joint 'shoulder': .* finite values up to 1e\+09$"):
            solve(problem, solver=solver, guess=guess)
    for shape in ((11, 2), (12, 1), (24,)):
        with pytest.raises(InputError, match=r"^guess: shape \(.*\), expected \(12, 2\)"):
            solve(problem, solver=solver, guess=np.zeros(shape))
    with pytest.raises(InputError, match=r"^guess: numbers"):
        solve(problem, solver=solver, guess=[["a", 1]] * 12)
    with pytest.raises(InputError, match=r"^guess: numbers"):  # not its real part
        solve(problem, solver=solver, guess=line(problem) * 1j)


@every_solver
def test_joints_without_limits_come_back_from_anywhere(solver: str, tmp_path: Path) -> None:
    """Nothing clips a guess there: a million radians are as far as a certificate looks."""
    scene = shipped("planar_arm", 8)
    assert scene.robot.urdf is not None
    turning = tmp_path / "turning_arm.urdf"
    turning.write_text(scene.robot.urdf.read_text().replace('"revolute"', '"continuous"'))
    problem = build(dataclasses.replace(scene, robot=dataclasses.replace(scene.robot, urdf=turning)))
    assert np.isinf(problem.robot.upper).all()
    rng = np.random.default_rng(9)
    for scale in (1e3, 1e6):
        guess = scale * rng.uniform(-1, 1, (problem.waypoints, problem.robot.n))
        assert_ends_well(problem, solver, guess, f"{scale:g}")
