"""A mobile base under a robot as planned joints, and joints without limits that go the short way round."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan import InputError, Limits, Pose, RobotSpec, Scene, Trajectory, certify, load_robot, load_scene, plan
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.robot.setup import Setup

from ..urdf import joint_text, link_text, robot_text

BASE = hdplan.PlanarBase(x=(-2.0, 2.0), y=(-1.0, 1.0), yaw=(-3.0, 3.0))
STANDING = Pose.from_rpy((0.3, -0.2, 0.1), (0.0, 0.0, 0.5))


def test_the_base_slides_and_turns_beneath_the_arm() -> None:
    """Every link is where the arm alone has it, moved by T(x, y) Rz(yaw) in the frame in which the base stands."""
    alone = load_robot(RobotSpec(name="ur5", base=STANDING))
    mobile = load_robot(RobotSpec(name="ur5", base=STANDING, base_joints=BASE))
    assert mobile.joint_names == ("base_x", "base_y", "base_yaw", *alone.joint_names)
    np.testing.assert_array_equal(mobile.lower[:3], [-2.0, -1.0, -3.0])
    np.testing.assert_array_equal(mobile.upper[:3], [2.0, 1.0, 3.0])
    assert set(alone.self_pairs) <= set(mobile.self_pairs)
    rng = np.random.default_rng(0)
    for q in mobile.draw(rng, 20):
        x, y, yaw = q[:3]
        moved = STANDING.matrix @ Pose.from_rpy((x, y, 0.0), (0.0, 0.0, yaw)).matrix @ np.linalg.inv(STANDING.matrix)
        one, other = alone.model.createData(), mobile.model.createData()
        pin.framesForwardKinematics(alone.model, one, alone.pin_q(q[3:]))
        pin.framesForwardKinematics(mobile.model, other, mobile.pin_q(q))
        for link in alone.links:
            expected = moved @ one.oMf[alone.model.getFrameId(link, pin.FrameType.BODY)].homogeneous
            found = other.oMf[mobile.model.getFrameId(link, pin.FrameType.BODY)].homogeneous
            np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_joints_of_a_group_and_the_base_are_planned() -> None:
    spec = RobotSpec(name="panda", base_joints=BASE)
    assert load_robot(spec).joint_names[:4] == ("base_x", "base_y", "base_yaw", "panda_joint1")
    few = load_robot(replace(spec, group=("panda_joint2",), locked={"base_y": 0.5}))
    assert few.joint_names == ("base_x", "base_yaw", "panda_joint2")
    assert few.locked["base_y"] == 0.5


WALL = hdplan.Obstacle("wall", hdplan.Box((0.2, 1.0, 1.0)), Pose((1.0, 0.0, 0.5)))


def test_a_base_drives_round_a_wall_and_the_arm_counts(tmp_path: Path) -> None:
    spec = RobotSpec(name="panda", base_joints=hdplan.PlanarBase(x=(-0.5, 2.5), y=(-2.0, 2.0), yaw=(-3.2, 3.2)))
    ready = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
    scene = Scene(robot=spec, obstacles=[WALL], start=[0.0, 0.0, 0.0, *ready], goal=[2.0, 0.0, 0.0, *ready])
    straight = Trajectory(load_robot(spec).joint_names, np.array([[x, 0.0, 0.0, *ready] for x in (0.0, 2.0)]))
    assert certify(scene, straight).status is Status.IN_CONTACT
    result = plan(scene)
    assert result.certified, result.certificate.text
    scene.save(tmp_path / "wall.yaml")
    assert load_scene(tmp_path / "wall.yaml") == scene
    assert certify(load_scene(tmp_path / "wall.yaml"), result.trajectory).certified


def test_invalid_bases_are_refused(tmp_path: Path) -> None:
    scene = Scene(robot=RobotSpec(name="ur5", base_joints=BASE), start=[0.0] * 9, goal=[0.1] * 9)
    scene.save(tmp_path / "base.yaml")
    text = (tmp_path / "base.yaml").read_text()
    for old, new, message in (
        ("[-1.0, 1.0]", "[1.0, -1.0]", r"robot\.base_joints\.y: must be a range from low to high"),
        ("[-1.0, 1.0]", "[1.0]", r"robot\.base_joints\.y: must be a list of 2"),
        ('"yaw"', '"yow"', r"robot\.base_joints: unknown key 'yow' \(did you mean 'yaw'\?\)"),
        (', "yaw": [-3.0, 3.0]', "", r"robot\.base_joints: the key 'yaw' is missing"),
        ('"kind": "planar"', '"kind": "round"', r"robot\.base_joints\.kind: unknown value 'round'"),
    ):
        changed = text.replace(old, new) if old in text else text.replace(old.replace('"', ""), new.replace('"', ""))
        assert changed != text
        (tmp_path / "base.yaml").write_text(changed)
        with pytest.raises(InputError, match=rf"base\.yaml: {message}"):
            load_scene(tmp_path / "base.yaml")
    (tmp_path / "own.urdf").write_text(ROUND.replace("turn", "base_yaw"))
    with pytest.raises(InputError, match=r"robot\.base_joints: the description has a 'base_yaw' of its own"):
        load_robot(RobotSpec(urdf=tmp_path / "own.urdf", base_joints=BASE))
    with pytest.raises(InputError, match=r"limits\.velocity: .*joint 'base_x' no limit"):
        _ = Setup.of(replace(scene, limits=Limits(velocity="urdf"))).limits


# --- joints without limits ----------------------------------------------------------------------------------------


ROUND = robot_text(
    link_text("base", sphere=0.05),
    link_text("arm", box="0.4 0.05 0.05", at="0.5 0 0"),
    joint_text("turn", "base", "arm", kind="continuous"),
)


@pytest.fixture
def spec(tmp_path: Path) -> RobotSpec:
    (tmp_path / "round.urdf").write_text(ROUND)
    return RobotSpec(urdf=tmp_path / "round.urdf")


def test_joints_without_limits_go_the_short_way_round(spec: RobotSpec) -> None:
    """They turn at most by half a turn from any start to any goal; a note gives a value that is not the scene's."""
    rng = np.random.default_rng(2)
    for start, goal in rng.uniform(-20.0, 20.0, (200, 2)).tolist():
        setup = Setup.of(Scene(robot=spec, start=[start], goal=[goal]))
        reached = float(setup.query.goal[0])
        assert abs(reached - start) <= math.pi + 1e-9
        assert math.remainder(reached - goal, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
        assert (setup.turned == ()) is (reached == goal)


def test_a_motion_the_short_way_is_certified_and_named(spec: RobotSpec) -> None:
    scene = Scene(robot=spec, start=[3.0], goal=[-3.0])
    result = plan(scene)
    assert result.certified
    assert result.trajectory.positions[-1, 0] == pytest.approx(2 * math.pi - 3.0)
    assert any(note.startswith("goal: whole turns away, by the short way round: turn at 3.28") for note in result.notes)
    long = Trajectory(("turn",), np.linspace(3.0, -3.0, 20)[:, None])
    assert certify(scene, long).certified  # the goal is a place, and both ways end there


def test_a_start_counts_as_it_stands(spec: RobotSpec) -> None:
    """A motion begins at the very value, and one that begins whole turns away is not certified: a robot would jump."""
    for start in (7.0, -40.0, 0.5 + 4 * math.pi):
        scene = Scene(robot=spec, start=[start], goal=[1.0])
        result = plan(scene)
        assert result.certified
        assert result.trajectory.positions[0, 0] == start
        assert abs(result.trajectory.positions[-1, 0] - start) <= math.pi
        for turns in (-3, -1, 1, 2):
            moved = Trajectory(("turn",), result.trajectory.positions + 2 * math.pi * turns)
            certificate = certify(scene, moved)
            assert not certificate.certified
            words = f"the first waypoint has joint 'turn' at {moved.positions[0, 0]:g}, the scene's start"
            assert words in certificate.text
            again = plan(scene, guess=moved)  # which is turned back whole
            assert again.certified
            np.testing.assert_allclose(again.trajectory.positions, result.trajectory.positions, atol=1e-12)
            assert not [note for note in again.notes if "the guess's ends were moved" in note]


def test_the_long_way_is_taken_where_something_stands_in_the_short_one(spec: RobotSpec) -> None:
    ball = hdplan.Obstacle("ball", hdplan.Sphere(0.1), Pose((-0.5, 0.0, 0.0)))
    scene = Scene(robot=spec, obstacles=[ball], start=[2.5], goal=[-2.5])
    straight = Trajectory(("turn",), np.array([[2.5], [2 * math.pi - 2.5]]))
    assert not certify(scene, straight).certified
    result = plan(scene)
    assert result.certified, result.certificate.text
    assert result.trajectory.positions[-1, 0] == -2.5
    assert not any("short way" in note for note in result.notes)


def test_a_joint_that_the_scene_limits_takes_its_value_as_it_stands(spec: RobotSpec) -> None:
    scene = Scene(robot=spec, start=[2.5], goal=[-2.5], limits=Limits(position={"turn": (-4.0, 4.0)}))
    assert Setup.of(scene).query.goal[0] == -2.5
    assert plan(scene).trajectory.positions[-1, 0] == -2.5


def test_a_joint_that_slides_without_limits_is_no_circle(tmp_path: Path) -> None:
    """A metre is not the same place as a metre and 2π."""
    text = ROUND.replace("continuous", "prismatic").replace("<axis", '<limit lower="-1e6" upper="1e6"/><axis')
    (tmp_path / "slide.urdf").write_text(text.replace("/><axis", ' effort="1" velocity="1"/><axis', 1))
    spec = RobotSpec(urdf=tmp_path / "slide.urdf")
    scene = Scene(robot=spec, start=[0.0], goal=[1.0 + 2 * math.pi])
    assert Setup.of(scene).query.goal[0] == 1.0 + 2 * math.pi
    short = certify(scene, Trajectory(("turn",), np.array([[0.0], [1.0]])))
    assert not short.certified
    assert short.status is Status.WRONG_ENDS
