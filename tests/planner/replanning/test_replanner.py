"""A replanner never holds a motion that is not proven until standstill, whatever comes and whenever it is called."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.robot.link_frame import link_poses, links_of
from hdplan.scenes.array_types import Array
from tests.planner.replanning.driving import LATENCY, LIMITS, LOOKS, PERIOD, AtOnce, Drive, limited, straight_to
from tests.threads import together

SPEED, OFF, AGE, LAG = 0.5, 0.01, 0.06, 0.004  # [m/s], [m], [s], [rad]


@pytest.mark.core
def test_it_arrives_and_each_command_is_proven_to_its_end() -> None:
    drive = Drive(limited("planar_arm"))
    assert drive.arrives(within=6.0)
    modes = [command.mode.value for command in drive.commands]
    assert "braking" not in modes
    for command in drive.commands[::3]:
        assert drive.certified(command), command
    for before, after in itertools.pairwise(drive.commands):  # until the next one comes, both say the same
        for t in (after.time, after.time + LATENCY):
            np.testing.assert_allclose(before.at(t).positions, after.at(t).positions, atol=1e-9)
            np.testing.assert_allclose(before.at(t).velocities, after.at(t).velocities, atol=1e-7)
    last = drive.commands[-1]
    np.testing.assert_allclose(last.position, [1.0, 0.4], atol=1e-6)
    assert not last.at(last.time + 100.0).velocities.any()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [1, 0])
def test_nothing_is_touched_while_the_robot_moves(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two balls run at the arm as fast as they may, in pictures that are late and not exact, and the arm lags."""
    monkeypatch.setattr("hdplan.planner.replanning.outlook.PLANNING_LIMIT", 0.05)
    rng = np.random.default_rng(seed)
    spec = dataclasses.replace(hdplan.load_scene("planar_arm").robot, tracking=hdplan.Tracking(LAG))
    scene = limited("planar_arm", robot=spec, obstacles=())
    drive, touched, moved, braked = Drive(scene), 0, 0, 0
    angles = rng.uniform(-np.pi, np.pi, 2)
    places = [np.array([1.3 * np.cos(angle), 1.3 * np.sin(angle), 0.1]) for angle in angles]
    past: list[tuple[float, list[Array]]] = [(0.0, places)]
    hand = links_of(drive.robot)[drive.robot.links[-1]]

    def look(t: float, q: Array, moves: bool) -> None:
        nonlocal touched, moved, places
        balls = [hdplan.Obstacle(f"ball{i}", hdplan.Sphere(0.06), at) for i, at in enumerate(places)]
        lagging = np.clip(q + rng.uniform(-LAG, LAG, 2), drive.robot.lower, drive.robot.upper)
        moved += moves
        if moves:
            touched += bool(hdplan.check_configuration(scene.with_obstacles(balls), drive.robot, lagging))
        aim = link_poses(drive.robot, q[None], hand)[0, :3, 3]
        aims = [aim if rng.uniform() < 0.7 else rng.uniform(-1.3, 1.3, 3) * [1, 1, 0.1] for _ in places]
        places = [straight_to(at, each, SPEED * PERIOD / LOOKS) for at, each in zip(places, aims, strict=True)]
        past.append((t + PERIOD / LOOKS, places))

    goals = itertools.cycle([[-1.0, 0.3], [1.0, 0.4]])
    while drive.now < 1.0 or (drive.now < 3.0 and not braked):
        at, seen = next((each for each in reversed(past) if each[0] <= drive.now - AGE), past[0])
        off = rng.uniform(-1.0, 1.0, (2, 3)) * OFF / np.sqrt(3)
        sizes = hdplan.Uncertainty(OFF, 0.0, SPEED)
        drive.replanner.update(
            [hdplan.Obstacle(f"ball{i}", hdplan.Sphere(0.06), seen[i] + off[i], uncertainty=sizes) for i in range(2)],
            at=at,
        )
        mode = drive.period(look).mode.value
        braked += mode == "braking"
        if mode == "arrived":
            drive.replanner.aim(next(goals))
    assert touched == 0
    assert moved > 20  # it did move,
    assert braked > 0  # and was not left alone


