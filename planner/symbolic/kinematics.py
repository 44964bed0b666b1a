"""The pose of a robot's link as a CasADi Function of the planned joints."""

from __future__ import annotations

from typing import TypeVar

import casadi as ca
import pinocchio as pin

from hdplan.planner.kinematics.forward import constant, kinematics_of
from hdplan.planner.robot.as_loaded import check_as_loaded
from hdplan.planner.robot.link_frame import end_effector
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.scene import Scene
from hdplan.scenes.values import checked, instance, text

Expression = TypeVar("Expression", ca.SX, ca.MX)


def kinematics(robot: Robot | Scene, link: str | None = None) -> ca.Function:
    """Return the pose of a link as a CasADi Function ``(q (n,)) -> pose (4, 4)``.

    q are the planned joints [rad or m], in the order of ``joint_names``; joints that follow others move along. The pose
    is [R | p; 0 0 0 1], the link's frame in the world, p in [m]. An SX graph: CasADi derives it as often as needed,
    and inlines it where it is called with SX.

    Args:
        robot: a robot, or a scene, which stands for its robot with held objects.
        link: a link of the URDF, or a held object; without it, the end effector.

    Raises:
        InputError: for an unknown link, a robot without one end effector, and every other reason to refuse the scene's
            robot.
    """
    found = robot_of(robot)
    name, places = end_effector(found, "link") if link is None else checked(text, link, "link"), link_places(found)
    if name not in places:
        raise InputError(f"link: unknown link '{name}'{nearest(name, places)}")
    joint, placement = places[name]
    tree, q = kinematics_of(found), ca.SX.sym("q", found.n)
    rotations, origins = tree.function(joint_values(found, q))
    turn, place = rotations[:, 3 * joint : 3 * joint + 3], origins[:, joint]
    top = ca.horzcat(turn @ constant(placement[:3, :3]), place + turn @ constant(placement[:3, 3]))
    pose = ca.densify(ca.vertcat(top, ca.SX(ca.DM([[0, 0, 0, 1]]))))
    return ca.Function("kinematics", [q], [pose], ["q"], ["pose"])


def robot_of(source: Robot | Scene) -> Robot:
    """Return a robot as it was loaded, or that of a scene."""
    if isinstance(source, Scene):
        return Setup.of(source).robot
    instance(source, Robot, "robot")
    check_as_loaded(source)
    return source


def joint_values(robot: Robot, q: Expression) -> Expression:
    """Return the values of all joints of the model, E q + c, at values q (n,) of the planned ones."""
    if robot.linkage is None:
        return q
    return ca.sparsify(ca.DM(robot.linkage.matrix)) @ q + ca.DM(robot.linkage.offset)


def link_places(robot: Robot) -> dict[str, tuple[int, Array]]:
    """Return of every link and held object the joint that carries it, and the placement (4, 4) of its frame there."""
    frames = [frame for frame in robot.model.frames if frame.type == pin.FrameType.BODY]
    places = {str(frame.name): (int(frame.parentJoint), frame.placement.homogeneous) for frame in frames}
    for held in robot.attached:
        joint, place = places[held.link]
        places[held.name] = joint, place @ held.pose.matrix
    return places
