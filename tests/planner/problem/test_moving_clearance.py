"""Laws of moving obstacles: where they are, how the planner meets them, and that the certificate is never optimistic
about the relative motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import hdplan
from hdplan.planner.build import build
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.rate_check import RateCheck
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.problem import Problem
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Sphere
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import load_scene


def turned(rng: np.random.Generator) -> Pose:
    quaternion = rng.normal(size=4)
    return Pose(tuple(rng.normal(size=3).tolist()), tuple((quaternion / np.linalg.norm(quaternion)).tolist()))


# --- where they are -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_a_steady_motion_has_its_velocity_and_spin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    motion = SteadyMotion(*(tuple(each) for each in rng.normal(size=(2, 3)).tolist()))
    carried, step = ObstacleMotion.of(Obstacle("a", Sphere(0.1), turned(rng), motion=motion)), 1e-6
    for time in rng.uniform(-1, 5, size=5):
        before, after = carried.at(np.array([time - step, time + step]))
        np.testing.assert_allclose((after - before)[:3, 3] / (2 * step), motion.velocity, atol=1e-8)
        turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec() / (2 * step)
        np.testing.assert_allclose(turn, motion.spin, atol=1e-8)


def test_timed_poses_are_met_and_between_them_the_way_is_the_shortest() -> None:
    rng = np.random.default_rng(3)
    times, poses = (0.5, 1.0, 3.0), tuple(turned(rng) for _ in range(3))
    carried = ObstacleMotion.of(Obstacle("a", Sphere(0.1), poses[0], motion=TimedPoses(times, poses)))
    np.testing.assert_allclose(carried.at(np.array(times)), [pose.matrix for pose in poses], atol=1e-12)
    np.testing.assert_array_equal(carried.at(np.array([-1.0, 0.5])), [poses[0].matrix] * 2)
    np.testing.assert_allclose(carried.at(np.array([9.0]))[0], poses[2].matrix, atol=1e-12)
    when = np.linspace(0.5, 3.0, 40)
    found = carried.at(when)
    slerp = Slerp(times, Rotation.from_matrix([pose.matrix[:3, :3] for pose in poses]))
    np.testing.assert_allclose(found[:, :3, :3], slerp(when).as_matrix(), atol=1e-12)
    wanted = [np.interp(when, times, [pose.position[i] for pose in poses]) for i in range(3)]
    np.testing.assert_allclose(found[:, :3, 3], np.transpose(wanted), atol=1e-12)


# --- the planner ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def crossing() -> Scene:
    """A ball that crosses the robot's way, and a bar that turns beside it."""
    ball = Obstacle("ball", Sphere(0.12), Pose((0.5, -0.9, 0.5)), motion=SteadyMotion((0.0, 0.45, 0.0)))
    bar = Obstacle("bar", Box((0.1, 0.5, 0.1)), Pose((0.9, 0.0, 0.3)), motion=SteadyMotion(spin=(0.0, 0.0, 1.0)))
    return dataclasses.replace(load_scene("empty"), obstacles=(ball, bar), timing=Timing(duration=4.0))


@pytest.fixture(scope="module")
def problem(crossing: Scene) -> Problem:
    return build(crossing)


def test_the_gradient_is_that_of_the_cost(problem: Problem) -> None:
    rng = np.random.default_rng(0)
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    positions = problem.clip(line + rng.normal(scale=0.03, size=line.shape))
    weight, step = 1e4, 1e-6
    state = problem.evaluate(positions, weight)
    term = problem.terms.moving_obstacles
    kinematics = problem.kinematics.evaluate(problem.samples.configurations(positions))
    assert term.at_samples(kinematics, problem.samples).cost > 0.0  # it is met at all
    for _ in range(12):
        direction = np.zeros_like(positions)
        direction[1:-1] = rng.normal(size=positions[1:-1].shape)
        after, before = (problem.evaluate(positions + sign * step * direction, weight).cost for sign in (1, -1))
        assert np.sum(state.gradient * direction[1:-1]) == pytest.approx((after - before) / (2 * step), rel=1e-4)


def test_a_moving_obstacle_is_one_that_stands_where_it_is_at_that_time(problem: Problem, crossing: Scene) -> None:
    """Cost and depth at any one time are those of the scene in which it stands there."""
    moving = problem.terms.moving_obstacles
    rng = np.random.default_rng(4)
    configurations = problem.robot.draw(rng, 200)
    kinematics = problem.kinematics.evaluate(configurations)
    for parameter in (0.2, 0.5, 0.83):
        seconds = float(moving.law.time_at(np.array([parameter]))[0])
        frozen = tuple(
            dataclasses.replace(each, pose=_pose(ObstacleMotion.of(each).at(np.array([seconds]))[0]), motion=None)
            for each in crossing.obstacles
        )
        standing = build(dataclasses.replace(crossing, obstacles=frozen))
        term = standing.terms.obstacles
        found = moving.depth(kinematics, np.full(200, parameter))
        np.testing.assert_allclose(found, term.depth(kinematics), rtol=0, atol=1e-9)
        assert found.max() > 0.0
    assert not moving.depth(kinematics).any()  # of no particular time


def _pose(matrix: np.ndarray) -> Pose:
    return Pose(tuple(matrix[:3, 3].tolist()), tuple(Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()))


def test_the_plan_is_wrong_where_obstacles_are_taken_to_stand() -> None:
    conveyor = load_scene("panda_conveyor")
    result = hdplan.plan(conveyor)
    assert result.certified, result.certificate.text
    assert result.trajectory.times is not None
    assert result.trajectory.times[-1] == 4.0
    still = tuple(dataclasses.replace(each, motion=None) for each in conveyor.obstacles)
    naive = hdplan.plan(dataclasses.replace(conveyor, obstacles=still))
    assert naive.certified
    verdict = Certifier(Setup.of(conveyor)).certify(naive.trajectory)
    assert verdict.status is Status.IN_CONTACT
    assert "first carton" in verdict.text


