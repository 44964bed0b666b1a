"""A robot that follows a trajectory: it arrives where nothing is in the way, gives way to obstacles, and continues."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan import InputError, Limits, Obstacle, Pose, Robot, Scene, Sphere, SteadyMotion, Timing, Trajectory
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.control import follow as following
from hdplan.planner.control.braking import Rates
from hdplan.planner.control.follow import ARRIVED_ERROR, Followed, follow, follow_settings
from hdplan.planner.control.look_ahead import Mode
from hdplan.planner.control.pacing import SPEED_SHARE, paced, slowed, slowness
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.yaml_format.writer import scene_text
from tests.commands import in_process

from .rooms import READY, scene_of

COARSE = replace(follow_settings(), period=0.01)  # half as many steps; `test_command` has the settings of all


@pytest.fixture(scope="module")
def sweep(robot: Robot) -> Trajectory:
    """The base turns by a quarter, the arm stretched out."""
    rows = np.zeros((20, 7)) + [0.0, 0.3, 0.0, -1.6, 0.0, 1.9, 0.8]
    rows[:, 0] = np.linspace(-0.8, 0.8, 20)
    return Trajectory(robot.joint_names, rows, robot.locked)


@pytest.fixture(scope="module")
def room(sweep: Trajectory) -> Scene:
    return between(scene_of(), sweep)


@pytest.fixture(scope="module")
def free(room: Scene, sweep: Trajectory, robot: Robot) -> Followed:
    """The sweep as it is followed in the empty room."""
    return follow(Setup.of(room, robot), sweep, COARSE)


def between(scene: Scene, motion: Trajectory) -> Scene:
    """The scene with the motion's own ends."""
    start, goal = (tuple(motion.positions[row].tolist()) for row in (0, -1))
    return replace(scene, start=JointTarget("start", start), goal=JointTarget("goal", goal))


def ball_that_comes(robot: Robot, sweep: Trajectory, velocity: tuple[float, float, float], when: float) -> Obstacle:
    """A ball that crosses the hand's place halfway along the trajectory at a given time."""
    q = sweep.positions[len(sweep) // 2]
    hand = kinematics_of(robot).evaluate(q).translations[0, 7]
    start = hand - when * np.array(velocity)
    return Obstacle("ball", Sphere(0.07), Pose(tuple(start.tolist())), motion=SteadyMotion(velocity))


def test_a_free_robot_arrives_about_on_time(free: Followed, robot: Robot, sweep: Trajectory) -> None:
    assert free.succeeded
    assert free.arrived is not None
    assert free.duration - 0.5 <= free.arrived < free.duration + 1.5
    assert np.abs(free.trajectory.positions[-1] - sweep.positions[-1]).max() <= ARRIVED_ERROR
    assert set(free.run.modes) == {Mode.MOVING}
    assert np.abs(free.run.velocities).max() <= robot.model.velocityLimit.max()


def test_times_of_the_file_are_kept_to(room: Scene, robot: Robot, sweep: Trajectory) -> None:
    slow = replace(sweep, times=np.linspace(1.0, 7.0, len(sweep)))
    found = follow(Setup.of(room, robot), slow, COARSE)
    assert found.duration == pytest.approx(6.0)
    assert found.arrived is not None
    assert 5.5 <= found.arrived < 7.5
    assert found.held == 0.0
    assert found.run.met is not None
    middle = found.trajectory.curve.at_parameter(found.trajectory.curve.parameter_of(4.0))  # of the file
    np.testing.assert_allclose(middle, sweep.at(0.5), atol=0.15)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("velocity", [(-0.25, 0.0, 0.0), (0.0, -0.25, 0.0)], ids=str)
def test_the_follower_yields_and_recovers(
    velocity: tuple[float, float, float], free: Followed, room: Scene, robot: Robot, sweep: Trajectory
) -> None:
    assert free.arrived is not None
    obstacle = ball_that_comes(robot, sweep, velocity, 0.5 * free.arrived)
    scene = replace(room, obstacles=(obstacle,))
    found = follow(Setup.of(scene, robot), sweep, COARSE)
    assert found.succeeded, found.certificate.text
    assert found.arrived is not None
    assert found.arrived > free.arrived
    assert found.held > free.held
    # without the filter the same motion, as it was executed in the empty room, runs into the ball
    assert not Certifier(Setup.of(scene, robot)).certify(free.trajectory, check_ends=False).certified


def test_a_program_without_a_solution_is_no_reason_to_stand(room: Scene, robot: Robot) -> None:
    """A ball approaches the elbow faster than its barrier allows: the step that gives way names the ball."""
    slow = Trajectory(robot.joint_names, np.stack([READY, READY + 0.15]), robot.locked, np.array([0.0, 3.0]))
    ball = Obstacle("ball", Sphere(0.08), Pose((-0.282, 0.096, 0.763)), motion=SteadyMotion((0.491, -0.08, -0.054)))
    found = follow(Setup.of(replace(between(room, slow), obstacles=(ball,)), robot), slow, COARSE)
    assert found.succeeded, found.certificate.text
    assert found.run.counted[Mode.GIVING_WAY]
    assert Mode.STOPPED not in found.run.counted
    assert {name for _, name in found.run.gave} == {"ball"}


def test_a_way_that_stays_blocked_is_given_up(
    monkeypatch: pytest.MonkeyPatch, room: Scene, robot: Robot, sweep: Trajectory
) -> None:
    monkeypatch.setattr(following, "PATIENCE", (3.0, 2.0))
    obstacle = replace(ball_that_comes(robot, sweep, (0.0, 0.0, 0.0), 0.0), motion=None, shape=Sphere(0.3))
    scene = replace(room, obstacles=(obstacle,))
    found = follow(Setup.of(scene, robot), replace(sweep, times=np.linspace(0.0, 0.5, len(sweep))), COARSE)
    assert not found.succeeded
    assert found.arrived is None
    assert found.certificate.status is Status.WRONG_ENDS
    assert not found.certificate.failures
    assert "not arrived" in found.text


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(2))
def test_check_reports_of_the_written_motion_what_follow_reported(
    seed: int, tmp_path: Path, room: Scene, robot: Robot
) -> None:
    """Random motions and obstacles that come, with limits on velocities and accelerations; nothing jumps."""
    rng = np.random.default_rng(seed)
    rows = READY + np.cumsum(rng.uniform(-0.15, 0.15, (4, 7)), axis=0)
    motion = Trajectory(robot.joint_names, rows, robot.locked, np.linspace(0.0, 1.5, 4) if seed else None)
    ball = ball_that_comes(robot, motion, tuple(rng.uniform(-0.5, 0.5, 3).tolist()), 0.7)
    limits = Limits(velocity="urdf", acceleration=rng.choice([3.0, 300.0]).item())
    scene = replace(between(room, motion), obstacles=(ball,), limits=limits, timing=Timing(duration=1.5))
    (tmp_path / "scene.yaml").write_text(scene_text(scene), encoding="utf-8")
    scene = hdplan.load_scene(tmp_path / "scene.yaml")
    found = follow(Setup.of(scene, load_scene_robot(scene)), motion, COARSE)
    use = {use.quantity: use for use in found.certificate.uses}
    assert 0.0 < use["acceleration"].share < np.inf
    assert use["velocity"].share <= 1.0 + 1e-9
    assert np.abs(found.trajectory.positions[-1] - motion.positions[-1]).max() < 1e-2 or found.arrived is None
    for ending in (".json", ".csv", ".npz"):
        found.trajectory.save(tmp_path / f"done{ending}")
        again = hdplan.certify(scene, Trajectory.load(tmp_path / f"done{ending}"))
        assert (again.status, again.text) == (found.certificate.status, found.certificate.text)


