"""Laws of the search for configurations: in C and in NumPy it finds the same, and what it finds keeps its word."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest

from hdplan.distance.compiled.loops import library
from hdplan.planner.certificate.pose_goals import miss_of
from hdplan.planner.kinematics import inverse
from hdplan.planner.robot.robot import Robot, load_robot
from hdplan.planner.search.inverse_kinematics import APART, reaching
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.targets import AllOf, PoseTarget

ROBOTS = ("panda", "ur5", "z1", "double_pendulum_continuous")
SAME = 1e-6  # [rad] between configurations after some forty steps that each round a little differently


def pose_of(robot: Robot, link: str, q: np.ndarray) -> Pose:
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
    place = data.oMf[robot.model.getFrameId(link, pin.FrameType.BODY)]
    quaternion = np.asarray(pin.Quaternion(place.rotation).normalized().coeffs())
    return Pose(tuple(place.translation.tolist()), tuple(quaternion.tolist()))


@pytest.mark.skipif(not library(), reason="built without a C compiler")
@pytest.mark.parametrize("name", ROBOTS)
def test_without_a_compiler_the_same_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot(RobotSpec(name=name))
    rng = np.random.default_rng(11)
    link = robot.links[-1]
    for number, free in enumerate(("none", "none", "x", "y", "z", "all")):
        start, q = robot.draw(rng, 2)
        pose = pose_of(robot, link, q)
        target = PoseTarget(
            link,
            Pose(pose.position) if free == "all" else pose,
            *(1e-3, 1e-2)[: 2 - (free == "all")],
            free_rotation=free,
        )
        both = AllOf([target, PoseTarget(robot.links[-2], pose_of(robot, robot.links[-2], q), 2e-3, 2e-2)])
        for goal in (target, both):
            found, missed = reaching(robot, goal, start, np.random.default_rng(number))
            with monkeypatch.context() as patch:
                patch.setattr(inverse, "library", lambda: None)
                expected, missed_too = reaching(robot, goal, start, np.random.default_rng(number))
            assert len(found) == len(expected) > 0
            np.testing.assert_allclose(found, expected, atol=SAME, rtol=0)
            np.testing.assert_allclose(missed, missed_too, atol=SAME, rtol=0)
            assert all(miss_of(robot, each, row).within(each) for row in found for each in goal.poses)
            assert np.all((found >= robot.lower) & (found <= robot.upper))
            assert all(np.abs(a - b).max() > APART for a, b in itertools.combinations(found, 2))


@pytest.mark.parametrize("compiled", [True, False])
def test_out_of_reach_nothing_is_found_and_the_miss_is_true(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot(RobotSpec(name="ur5"))
    if not compiled:
        monkeypatch.setattr(inverse, "library", lambda: None)
    target = PoseTarget("tool0", Pose((2.0, 0.0, 0.0)))
    found, (miss,) = reaching(robot, target, np.zeros(6), np.random.default_rng(0))
    assert found.shape == (0, 6)
    assert 2.0 - 1.3 < miss.position < 2.0 + 1.3