# --- the certificate --------------------------------------------------------------------------------------------------


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(4))
def test_the_certificate_is_never_optimistic_about_the_relative_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = load_scene("planar_arm" if seed % 2 else "empty")
    robot = load_scene_robot(scene)
    motions = (
        SteadyMotion(tuple(rng.normal(scale=0.2, size=3)), tuple(rng.normal(scale=2.0, size=3))),
        TimedPoses((0.1, 0.9, 1.4), tuple(turned(rng) for _ in range(3))),
    )
    obstacles = tuple(
        Obstacle(f"o{i}", Box((0.3, 0.05, 0.1)), getattr(motion, "poses", [turned(rng)])[0], motion=motion)
        for i, motion in enumerate(motions)
    )
    scene = dataclasses.replace(scene, obstacles=obstacles, timing=Timing(duration=2.0))
    certifier = Certifier(Setup.of(scene, robot))
    rows = robot.draw(rng, 1) + np.cumsum(rng.normal(scale=0.1, size=(4, robot.n)), axis=0)
    rows = np.clip(rows, robot.lower, robot.upper)
    rates = rng.normal(scale=0.2, size=(2, *rows.shape))
    motion = Trajectory(robot.joint_names, rows, robot.locked, np.linspace(0, 2, 4), *rates)
    verdict = certifier.certify(motion, check_ends=False)
    found = []
    for parameter in np.linspace(0, 1, 400):
        place, _ = certifier.nearest(motion.at(parameter), time=float(motion.curve.time_of(parameter)))
        assert place is not None
        found.append(place.distance)
    if verdict.clearance is None:
        assert verdict.failures
        assert min(found) < 1e-2
    else:
        assert verdict.clearance <= min(found) + 1e-9
        assert verdict.clearance >= 0.5 * min(found) - 1e-3  # true but useless bounds would pass the law above


def test_an_obstacle_that_runs_into_the_base_is_seen(crossing: Scene) -> None:
    """Links fixed to the world do not move, but what moves may hit them."""
    ram = Obstacle("ram", Sphere(0.05), Pose((-1.0, 0.0, 0.05)), motion=SteadyMotion((0.5, 0.0, 0.0)))
    scene = dataclasses.replace(crossing, obstacles=(ram,))
    robot = load_scene_robot(scene)
    q = build(scene).start
    times = np.linspace(0.0, 4.0, 3)
    verdict = Certifier(Setup.of(scene, robot)).certify(
        Trajectory(robot.joint_names, np.tile(q, (3, 1)), robot.locked, times), check_ends=False
    )
    assert verdict.status is Status.IN_CONTACT
    assert "panda_link0 and ram" in verdict.text


def test_a_path_without_times_meets_no_moving_obstacle(crossing: Scene) -> None:
    robot = load_scene_robot(crossing)
    path = Trajectory(robot.joint_names, np.zeros((2, robot.n)), robot.locked)
    with pytest.raises(InputError, match="has no times, and obstacle 'ball' moves"):
        Certifier(Setup.of(crossing, robot)).certify(path)


# --- the velocity penalty --------------------------------------------------------------------------------------------


def test_the_velocity_penalty_has_its_exact_gradient_and_curvature(problem: Problem) -> None:
    penalty = problem.terms.velocity
    rng = np.random.default_rng(6)
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    fast = line + np.cumsum(rng.normal(scale=0.2, size=line.shape), axis=0)
    assert penalty.over_motion(line[:1] + 0 * line, problem.kinematics).cost == 0.0  # at rest
    found, step = penalty.over_motion(fast, problem.kinematics), 1e-6
    assert found.cost > 0.0
    for _ in range(8):
        v = rng.normal(size=fast.shape)
        after, before = (penalty.over_motion(fast + sign * step * v, problem.kinematics) for sign in (1, -1))
        assert np.sum(found.gradient * v) == pytest.approx((after.cost - before.cost) / (2 * step), rel=1e-5)
        bent = np.einsum("kij,kj->ki", found.diagonal, v)
        bent[1:] += np.einsum("kij,kj->ki", found.coupling, v[:-1])
        bent[:-1] += np.einsum("kji,kj->ki", found.coupling, v[1:])
        np.testing.assert_allclose(bent, (after.gradient - before.gradient) / (2 * step), rtol=1e-4, atol=1e-6)


def test_a_motion_clear_of_the_velocity_penalty_is_executed_within_the_limits(
    problem: Problem, crossing: Scene
) -> None:
    """The margin that a clear motion may use up ends below the limit, by the executed curve's own bounds."""
    penalty = problem.terms.velocity
    robot, half = problem.robot, 0.5 * crossing.planner.activation
    rng = np.random.default_rng(8)
    keeper = Retimer(Setup.of(crossing, robot))
    for _ in range(5):
        second_order = rng.normal(scale=0.6, size=robot.n) * np.sin(np.pi * np.linspace(0, 1, 32))[:, None]
        rows = np.clip(np.linspace(problem.start, problem.goal, 32) + second_order, robot.lower, robot.upper)
        clear = penalty.over_motion(rows, problem.kinematics).depth.max() <= half
        timed = keeper(Trajectory(robot.joint_names, rows, robot.locked)).trajectory
        (use,) = RateCheck(Setup.of(crossing, robot)).check(timed.curve).uses
        assert use.within or not clear
