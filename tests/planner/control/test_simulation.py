"""The simulated robot obeys mechanics, follows what it can, and loses what it cannot."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from hdplan import Limits, Obstacle, Payload, Pose, Robot, RobotSpec, Scene, Sphere, Timing, Trajectory, load_robot
from hdplan.planner.certificate import certifier
from hdplan.planner.certificate.torque_check import check_torques
from hdplan.planner.control.computed_torque import Arm, execute
from hdplan.planner.control.simulation import Simulation, replay
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError
from hdplan.scenes.targets import JointTarget

SCENES = Path(__file__).resolve().parents[3] / "scenes" / "shipped"
UPRIGHT = Pose((0, 0, 1), (0.7071067811865476, 0, 0, 0.7071067811865476))  # the planar arm in a vertical plane
PANDA = RobotSpec(name="panda")
PLANAR = RobotSpec(urdf=SCENES / "planar_arm.urdf", srdf=SCENES / "planar_arm.srdf", base=UPRIGHT)
LOAD = Payload("panda_hand", 2.0, (0.0, 0.02, 0.1), (0.01, 0, 0, 0.01, 0, 0.005))


def _scene(robot: RobotSpec = PANDA, **changes: object) -> Scene:
    joints = JointTarget("start", state="default")
    return replace(Scene("test", Path("test.yaml"), robot, (), joints, joints), **changes)


def _motion(robot: Robot, start: Array, goal: Array, duration: float) -> Trajectory:
    """A motion from rest to rest by the law of minimum jerk, a hundred rows a second."""
    times = np.linspace(0, duration, round(100 * duration) + 1)
    s, way = times / duration, goal - start
    place = np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, way)
    speed = np.outer(30 * s**2 - 60 * s**3 + 30 * s**4, way) / duration
    push = np.outer(60 * s - 180 * s**2 + 120 * s**3, way) / duration**2
    return Trajectory(robot.joint_names, start + place, robot.locked, times, speed, push)


def _reach(robot: Robot, duration: float = 1.0) -> Trajectory:
    start = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
    return _motion(robot, start, np.array([1.5, 0.4, 0, -1.9, 0, 2.3, 0.8]), duration)


# --- mechanics -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spec", [PLANAR, PANDA], ids=["planar", "panda"])
def test_energy_is_kept_where_nothing_drives(spec: RobotSpec) -> None:
    robot = load_robot(spec)
    arm, rng = Arm(robot.model, robot), np.random.default_rng(1)
    q, v = robot.draw(rng, 1)[0], rng.normal(0, 1, robot.n)
    energy = arm.energy(q, v)
    for _ in range(1000):
        q, v = arm.moved(q, v, np.zeros(robot.n), 1e-3)
        assert arm.energy(q, v) == pytest.approx(energy, abs=1e-4)
    assert np.abs(v).max() > 1  # it did fall


def test_a_pendulum_keeps_its_time(tmp_path: Path) -> None:
    """A rod of length l about its end swings with T = 2π √(I/(m g c)), I = m l²/3, c = l/2."""
    urdf, length = tmp_path / "rod.urdf", 0.8
    urdf.write_text(
        '<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.4"/><mass value="2"/>'
        f'<inertia ixx="{2 * length**2 / 12}" iyy="{2 * length**2 / 12}" izz="1e-6" ixy="0" ixz="0" iyz="0"/>'
        '</inertial></link><joint name="swing" type="continuous"><parent link="base"/><child link="rod"/>'
        '<axis xyz="0 1 0"/></joint></robot>'
    )
    robot = load_robot(RobotSpec(urdf=urdf))
    arm, step = Arm(robot.model, robot), 1e-3
    angle = 1e-3
    period = 2 * np.pi * np.sqrt((length / 3) / (9.81 / 2))
    q, v = np.array([angle]), np.zeros(1)
    passed = []
    for k in range(round(3 * period / step)):
        before = q
        q, v = arm.moved(q, v, np.zeros(1), step)
        if before[0] < 0 <= q[0]:
            passed.append((k + before[0] / (before[0] - q[0])) * step)
    assert passed[1] - passed[0] == pytest.approx(period, rel=1e-6)
    assert np.abs(q).max() <= angle * (1 + 1e-9)


def test_torques_that_the_check_allows_track_within_a_milliradian() -> None:
    """The check by rnea and the simulation by aba are two ways through the same mechanics."""
    robot = load_robot(PANDA)
    scene = _scene(payload=LOAD, limits=Limits(torque="urdf"))
    model, motion = Setup.of(scene, robot).loaded_model, _reach(robot)
    needed = check_torques(model, robot, motion.curve, np.full(7, 1e3)).proven
    kept = execute(Arm(model, robot), motion.curve, needed)
    assert not kept.lost
    assert np.abs(kept.errors).max() < 1e-5
    assert (np.abs(kept.commanded).max(axis=0) <= needed * 1.001 + 1e-6).all()
    np.testing.assert_allclose(kept.times[-1], 1.0, atol=1e-12)
    hard = execute(Arm(model, robot), motion.curve, needed * 0.7)
    assert hard.lost
    assert len(hard.times) < len(kept.times)


@pytest.mark.parametrize("name", ["ur5", "kinova"])
def test_other_arms_are_tracked_too(name: str) -> None:
    """Kinova's joints turn without end: Pinocchio keeps them as cosine and sine."""
    robot = load_robot(RobotSpec(name=name))
    start = np.array([0.1, -1.2, 1.0, 0.3, -0.5, 3.0])
    motion = _motion(robot, start, start + [3.2, 0.5, -0.4, 1, 0.3, 0.5], 2.0)
    done = execute(Arm(robot.model, robot), motion.curve, np.full(6, 1e3))
    assert not done.lost
    assert np.abs(done.errors).max() < 1e-4


