"""Laws of the robot and the motion that a scene takes: its own ends, limits and names, and no robot within more."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from hdplan import InputError, Limits, Pose, RobotSpec, Scene, SelfCollision, Trajectory, build, load_robot, load_scene
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.control.controller import Controller
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup


def test_ends_limits_and_names() -> None:
    spec = RobotSpec(name="panda", locked={"panda_finger_joint1": 0.03})
    robot = load_robot(spec)
    start, goal = np.array([0, -0.7, 0, -2.3, 0, 1.5, 0.7]), np.array([0.5, -0.5, 0, -2.0, 0, 1.6, 0.7])
    scene = Scene(robot=spec, start=start, goal=goal)
    line = np.linspace(start, goal, 5)
    assert certify(scene, Trajectory(robot.joint_names, line)).certified

    back = certify(scene, Trajectory(robot.joint_names, line[::-1]))
    assert back.status is Status.WRONG_ENDS
    assert "first waypoint has joint" in back.text
    assert certify(scene, Trajectory(robot.joint_names, line[::-1]), check_ends=False).certified

    beyond = line.copy()
    beyond[2, 3] = robot.upper[3] + 1e-6
    found = certify(scene, Trajectory(robot.joint_names, beyond))
    assert found.status is Status.OUTSIDE_LIMITS
    assert "waypoint 2 has joint 'panda_joint4'" in found.text

    names = robot.joint_names[::-1] + ("panda_finger_joint1",)
    columns = np.c_[line[:, ::-1], np.full(5, 0.03)]
    assert certify(scene, Trajectory(names, columns)).certified
    with pytest.raises(InputError, match=r"the scene holds it at 0\.03"):
        certify(scene, Trajectory(names, columns + 0.01))
    with pytest.raises(InputError, match="joint 'panda_joint7' of panda is missing"):
        certify(scene, Trajectory(robot.joint_names[:6], line[:, :6]))
    with pytest.raises(InputError, match="did you mean 'panda_joint1'"):
        certify(scene, Trajectory((*robot.joint_names, "panda_joint11"), np.c_[line, line[:, 0]]))
    with pytest.raises(InputError, match=r"the scene holds it at 0\.03"):
        certify(scene, Trajectory(robot.joint_names, line, {"panda_finger_joint1": 0.0}))


def test_a_robot_whose_links_are_not_checked_certifies_no_scene_in_which_they_are() -> None:
    scene = load_scene("panda_fold")
    blind = dataclasses.replace(scene, self_collision=SelfCollision(checked=False))
    assert Certifier(Setup.of(blind)).sweep.pairs.group.max(initial=0) == 0
    with pytest.raises(InputError, match="are not checked against each other, the scene's are"):
        Certifier(Setup.of(scene, load_scene_robot(blind)))


FINGERS = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}
ELSEWHERE: dict[str, dict[str, Any]] = {
    "its base is not where": {"base": Pose()},
    "is not held": {"locked": {"panda_finger_joint1": 0.0}},
    "are not checked against each other": {"ignore_pairs": (("panda_link0", "panda_hand"),)},
    "other joints of it are planned": {"locked": {**FINGERS, "panda_joint7": 0.785}},
    "read from other files": {"name": "ur5", "locked": {}},
}


@pytest.mark.parametrize("words", ELSEWHERE)
def test_a_robot_for_which_less_is_proven_is_not_the_scenes(words: str) -> None:
    """A proof for it would be none for the scene's; the message names the difference."""
    scene = load_scene("panda_cage")
    spec = dataclasses.replace(scene.robot, base=Pose((0.0, 0.0, 0.1)), locked=FINGERS)
    scene = dataclasses.replace(scene, robot=spec)
    Certifier(Setup.of(scene, load_robot(spec)))
    other = load_robot(dataclasses.replace(spec, **ELSEWHERE[words]))
    for made in (Setup.of, build, lambda scene, robot: Controller.of(scene, robot=robot)):
        with pytest.raises(InputError, match=f"robot: .*{words}.*; the scene's own is hdplan.build"):
            made(scene, other)


def test_a_robot_within_less_than_the_scenes_will_do_and_one_within_more_will_not() -> None:
    """Limits of position are the scene's: what the robot alone is within counts for nothing."""
    scene = load_scene("panda_cage")
    narrow = dataclasses.replace(scene, limits=Limits(position={"panda_joint2": (-0.5, 0.5)}))
    assert Setup.of(scene, load_scene_robot(narrow)).robot.upper[1] == 0.5
    for made in (Setup.of, build, lambda scene, robot: Controller.of(scene, robot=robot)):
        with pytest.raises(InputError, match="its joint 'panda_joint2' may go beyond the limits of the scene's"):
            made(narrow, load_robot(scene.robot))