def test_the_executed_motion_follows_the_commands(free: Followed) -> None:
    """The motion is within the hull of four commanded places, no faster, a spline to the second derivative."""
    curve, places, period = free.trajectory.curve, free.run.positions, free.run.period
    np.testing.assert_array_equal(curve.rows[[0, -1]], places[[0, -1]])
    padded = np.concatenate([places[:1], places[:1], places, places[-1:], places[-1:]])
    times = np.linspace(0.0, 1.0, 9)
    for k in range(0, len(curve) - 1, 37):
        part = curve.at(np.full(9, k), times)
        hull = padded[k : k + 4]
        assert (part >= hull.min(axis=0) - 1e-12).all()
        assert (part <= hull.max(axis=0) + 1e-12).all()
    speeds, fastest = curve.over_time(1), np.abs(free.run.velocities).max(axis=0)
    assert (speeds.largest() <= fastest * (1 + 1e-6) + 1e-9).all()
    assert curve.over_time(1).jumps().max() < 1e-9
    assert curve.over_time(2).jumps().max() < 1e-6
    steps = np.abs(np.diff(free.run.velocities, axis=0, prepend=0.0, append=0.0)).max(axis=0) / period
    assert (curve.over_time(2).largest() <= steps + 1e-6).all()


def test_a_paced_path_keeps_to_the_speeds(sweep: Trajectory, robot: Robot) -> None:
    velocity = np.array(robot.model.velocityLimit)
    rates = Rates.of({"velocity": velocity, "acceleration": 100.0 * velocity}, 0.005, 0.2, np.full(7, 4.0))
    fastest, curve = SPEED_SHARE * velocity, paced(sweep.curve, rates)
    assert curve.times is not None
    times = np.linspace(*curve.times[[0, -1]], 2000)
    speeds = np.abs(np.diff(curve.at_parameter(curve.parameter_of(times)), axis=0)) / np.diff(times)[:, None]
    assert (speeds <= fastest * 1.02).all()
    assert speeds[0].max() < 0.5 * speeds.max()