# --- the report ----------------------------------------------------------------------------------------------


def _replay(scene: Scene, motion: Trajectory) -> Simulation:
    return replay(Setup.of(scene), motion)


def test_a_load_that_the_plan_did_not_know_of_is_lost() -> None:
    robot = load_robot(PANDA)
    limits = Limits(torque="urdf")
    motion = _reach(robot, 1.4)
    known = _replay(_scene(limits=limits), motion)
    assert known.succeeded
    assert known.execution is not None
    assert max(joint.error or 0.0 for joint in known.joints) < 1e-3
    for joint in known.joints:
        assert joint.peaks["torque"].left is not None
        assert joint.peaks["torque"].left > 0
        assert (joint.error_rms or 0.0) <= (joint.error or 0.0)
    heavy = _replay(_scene(limits=limits, payload=replace(LOAD, mass=9.0)), motion)
    assert not heavy.succeeded
    assert heavy.execution is not None
    assert heavy.execution.lost
    assert "needs a torque of" in heavy.text
    assert "tracking is lost" in heavy.text
    assert "panda_joint6" in heavy.text
    worst = max(heavy.joints, key=lambda joint: joint.peaks["torque"].share or 0.0)
    assert (worst.peaks["torque"].left or 0.0) < 0


def test_without_torque_limits_there_are_no_dynamics() -> None:
    robot, duration = load_robot(PANDA), 1.25
    motion = _reach(robot, duration)
    seen = _replay(_scene(), motion)
    assert seen.succeeded
    assert seen.execution is None
    assert seen.duration == pytest.approx(duration)
    for joint, way in zip(seen.joints, np.abs(motion.positions[-1] - motion.positions[0]), strict=True):
        assert set(joint.peaks) == {"velocity", "acceleration", "jerk"}
        assert joint.error is None
        assert joint.travel == pytest.approx(way)
        peaks = (15 / 8, 10 / np.sqrt(3), 60)  # of the law of minimum jerk over a unit of way and time
        for order, (peak, found) in enumerate(zip(peaks, joint.peaks.values(), strict=True), start=1):
            assert found.value == pytest.approx(peak * way / duration**order, rel=1e-3, abs=1e-9)
            assert found.limit is None


BEYOND = {
    "velocity": Limits(velocity=2.8, acceleration=9.0, jerk=95.0),
    "acceleration": Limits(velocity=3.0, acceleration=8.5, jerk=95.0),
    "jerk": Limits(velocity=3.0, acceleration=9.0, jerk=85.0),
}


@pytest.mark.parametrize("rate", BEYOND)
def test_a_rate_beyond_its_limit_is_named(rate: str) -> None:
    motion = _reach(load_robot(PANDA))
    assert _replay(_scene(limits=Limits(velocity=3.0, acceleration=9.0, jerk=95.0)), motion).succeeded
    seen = _replay(_scene(limits=BEYOND[rate]), motion)
    assert not seen.succeeded
    assert len(seen.failures) == 1
    assert re.search(
        rf"'panda_joint1' reaches an? {rate} of [\d.]+ at .* its limit is {getattr(BEYOND[rate], rate):g}", seen.text
    )


