"""Goals of two arms: a pose for each hand, reached together, and an object that both hold."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from hdplan import InputError, Pose, Scene, Trajectory, load_scene, plan
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.certificate.pose_goals import miss_of
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.problem.smoothness import Smoothness
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import goal_choice
from hdplan.planner.search.inverse_kinematics import reaching
from hdplan.scenes.targets import AllOf, Goals, PoseTarget

from ..links import pose_of

HANDS = ("left_gripper", "right_gripper")


@pytest.fixture(scope="module")
def setup() -> Setup:
    """Give the scene in which Baxter carries a carton with both hands."""
    return Setup.of(load_scene("baxter_bimanual_carry"))


@pytest.mark.parametrize("free", ["none", "z"])
def test_one_configuration_reaches_all_poses_within_limits(setup: Setup, free: str) -> None:
    robot = setup.robot
    start = setup.robot.configuration(setup.scene.start)
    for seed, q in enumerate(robot.draw(np.random.default_rng(2), 3)):
        both = AllOf([PoseTarget(hand, pose_of(robot, hand, q), 2e-3, 0.02, free) for hand in HANDS])
        found, misses = reaching(robot, both, start, np.random.default_rng(seed))
        assert len(found)
        assert [miss.within(pose) for miss, pose in zip(misses, both.poses, strict=True)] == [True, True]
        assert np.all((found >= robot.lower) & (found <= robot.upper))
        assert all(miss_of(robot, pose, row).within(pose) for row in found for pose in both.poses)
        assert np.all(np.diff(np.linalg.norm(found - start, axis=1)) >= 0)
        again, _ = reaching(robot, both, start, np.random.default_rng(seed))
        assert again.tobytes() == found.tobytes()


def test_poses_that_cannot_be_reached_together_are_refused_by_name(setup: Setup) -> None:
    left = PoseTarget(HANDS[0], Pose((0.6, 0.2, 0.2)), free_rotation="all")
    right = PoseTarget(HANDS[1], Pose((0.6, 9.0, 0.2)), free_rotation="all")
    scene = replace(setup.scene, goal=AllOf([left, replace(right, field="goal.all[1].pose")]))
    with pytest.raises(InputError, match=r"links 'left_gripper' and 'right_gripper' cannot be brought there together"):
        goal_choice(Certifier(Setup.of(scene, setup.robot)))
    scene = replace(setup.scene, goal=AllOf([left, replace(right, link="right_griper", field="goal.all[1].pose")]))
    with pytest.raises(InputError, match=r"goal\.all\[1\]\.pose\.link: unknown link 'right_griper'"):
        goal_choice(Certifier(Setup.of(scene, setup.robot)))


def test_the_certificate_asks_for_every_pose(setup: Setup) -> None:
    scene, robot = setup.scene, setup.robot
    start = robot.configuration(scene.start)
    (both,) = scene.goal.targets if isinstance(scene.goal, Goals) else ()
    met = reaching(robot, both, start, np.random.default_rng(0))[0][0]
    for joint, field in (
        (0, r"left_gripper .* away from goal\.all\[0\]\.pose"),
        (7, r"right_gripper .*all\[1\]\.pose"),
    ):
        off = met.copy()
        off[joint] += 0.02
        found = certify(scene, Trajectory(robot.joint_names, np.array([start, off])), robot)
        assert found.status is Status.WRONG_ENDS
        assert re.search(field, found.text)
    found = certify(scene, Trajectory(robot.joint_names, np.array([start, met])), robot)
    assert found.status is not Status.WRONG_ENDS


def test_both_hands_may_touch_what_they_hold(setup: Setup) -> None:
    scene = setup.scene
    start = setup.robot.configuration(scene.start)
    assert Certifier(setup).contacts(start) == ()
    (held,) = scene.attached
    one_hand = replace(held, touch_links=tuple(link for link in held.touch_links if link.startswith("l")))
    contacts = Certifier(Setup.of(replace(scene, attached=(one_hand,)))).contacts(start)
    assert contacts
    assert all("carton" in (each.link, each.other) for each in contacts)
    assert all(each.link.startswith("r") or each.other.startswith("r") for each in contacts)


def test_a_pose_without_a_link_is_the_end_effectors(setup: Setup) -> None:
    scene = load_scene("panda_grasp")
    (target,) = scene.goal.targets if isinstance(scene.goal, Goals) else ()
    assert isinstance(target, PoseTarget)
    assert target.link == "panda_hand_tcp"
    bare = replace(scene, goal=replace(target, link=None))
    assert Setup.of(bare).scene == replace(scene, goal=replace(target, field="goal"))
    one, other = (plan(each) for each in (scene, bare))
    assert one.trajectory.positions.tobytes() == other.trajectory.positions.tobytes()
    assert certify(bare, other.trajectory).certified
    for robot, link in (("ur5", "wrist_3_link"), ("xarm7", "link_eef")):
        made = Scene(robot=robot, start=[0.0], goal=PoseTarget(pose=Pose((0.3, 0.0, 0.3))))
        goal = Setup.of(made).scene.goal
        assert isinstance(goal, Goals)
        assert [each.link for each in goal.targets if isinstance(each, PoseTarget)] == [link]
    with pytest.raises(
        InputError, match=r"goal: the key 'link' is missing, and baxter has no one end effector: no one"
    ):
        Setup.of(replace(setup.scene, goal=PoseTarget(pose=Pose())), setup.robot)


def test_nothing_between_two_ends_is_smoother_than_the_straight_line() -> None:
    """A goal whose straight line is less smooth than a certified motion therefore cannot win."""
    rng = np.random.default_rng(4)
    for waypoints in (3, 8, 32):
        smoothness = Smoothness(waypoints, 0.01)
        first, last = rng.normal(size=(2, 14))
        line = first + np.linspace(0, 1, waypoints)[:, None] * (last - first)
        least, _ = smoothness.value(line)
        for size in (1e-3, 0.1, 3.0):
            bent = line.copy()
            bent[1:-1] += size * rng.normal(size=(waypoints - 2, 14))
            assert smoothness.value(bent)[0] > least