@pytest.mark.sampled(7)
@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("jerk", [40.0, 88.0, 500.0])
@pytest.mark.parametrize("acceleration", [2.0, 5.0, 15.0])
def test_the_follower_arrives_without_overshoot_within_any_limits(
    acceleration: float, jerk: float, timed: bool
) -> None:
    """Random motions, without times or much faster than the limits allow: no joint passes its goal or its limits, and
    what waits for no obstacle stays by the motion."""
    rng = np.random.default_rng(int(acceleration + jerk))
    limits = Limits(velocity=3.0, acceleration=acceleration, jerk=jerk)
    scene = replace(hdplan.load_scene("planar_arm"), obstacles=(), limits=limits)
    robot = load_scene_robot(scene)
    side = rng.choice([-1.0, 1.0], 2)
    share = np.linspace(0.0, 1.0, 32)[:, None]
    rows = side * rng.uniform(0.3, 1.2, 2) * share ** rng.uniform(1.0, 1.5, 2)
    motion = Trajectory(robot.joint_names, rows, {}, np.linspace(0.0, 0.4, 32) if timed else None)
    found = follow(Setup.of(between(scene, motion), robot), motion, replace(follow_settings(), period=0.01))
    assert found.arrived is not None
    assert (found.slowed > 1.5) == timed
    assert found.away < 0.15
    assert (side * (found.run.positions - rows[-1])).max() < (side * (rows - rows[-1])).max() + ARRIVED_ERROR
    settling = found.run.positions[found.run.times >= found.arrived]
    assert np.abs(settling - rows[-1]).max() <= ARRIVED_ERROR
    uses = {use.quantity: use.share for use in found.certificate.uses}
    assert max(uses[name] for name in ("velocity", "acceleration", "jerk")) <= 1.0 + 1e-9


def test_a_motion_that_is_slowed_asks_for_what_it_may(robot: Robot) -> None:
    """The motion knows positions, velocities too, or accelerations too."""
    rng, times = np.random.default_rng(3), np.linspace(0.0, 0.8, 9)
    rows, most = rng.uniform(-1.0, 1.0, (3, 9, 2)), np.full(2, 2.0)
    rates = Rates(most, most, most, 0.005)
    for known in (1, 2, 3):
        motion = Curve.through(rows[0], times, *rows[1:known])
        longer = slowness(motion, rates)
        assert slowness(slowed(motion, longer), rates) == pytest.approx(1.0)
        np.testing.assert_allclose(slowed(motion, 3.0).at_time(1.3), motion.at_time(1.3 / 3.0), atol=1e-12)
        for order in range(1, known + 1):
            assert slowed(motion, longer).over_time(order).largest().max() <= 2.0 + 1e-9


def test_a_joint_without_a_speed_limit_is_refused(stick_scene, tmp_path: Path) -> None:
    scene = stick_scene(Obstacle("ball", Sphere(0.05), Pose((0.0, 0.0, 2.0))))
    urdf = tmp_path / "stick.urdf"
    urdf.write_text(urdf.read_text().replace('velocity="1.0"', 'velocity="0"'))
    with pytest.raises(InputError, match=r"limits\.velocity"):
        follow(Setup.of(scene), Trajectory(("turn",), np.array([[0.0], [0.5]])))


def test_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, room: Scene, robot: Robot,
    sweep: Trajectory, free: Followed,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    motion = replace(sweep, positions=sweep.positions[:8])
    ball = ball_that_comes(robot, motion, (-0.3, 0.0, 0.0), 1.0)
    scene = replace(between(room, motion), obstacles=(ball,), timing=Timing(duration=2.0))
    (tmp_path / "scene.yaml").write_text(scene_text(scene), encoding="utf-8")
    motion.save(tmp_path / "plan.json")
    run = in_process(monkeypatch, capsys)
    code, out, err = run("follow", "scene.yaml", "plan.json", "-o", "done.json")
    assert (code, err) == (0, "")
    assert out.startswith("arrived after")
    assert "certified" in out
    executed = Trajectory.load("done.json")
    assert executed.times is not None
    assert run("check", "scene.yaml", "done.json")[0] == 0
    with monkeypatch.context() as patched:  # what is printed of a motion that is followed already
        patched.setattr("hdplan.planner.commands.follow.follow", lambda *_: free)
        code, out, err = run("follow", "scene.yaml", "plan.json", "--json")
    assert (code, json.loads(out)["status"]) == (0, "certified")
    code, out, err = run("follow", "scene.yaml", "missing.json")
    assert (code, out, err.count("\n")) == (2, "", 1)
    code, out, err = run("follow", "scene.yaml", "plan.json", "-o", "done.txt")
    assert (code, out, err.count("\n")) == (2, "", 1)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        (["--rate", "0"], "--rate: must be"),
        (["--margin", "-1"], "--margin: -1 m"),
        (["--limits", "jerk=-1"], "--limits jerk=-1: must be"),
    ],
)
def test_a_wrong_value_is_reported_with_its_option(
    given: list[str], named: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = in_process(monkeypatch, capsys)("follow", "panda_gate", "plan.json", *given)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert named in err
