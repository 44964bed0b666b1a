"""Laws of joint limits: the scene's values in the robot's order, the URDF's where it gives none, narrower positions."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hdplan import InputError, Robot, RobotSpec, Scene, SelfCollision, Timing, load_scene
from hdplan.planner.robot.joint_limits import joint_limits
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.limits import QUANTITIES, JointValues, Limits

from ..urdf import joint_text, link_text, write_robot


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("panda_cage")


@pytest.fixture(scope="module")
def robot(scene: Scene) -> Robot:
    return load_scene_robot(scene)


def limited(scene: Scene, quantity: str, values: JointValues | None) -> Scene:
    return replace(scene, limits=replace(scene.limits, **{quantity: values}))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_values_are_those_of_the_scene_in_the_robots_order(scene: Scene, robot: Robot, quantity: str) -> None:
    given = np.random.default_rng(0).uniform(0.1, 5.0, robot.n)
    by_name = dict(reversed(list(zip(robot.joint_names, given.tolist(), strict=True))))
    for values, expected in ((tuple(given.tolist()), given), (by_name, given), (1.5, np.full(robot.n, 1.5))):
        found = joint_limits(limited(scene, quantity, values), robot)
        np.testing.assert_array_equal(found[quantity], expected)
    assert quantity not in joint_limits(scene, robot)


def test_the_urdf_speaks_where_the_scene_does_not(scene: Scene, robot: Robot) -> None:
    for quantity, of_urdf in (("velocity", robot.model.velocityLimit), ("torque", robot.model.effortLimit)):
        np.testing.assert_array_equal(joint_limits(limited(scene, quantity, "urdf"), robot).get(quantity), of_urdf)
        some = joint_limits(limited(scene, quantity, {"panda_joint3": 0.25}), robot).get(quantity)
        assert some is not None
        assert some[2] == 0.25
        np.testing.assert_array_equal(np.delete(some, 2), np.delete(of_urdf, 2))


def test_a_timed_motion_keeps_the_urdfs_speeds(scene: Scene, robot: Robot) -> None:
    for timed in (replace(scene, timing=Timing(duration=2.0)), limited(scene, "acceleration", 3.0)):
        np.testing.assert_array_equal(joint_limits(timed, robot).get("velocity"), robot.model.velocityLimit)
        assert joint_limits(timed, robot).get("torque") is None


@pytest.mark.parametrize(
    ("quantity", "values", "words"),
    [
        ("velocity", (1.0, 2.0), "limits.velocity: 2 values, but panda plans 7 joints: panda_joint1, "),
        ("jerk", {"panda_jiont1": 1.0}, "limits.jerk: unknown joint 'panda_jiont1' (did you mean 'panda_joint1'?)"),
        ("torque", {"panda_finger_joint1": 1.0}, "limits.torque: joint 'panda_finger_joint1' is held at 0.04, not"),
        ("acceleration", {"panda_joint1": 1.0}, "limits.acceleration: no value for joint 'panda_joint2', and a URDF"),
    ],
)
def test_limits_that_do_not_fit_the_robot_are_refused(
    scene: Scene, robot: Robot, quantity: str, values: JointValues, words: str
) -> None:
    with pytest.raises(InputError, match=re.escape(words)):
        joint_limits(limited(scene, quantity, values), robot).get(quantity)


@pytest.mark.parametrize("missing", ["", 'effort="0" velocity="0"'])
def test_a_urdf_without_limits_is_refused_where_they_are_requested(tmp_path: Path, missing: str) -> None:
    limit = f"<limit {missing}/>" if missing else ""
    turn = joint_text("turn", "base", "rim", kind="continuous").replace("</joint>", f"{limit}</joint>")
    urdf = write_robot(tmp_path / "wheel.urdf", link_text("base"), link_text("rim"), turn)
    scene = Scene(robot=RobotSpec(urdf=urdf), start=[0.0], goal=[1.0])
    robot = load_scene_robot(scene)
    for quantity in ("velocity", "torque"):
        paced = limited(scene, "velocity", 1.0)
        with pytest.raises(InputError, match=f"limits.{quantity}: the URDF gives joint 'turn' no limit"):
            joint_limits(limited(paced, quantity, "urdf"), robot)
        np.testing.assert_array_equal(joint_limits(limited(paced, quantity, {"turn": 2.0}), robot)[quantity], [2.0])


# --- positions --------------------------------------------------------------------------------------------------------


def test_positions_narrow_the_robot_and_nothing_else(scene: Scene, robot: Robot) -> None:
    narrow = replace(scene, limits=Limits(position={"panda_joint7": (-1.0, 2.0), "panda_joint1": (-2.0, 1.0)}))
    found = load_scene_robot(narrow)
    assert load_scene_robot(narrow) is found
    assert load_scene_robot(scene) is robot
    np.testing.assert_array_equal(found.lower, [-2.0, *robot.lower[1:6], -1.0])
    np.testing.assert_array_equal(found.upper, [1.0, *robot.upper[1:6], 2.0])
    assert (found.model, found.self_pairs, found.notes) == (robot.model, robot.self_pairs, robot.notes)


def test_an_end_outside_the_narrowed_positions_is_refused(scene: Scene, robot: Robot) -> None:
    goal = Setup.of(scene, robot).query.goal
    narrow = replace(scene, limits=Limits(position={"panda_joint1": (float(goal[0]) + 0.1, 2.8)}))
    with pytest.raises(InputError, match=r"joint 'panda_joint1' is .*, outside its limits \["):
        _ = Setup.of(narrow).query


@pytest.mark.parametrize(
    ("joint", "span", "words"),
    [
        ("panda_joint8", (0.0, 1.0), "unknown joint 'panda_joint8' (did you mean 'panda_joint"),
        ("panda_joint1", (-3.0, 1.0), "must be a range within the URDF's [-2.8973, 2.8973], found [-3, 1]"),
        ("panda_finger_joint1", (0.0, 0.02), "is held at 0.04, not planned"),
    ],
)
def test_positions_that_the_joint_does_not_have_are_refused(
    scene: Scene, joint: str, span: tuple[float, float], words: str
) -> None:
    narrow = replace(scene, limits=Limits(position={joint: span}))
    with pytest.raises(InputError, match=re.escape(f"limits.position.{joint}: ") + ".*" + re.escape(words)):
        load_scene_robot(narrow)


def test_links_that_are_not_checked_leave_no_pair(scene: Scene, robot: Robot) -> None:
    free = replace(scene, self_collision=SelfCollision(checked=False))
    found = load_scene_robot(free)
    assert found.self_pairs == ()
    assert found.notes == (*robot.notes, "links are not checked against each other: self_collision: false")
    assert load_scene_robot(free) is found
