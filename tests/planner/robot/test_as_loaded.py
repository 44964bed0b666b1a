"""Robots are shared: whoever changes one sees a refusal, or changes nothing."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

from hdplan import InputError, Limits, Robot, Scene, Sphere, Trajectory, load_robot
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from tests.threads import together

START, GOAL = [0.0, -1.0, 1.0, -1.0, -1.5, 0.0], [0.2, -1.0, 1.0, -1.0, -1.5, 0.0]
BALL = Sphere(0.1, name="ball", pose=[0.9, 0.9, 0.4])
SCENE = Scene(robot="ur5", start=START, goal=GOAL, obstacles=[BALL], limits=Limits(torque="urdf"))
MOTION = Trajectory(load_robot("ur5").joint_names, [START, GOAL], times=[0.0, 3.0], velocities=np.zeros((2, 6)))
FAR = np.array([1.0, 2.0, 3.0])


def frame(robot: Robot, name: str, value: Any) -> None:
    setattr(robot.model.frames[robot.model.getFrameId("tool0")], name, value)


def item(robot: Robot) -> pin.GeometryObject:
    return robot.collision.geometryObjects[3]


CHANGES: dict[str, Callable[[Robot], object]] = {
    "placement of a joint": lambda r: setattr(r.model.jointPlacements[1], "translation", FAR),
    "turn of a joint": lambda r: setattr(r.model.jointPlacements[2], "rotation", np.eye(3)),
    "axis of a joint": lambda r: r.model.joints.__setitem__(1, pin.JointModelRX()),
    "parent of a joint": lambda r: r.model.parents.__setitem__(3, 0),
    "name of a joint": lambda r: r.model.names.__setitem__(1, "x"),
    "lower limit": lambda r: r.model.lowerPositionLimit.__setitem__(0, -0.01),
    "velocity limit": lambda r: r.model.velocityLimit.__setitem__(0, 99.0),
    "torque limit": lambda r: r.model.effortLimit.__setitem__(1, 1e6),
    "mass": lambda r: setattr(r.model.inertias[2], "mass", 0.001),
    "centre of mass": lambda r: setattr(r.model.inertias[2], "lever", FAR),
    "gravity": lambda r: setattr(r.model.gravity, "linear", np.zeros(3)),
    "armature": lambda r: r.model.armature.__setitem__(0, 9.0),
    "place of a frame": lambda r: setattr(r.model.frames[r.model.getFrameId("tool0")].placement, "translation", FAR),
    "joint of a frame": lambda r: frame(r, "parentJoint", 1),
    "place of a geometry": lambda r: setattr(item(r).placement, "translation", FAR),
    "joint of a geometry": lambda r: setattr(item(r), "parentJoint", 0),
    "vertices": lambda r: item(r).geometry.vertices().__imul__(0.01),
    "geometry": lambda r: setattr(item(r), "geometry", coal.Sphere(0.001)),
    "geometry taken out": lambda r: r.collision.removeGeometryObject(item(r).name),
    "link of a joint": lambda r: r.link_joint.__setitem__("forearm_link", 0),  # type: ignore[index]
    "geometry of a link": lambda r: r.link_geometry.__setitem__("forearm_link", ()),  # type: ignore[index]
    "pairs": lambda r: r.unchecked.clear(),  # type: ignore[attr-defined]
    "held joints": lambda r: r.locked.__setitem__("x", 1.0),  # type: ignore[index]
    "array of limits": lambda r: np.asarray(r.lower.base).__setitem__(0, -99.0),
}


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", CHANGES)
def test_a_robot_that_was_changed_is_refused_and_the_next_one_is_whole(name: str) -> None:
    true = certify(SCENE, MOTION)
    robot = load_scene_robot(SCENE)
    assert load_scene_robot(SCENE) is robot
    certifier = Certifier(Setup.of(SCENE, robot))
    CHANGES[name](robot)
    for attempt in (
        lambda: certifier.certify(MOTION),
        lambda: certify(SCENE, MOTION, robot),
        lambda: certify(SCENE, MOTION, replace(robot, notes=())),
        lambda: Setup.of(SCENE, robot),
    ):
        with pytest.raises(InputError, match=r"^robot: (ur5\.\w+ was changed after|.*the scene's own is)"):
            attempt()
    again = certify(SCENE, MOTION)
    assert load_scene_robot(SCENE) is not robot
    assert (again.clearance, again.self_clearance, again.uses) == (true.clearance, true.self_clearance, true.uses)


def test_a_robot_made_from_another_one_is_not_the_scenes() -> None:
    robot = load_scene_robot(SCENE)
    model = robot.model.copy()
    model.jointPlacements[1].translation = FAR
    with pytest.raises(InputError, match="its joints, links or geometry are not those of the scene's"):
        certify(SCENE, MOTION, replace(robot, model=model))
    assert certify(SCENE, MOTION).certified


def test_a_change_of_what_a_setup_hands_out_changes_nothing() -> None:
    setup = Setup.of(SCENE)
    true = Certifier(setup).certify(MOTION)
    setup.loaded_model.inertias[2].mass = 1e-6
    setup.loaded_model.gravity.linear = np.zeros(3)
    setup.limits.clear()
    for array in (setup.limits["torque"], setup.query.start, setup.robot.lower, setup.robot.inner):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1e6
    assert Certifier(setup).certify(MOTION).uses == true.uses


def test_two_threads_one_of_which_changes_the_robot() -> None:
    """No thread ever gets a verdict on another robot: the true one, or a refusal."""
    true = certify(SCENE, MOTION).clearance

    def work(which: int) -> list[float | None]:
        found = []
        for _ in range(6):
            robot = load_scene_robot(SCENE)
            if which == 0:
                robot.model.jointPlacements[1].translation = FAR
            try:
                found.append(certify(SCENE, MOTION, robot).clearance)
            except InputError as error:
                assert re.search("was changed after|are not those of the scene's", str(error))  # noqa: PT017
        return found

    found = [value for values in together(work, 2) for value in values]
    assert set(found) <= {true}