def test_another_limit_is_shown_and_judged_as_its_check_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here on what a joint has turned from 0: the largest is at the end of the reach."""

    class Turned:
        limits = MappingProxyType({"turn": np.full(7, 0.3)})

        def values(self, quantity: str, curve: Curve, interval: Rows, fraction: Array) -> Array:
            assert quantity == "turn"
            return curve.at(interval, fraction)

    monkeypatch.setattr(certifier, "limit_checks", lambda setup: [Turned()])
    motion = _reach(load_robot(PANDA))
    seen = _replay(_scene(), motion)
    for column, joint in zip(motion.positions.T, seen.joints, strict=True):
        assert joint.peaks["turn"].value == pytest.approx(np.abs(column).max(), abs=1e-6)
        assert joint.peaks["turn"].limit == 0.3
    assert not seen.succeeded
    assert "reaches a turn of" in seen.text


def test_corners_are_infinite_accelerations() -> None:
    robot = load_robot(PANDA)
    motion = _reach(robot)
    corners = Trajectory(motion.joint_names, motion.positions[::10], motion.locked, motion.times[::10])  # type: ignore[index]
    seen = _replay(_scene(limits=Limits(velocity=3.0, acceleration=100.0)), corners)
    assert seen.joints[0].peaks["acceleration"].value == np.inf
    assert not seen.succeeded
    assert "acceleration of inf" in seen.text
    cubic = Trajectory(motion.joint_names, motion.positions, motion.locked, motion.times, motion.velocities)
    seen = _replay(_scene(limits=Limits(velocity=3.0, acceleration=100.0)), cubic)
    assert seen.succeeded
    assert seen.joints[0].peaks["jerk"].value == np.inf


def test_times_are_requested_where_they_matter() -> None:
    robot = load_robot(PANDA)
    motion = _reach(robot)
    path = Trajectory(motion.joint_names, motion.positions, motion.locked)
    seen = _replay(_scene(), path)
    assert seen.succeeded
    assert seen.duration is None
    assert seen.joints[0].peaks == {}
    for scene in (_scene(timing=Timing()), _scene(limits=Limits(torque="urdf"))):
        with pytest.raises(InputError, match="times: missing"):
            _replay(scene, path)


def test_the_picture_has_a_panel_for_each_quantity(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from hdplan.planner.pictures.plot import plot_simulation
    from hdplan.planner.pictures.simulation_sheet import simulation_sheet

    motion = _reach(load_robot(PANDA), 1.4)
    with_torques = _scene(limits=Limits(torque="urdf"), payload=LOAD)
    for scene, count in ((_scene(), 3), (with_torques, 5), (replace(with_torques, payload=replace(LOAD, mass=9.0)), 5)):
        figure = simulation_sheet(_replay(scene, motion), "reach")
        assert len(figure.axes) == count
        for axis in figure.axes:
            assert len([line for line in axis.get_lines() if len(line.get_xdata()) > 2]) == 7
    plot_simulation(_replay(_scene(), motion), "reach", tmp_path / "reach.png")
    assert (tmp_path / "reach.png").stat().st_size > 10_000
    path = Trajectory(motion.joint_names, motion.positions, motion.locked)
    with pytest.raises(InputError, match="times: missing"):
        plot_simulation(_replay(_scene(), path), "reach", tmp_path / "path.png")
    assert not (tmp_path / "path.png").exists()


def test_contacts_are_found() -> None:
    robot = load_robot(PLANAR)
    motion = _motion(robot, np.array([-0.5, 0.0]), np.array([0.5, 0.0]), 1.0)
    ball = Obstacle("ball", Sphere(0.1), Pose((0.9, -0.1, 1.0)))
    seen = _replay(_scene(PLANAR, obstacles=(ball,)), motion)
    assert not seen.succeeded
    assert "forearm and ball touch at" in seen.text
    away = _replay(_scene(PLANAR, obstacles=(replace(ball, pose=Pose((0.9, -0.3, 1.0))),)), motion)
    assert away.succeeded
    assert away.closest is not None
    assert away.closest.distance == pytest.approx(
        0.08, abs=1e-6
    )  # 0.2 off the arm's plane, radius 0.1, and half of 0.04
    assert away.summary()["closest"]["other"] == "ball"
