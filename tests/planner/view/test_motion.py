"""Samples, plots and inverse kinematics of the viewer, without a server."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.colors import FAR_CLEARANCE, SCALE, clearance_colors, intensities
from hdplan.planner.view.drawing.motion import SAMPLES, ShownMotion, Tip, sample_parameters
from hdplan.planner.view.drawing.plot import with_bar
from hdplan.planner.view.drawing.plots import SHOWN, joint_table, within_sight
from hdplan.planner.view.drawing.reaching import follow_tip
from hdplan.planner.view.drawing.timeline import PATH_DURATION, Timeline
from hdplan.planner.view.things import moved
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses
from hdplan.scenes.poses import Pose
from hdplan.scenes.shapes import Sphere
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import load_scene


@pytest.fixture(scope="module")
def certifier() -> Certifier:
    scene = load_scene("panda_cage")
    return Certifier(Setup.of(scene))


@pytest.fixture(scope="module")
def robot(certifier: Certifier) -> Robot:
    return certifier.robot


@pytest.mark.parametrize("waypoints", [2, 3, 32, 101, 150, 1000])
def test_waypoints_are_among_the_samples(waypoints: int) -> None:
    parameter = sample_parameters(waypoints)
    assert SAMPLES <= len(parameter) <= 2 * SAMPLES
    np.testing.assert_allclose(np.diff(parameter), 1 / (len(parameter) - 1), rtol=0, atol=1e-12)
    if waypoints <= 2 * SAMPLES:
        assert set(np.linspace(0, 1, waypoints).round(9)) <= set(parameter.round(9))


def test_a_motion_is_sampled_as_the_trajectory_and_the_certificate_have_it(certifier: Certifier) -> None:
    query = certifier.setup.query
    line = np.linspace(query.start, query.goal, 5)
    names = certifier.robot.joint_names[::-1]  # found by name, in any order
    motion = ShownMotion.of("line", Trajectory(names, line[:, ::-1]), certifier)
    np.testing.assert_allclose(motion.joints, motion.trajectory.at(motion.parameter)[:, ::-1], rtol=0, atol=1e-12)
    joints = [np.interp(motion.parameter, np.linspace(0, 1, 5), column) for column in line.T]
    np.testing.assert_allclose(np.transpose(joints), motion.joints, rtol=0, atol=1e-12)
    for k in (0, 30, len(motion.parameter) - 1):
        to_obstacle, between_links = certifier.nearest(motion.joints[k])
        assert to_obstacle is not None
        assert between_links is not None
        assert (motion.clearance[k], motion.self_clearance[k]) == (to_obstacle.distance, between_links.distance)
        tip = Tip.of(certifier.robot).placement(motion.joints[k]).translation
        np.testing.assert_allclose(motion.tip[k], tip, rtol=0, atol=1e-12)
    assert not motion.certificate.certified  # the straight line hits a bar
    assert motion.clearance.min() <= 0.0


def test_each_motion_is_where_it_is_at_that_second_and_waits_before_and_after() -> None:
    scene, rows = load_scene("empty"), np.array([[0.0], [2.0], [3.0]])
    early = Curve.through(rows, np.array([1.0, 2.0, 4.0]), np.ones((3, 1)))
    late, path = Curve.through(rows, np.array([2.0, 3.0, 7.0])), Curve.through(rows)
    timeline = Timeline.of(scene, [early, path, late])
    assert (timeline.begin, timeline.end, timeline.duration, timeline.timed) == (1.0, 7.0, 6.0, True)
    for now, at_early, at_late, at_path in ((1.0, 0.0, 0.0, 0.0), (2.0, 2.0, 0.0, 2 / 3), (7.0, 3.0, 3.0, 3.0)):
        found = [float(curve.at_parameter(timeline.parameter(curve, now))[0]) for curve in (early, late, path)]
        assert found == pytest.approx([at_early, at_late, at_path])
    for curve in (early, late, path):
        for parameter in (0.0, 0.3, 1.0):
            assert timeline.parameter(curve, float(timeline.moments(curve, parameter))) == pytest.approx(parameter)
    alone = Timeline.of(scene, [path])
    assert (alone.begin, alone.end, alone.duration, alone.words(0.3)) == (0.0, 1.0, PATH_DURATION, "0.300")
    ball = Obstacle("ball", Sphere(0.1), motion=SteadyMotion((0.1, 0.0, 0.0)))
    moving = replace(scene, obstacles=(ball,), timing=Timing(duration=2.5))
    assert Timeline.of(moving, []) == Timeline(0.0, 2.5, True)


def test_a_moving_obstacle_that_is_dragged_keeps_its_motion() -> None:
    rng = np.random.default_rng(2)
    motions = (
        SteadyMotion((0.1, -0.2, 0.0), (0.3, 0.0, 1.0)),
        TimedPoses((0.5, 1.0, 3.0), tuple(turned(rng) for _ in range(3))),
    )
    for motion in motions:
        pose = turned(rng) if isinstance(motion, SteadyMotion) else motion.poses[0]
        before = Obstacle("a", Sphere(0.1), pose, motion=motion)
        aim = turned(rng)
        old, new = ObstacleMotion.of(before), ObstacleMotion.of(moved(before, aim))
        np.testing.assert_allclose(new.at(np.zeros(1))[0], aim.matrix, atol=1e-12)
        np.testing.assert_allclose(new.velocity, old.velocity, atol=1e-12)
        np.testing.assert_allclose(new.spin, old.spin, atol=1e-12)
        np.testing.assert_array_equal(new.begins, old.begins)


def turned(rng: np.random.Generator) -> Pose:
    quaternion = rng.normal(size=4)
    return Pose(tuple(rng.normal(size=3).tolist()), tuple((quaternion / np.linalg.norm(quaternion)).tolist()))


def test_the_tip_is_between_the_fingers(robot: Robot) -> None:
    tip = Tip.of(robot)
    data = robot.model.createData()
    q = robot.draw(np.random.default_rng(0), 1)[0]
    pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
    hand = data.oMf[robot.model.getFrameId("panda_hand")]
    np.testing.assert_allclose(hand.actInv(tip.placement(q).translation), [0, 0, 0.11], atol=0.015)


@pytest.mark.core
def test_inverse_kinematics_reaches_what_is_near(robot: Robot) -> None:
    tip, rng = Tip.of(robot), np.random.default_rng(5)
    for q in robot.draw(rng, 10):
        near = np.clip(q + rng.normal(scale=0.1, size=robot.n), robot.lower, robot.upper)
        found, off = follow_tip(tip, [q], tip.placement(near))
        assert (found >= robot.lower).all()
        assert (found <= robot.upper).all()
        error = tip.placement(found).actInv(tip.placement(near))
        assert off == pytest.approx(float(np.linalg.norm(error.translation)), abs=1e-9)
        if off < 1e-3:
            assert pin.rpy.matrixToRpy(error.rotation) == pytest.approx([0, 0, 0], abs=0.02)
    assert off < 1e-3


def test_inverse_kinematics_says_how_much_it_falls_short(robot: Robot) -> None:
    tip = Tip.of(robot)
    q = Setup.of(load_scene("panda_cage"), robot).query.start
    far = tip.placement(q)
    far.translation = np.array([3.0, 0.0, 0.5])
    found, off = follow_tip(tip, [q], far)
    assert off == pytest.approx(np.linalg.norm(tip.placement(found).translation - far.translation), abs=1e-9)
    assert off > 1.5


def test_the_bar_rises_where_the_slider_stands_and_bends_no_curve() -> None:
    times, curve = np.linspace(0, 1, 11), np.linspace(0, 1, 11) ** 2
    for now in (0.0, 0.25, 0.3, 1.0):
        shown, bent, bar = with_bar(times, [curve], now, -1.0, 2.0)
        assert (np.diff(shown) >= 0).all()
        np.testing.assert_allclose(bent, np.interp(shown, times, curve), rtol=0, atol=1e-15)
        assert shown[bar > -1.0].tolist() == [now]


def test_clearance_colours_run_from_contact_to_far() -> None:
    colors = clearance_colors([-0.1, 0.0, FAR_CLEARANCE, 9.0, np.inf])
    assert (colors[:2] == SCALE[0]).all()
    assert (colors[2:] == SCALE[-1]).all()


def test_a_browser_draws_the_colours_that_the_legend_shows() -> None:
    given = np.arange(256, dtype=np.uint8)
    drawn = intensities(given) / 255.0  # and the browser encodes them for the screen
    shown = 255.0 * np.where(drawn <= 0.0031308, 12.92 * drawn, 1.055 * drawn ** (1 / 2.4) - 0.055)
    assert np.abs(shown - given)[given > 60].max() < 3.0
    assert np.abs(shown - given).max() < 14.0  # the darkest have few steps


def test_the_clearance_plot_shows_nothing_where_there_is_nothing_to_be_clear_of() -> None:
    shown = within_sight(np.array([-0.01, 0.05, 2.0, np.inf]))
    np.testing.assert_array_equal(shown, [-0.01, 0.05, SHOWN, np.nan])


def test_the_joint_table_holds_any_name() -> None:
    table = joint_table(["<b>", "free"], np.array([0.5, 9.0]), np.array([0.0, -np.inf]), np.array([1.0, np.inf]))
    assert "&lt;b&gt;" in table
    assert "+0.500" in table
    assert "turns freely" in table