def test_the_rest_of_a_motion_is_proven_in_every_newer_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Exact pictures only show what the older ones allowed."""
    monkeypatch.setattr("hdplan.planner.replanning.outlook.PLANNING_LIMIT", 0.05)
    rng, drive, looked = np.random.default_rng(3), Drive(limited("planar_arm", obstacles=())), 0
    places = [np.array([1.0, -0.8, 0.1]), np.array([-0.9, 1.0, 0.1])]
    sizes, replanner = hdplan.Uncertainty(0.005, 0.0, SPEED), drive.replanner
    while drive.now < 2.0:
        ball = hdplan.Sphere(0.06)
        seen = [hdplan.Obstacle(f"ball{i}", ball, at, uncertainty=sizes) for i, at in enumerate(places)]
        replanner.update(seen, at=drive.now)
        held, grid = replanner._held, replanner._grid
        if (row := grid.after(drive.now)) < held.last:
            position, velocity, acceleration = (each[row - held.first :] for each in held.rows)
            left = replanner._picture.prove((position, velocity, acceleration), grid.time(row), grid.h, 0.0, 0.0)
            assert left.certified, left.text
            looked += 1
        drive.period()
        here, there = np.array([0.5, 0.3, 0.1]), [1.0, 1.0, 0.1]
        aims = [here if rng.uniform() < 0.6 else rng.uniform(-1, 1, 3) * there for _ in places]
        places = [straight_to(at, aim, SPEED * PERIOD) for at, aim in zip(places, aims, strict=True)]
    assert looked > 10


def test_a_late_call_finds_the_robot_standing_and_goes_on() -> None:
    drive = Drive(limited("planar_arm")).moves()
    last = drive.commands[-1]
    assert drive.certified(last)
    assert last.motion.duration is not None
    drive.now += 5.0
    late = drive.step()
    assert not late.velocity.any()
    np.testing.assert_allclose(late.position, last.at(drive.now).positions, atol=1e-9)
    assert drive.arrives(within=drive.now + 6.0)


def test_a_step_that_takes_longer_than_its_period_changes_nothing() -> None:
    now = [0.0]
    drive = Drive(limited("planar_arm"), clock=lambda: now[0])
    for k in range(10):
        drive.now = now[0] = k * PERIOD
        drive.step()
    before = drive.commands[-1]
    drive.replanner._clock = lambda: now[0] + 2 * PERIOD
    drive.now = now[0] = 10 * PERIOD
    after = drive.step()
    assert after.mode.value == "braking"
    assert "longer than its period" in after.why
    for t in np.linspace(drive.now, drive.now + 1.0, 7):
        np.testing.assert_allclose(before.at(t).positions, after.at(t).positions, atol=1e-9)


def test_pictures_that_are_from_the_future_old_or_missing_stop_the_robot() -> None:
    ball = hdplan.Obstacle("ball", hdplan.Sphere(0.1), [3.0, 0.0, 0.0], uncertainty=hdplan.Uncertainty(speed=0.5))
    drive = Drive(limited("planar_arm"))
    with pytest.raises(hdplan.InputError, match="at: must be no later than now, 0 s, found 10 s"):
        drive.replanner.update([ball], at=10.0)  # no true one would be later
    drive.replanner.update([ball], at=PERIOD)
    assert "after this step" in drive.step().why
    drive = Drive(limited("planar_arm"))
    drive.replanner.update([ball], at=0.0)
    drive.now = 6.0  # it may have come 3 m by now
    drive.step()
    drive.now += PERIOD
    assert "too close" in drive.step().why or "in contact" in drive.step().why
    drive.replanner.update(poses={}, at=6.0)
    drive.now += PERIOD
    assert "'ball' was not seen for so long" in drive.step().why
    drive.replanner.update([ball], at=6.0)
    assert drive.arrives(within=12.0)


def test_a_robot_that_is_off_its_motion_brakes_and_goes_on_from_where_it_stands() -> None:
    drive = Drive(limited("planar_arm")).moves()
    off = drive.commands[-1].position + [0.02, 0.0]
    drive.replanner.state(off, drive.commands[-1].velocity)
    command = drive.step()
    assert command.mode.value == "braking"
    assert "is 0.02 off its motion, robot.tracking.position is 0" in command.why
    drive.now += 3.0
    assert "off its motion" in drive.step().why  # it may still move
    drive.replanner.state(off, [0.0, 0.0])
    command = drive.step()
    np.testing.assert_allclose(command.position, off)
    assert not command.velocity.any()
    assert drive.arrives(within=drive.now + 6.0)


@pytest.mark.parametrize("turn", [lambda q: q % (2 * np.pi), lambda q: (q + np.pi) % (2 * np.pi) - np.pi])
def test_encoders_of_joints_without_limits_may_restart_with_each_turn(turn: Callable[[Array], Array]) -> None:
    ends = {"start": [3.0, 2.01, 3.54, 6.2, 0.81, -3.1], "goal": [3.3, 2.1, 3.5, 6.4, 0.85, -3.2]}
    drive = Drive(limited("kinova_shelf", obstacles=(), **ends))
    endless = drive.robot.endless
    seen: list[tuple[float, Array]] = []

    def look(t: float, q: Array, moves: bool) -> None:
        seen.append((t, np.where(endless, turn(q), q)))

    while drive.now < 3.0 and drive.period(look).mode.value != "arrived":
        t, q = seen[-1]
        drive.replanner.state(q, np.zeros(6), at=t)
    assert drive.commands[-1].mode.value == "arrived"
    assert "braking" not in [each.mode.value for each in drive.commands]
    np.testing.assert_allclose(drive.commands[-1].position, ends["goal"], atol=1e-6)
    drive.replanner.state(np.where(endless, turn(seen[-1][1]), seen[-1][1] + 0.02), np.full(6, 0.1), at=drive.now)
    assert "is 0.02 off its motion" in drive.step().why  # what does not turn for ever is where it says


def test_bad_input_is_refused_in_one_line_and_changes_nothing() -> None:
    scene = limited("planar_arm")
    drive = Drive(scene)
    for _ in range(8):
        drive.period()
    replanner, before = drive.replanner, drive.step()
    ball = hdplan.Obstacle("ball", hdplan.Sphere(0.1), [3.0, 0.0, 0.0])
    timed = dataclasses.replace(ball, pose=hdplan.Pose(), motion=hdplan.TimedPoses([0, 1], [[0, 0, 0], [1, 0, 0]]))
    nan = float("nan")
    for call, message in (
        (lambda: replanner.step(nan), "t: must be a finite time"),
        (lambda: replanner.step(True), "t: must be a finite time"),
        (lambda: replanner.step(0.0), "t: must be no earlier than the last step"),
        (lambda: replanner.state([0.0, nan], [0.0, 0.0]), "q: found nan"),
        (lambda: replanner.state([0.0], [0.0, 0.0]), "q: shape"),
        (lambda: replanner.state([0.0, 0.0], [0.0, 99.0]), "dq: joint '.*' is at 99, its limit is 2"),
        (lambda: replanner.state([9.0, 0.0], [0.0, 0.0]), "q: joint '.*' is at 9, its range is"),
        (lambda: replanner.update([ball], at=nan), "at: must be a finite time"),
        (lambda: replanner.update([ball, ball], at=0.3), "names must differ"),
        (lambda: replanner.update([timed], at=0.3), "poses at known times"),
        (lambda: replanner.update(poses={"bell": [0, 0, 0]}, at=0.3), "unknown obstacle 'bell'.*ball"),
        (lambda: replanner.update(poses={"ball": [0, nan, 0]}, at=0.3), "poses.ball"),
        (lambda: replanner.update(cloud=ball, at=0.3), "cloud: must be a Cloud"),
        (lambda: replanner.update(cloud="scan", at=0.3), "cloud"),
        (lambda: replanner.step(10**400), "t: must be a finite time"),
        (lambda: before.at(nan), "t: must be .* the command's, or later, found nan"),
        (lambda: before.at(["soon"]), "t: must be"),
        (lambda: replanner.aim([9.0, 0.0]), "goal"),
        (lambda: replanner.aim([[0.0, 0.0], [9.0, 0.0]]), r"goal\[1\]"),
        (lambda: hdplan.Replanner(scene, period=0.0), "period"),
        (lambda: hdplan.Replanner(hdplan.load_scene("planar_arm")), "limits.acceleration: is missing"),
        (lambda: hdplan.Replanner(dataclasses.replace(scene, timing=hdplan.Timing(2.0))), "timing.duration"),
    ):
        with pytest.raises(hdplan.InputError, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)
    after = drive.step()
    np.testing.assert_array_equal(before.position, after.position)
    assert drive.arrives(within=6.0)
    replanner.update([ball], at=drive.now)
    with pytest.raises(hdplan.InputError, match=f"at: must be no earlier than the last picture, {drive.now:g} s"):
        replanner.update([ball], at=drive.now - 0.1)
    replanner.close()
    for call in (drive.step, lambda: replanner.aim(scene.start)):
        with pytest.raises(hdplan.InputError, match="the replanner is closed: its last command stays safe"):
            call()


@pytest.mark.parametrize("name", ["ur5_ceiling", "panda_carry"])
def test_hanging_and_holding_robots_arrive(name: str) -> None:
    drive = Drive(limited(name))
    assert drive.arrives(within=6.0)
    moving = [command for command in drive.commands if command.velocity.any()]
    for command in moving[:: len(moving) // 3]:
        assert drive.certified(command), command


def test_a_cloud_stops_the_robot_and_lets_it_go_on() -> None:
    drive = Drive(limited("planar_arm", obstacles=()))
    place = np.random.default_rng(0).uniform(-0.05, 0.05, (500, 3))
    wall = hdplan.Cloud(place + [0.7, 0.35, 0.1], radius=0.01)
    while drive.now < 0.2:
        drive.period()
    drive.replanner.update(cloud=wall, at=0.15)
    drive.replanner.aim([0.4, 0.2])
    seen = [hdplan.Obstacle("cloud", wall)]
    while drive.now < 1.2:
        drive.period()
    for command in drive.commands[8::4]:
        assert drive.certified(command, seen), command
    assert drive.commands[-1].mode.value != "arrived"
    drive.replanner.update(cloud=hdplan.Cloud([[3.0, 3.0, 3.0]], radius=0.01), at=drive.now)
    assert drive.arrives(within=drive.now + 4.0)


def test_threads_may_look_measure_and_step_at_the_same_time() -> None:
    scene = limited("planar_arm")
    with hdplan.Replanner(scene, period=0.5, latency=0.0, clock=lambda: 0.0) as replanner:
        sizes = hdplan.Uncertainty(0.01, 0.0, 0.1)

        def work(index: int) -> list[hdplan.Command]:
            found = []
            for k in range(6):
                ball = hdplan.Obstacle("ball", hdplan.Sphere(0.1), [3.0 + index, 0.0, 0.0], uncertainty=sizes)
                with contextlib.suppress(hdplan.InputError):  # another one was there with a later time
                    if index % 2:
                        replanner.update([ball], at=0.001 * k)
                    else:
                        found.append(replanner.step(0.001 * k))
                        replanner.state(found[-1].position, found[-1].velocity, at=found[-1].time)
            return found

        commands = [command for found in together(work, 4) for command in found]
    assert commands
    for command in commands:
        assert np.isfinite(command.motion.positions).all()
        assert command.motion.velocities is not None
        assert not command.motion.velocities[-1].any()
    assert LIMITS.acceleration == 8.0


def test_an_executor_that_fails_costs_a_way_and_no_command() -> None:
    class Failing(AtOnce):
        def submit(self, work: Callable[..., Any], /, *args: Any, **named: Any) -> Future[Any]:
            future = Future[Any]()
            future.set_exception(ZeroDivisionError("none"))
            return future

    for executor, message in ((Failing(), "ended with ZeroDivisionError: none"), (ThreadPoolExecutor(1), "shutdown")):
        drive = Drive(limited("planar_arm"), executor=executor)
        executor.shutdown()
        drive.period()
        assert message in drive.step().why
    with pytest.raises(hdplan.InputError, match="executor: must be of the class Executor"):
        hdplan.Replanner(limited("planar_arm"), executor=5)


def test_a_robot_that_is_at_its_goal_has_arrived() -> None:
    scene = limited("planar_arm")
    drive = Drive(dataclasses.replace(scene, goal=scene.start))
    assert drive.arrives(within=1.0)
    drive.replanner.aim(scene.goal)
    drive.period()
    drive.replanner.aim(scene.start)
    assert drive.arrives(within=drive.now + 6.0)


def test_states_of_the_future_and_older_ones_move_nothing() -> None:
    drive = Drive(limited("planar_arm")).moves()
    q = drive.commands[-1].position
    with pytest.raises(hdplan.InputError, match="at: must be no later than now, "):
        drive.replanner.state(q, [0.0, 0.0], at=drive.now + 60.0)
    drive.replanner.state(q + 0.1, [0.0, 0.0], at=drive.now + PERIOD)  # the robot moves, and does not stand there
    command = drive.step()
    np.testing.assert_allclose(command.position, q, atol=0.1)
    assert command.velocity.any()
    assert "after this step" in command.why
    with pytest.raises(hdplan.InputError, match="at: must be no earlier than the last state"):
        drive.replanner.state(q, [0.0, 0.0], at=drive.now)
