"""A robot's links, and the objects that it holds, as frames of its Pinocchio model: found by name, for goals and for
path constraints."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.once import made_once
from hdplan.scenes.path_constraints import Relative
from hdplan.scenes.scene import Scene

AXES = ("x", "y", "z")
HELD = pin.FrameType.OP_FRAME  # the frames of held objects, which are no links


def link_frame(robot: Robot, link: str | None, field: str) -> int:
    """Return the index of a link among the model's frames; without a name, of the end effector's.

    Raises InputError, naming the scene's `field` (if any), for a link that the robot does not have or that does not
    move, and as `end_effector`.
    """
    name = end_effector(robot, field or "link") if link is None else link
    where = f"{field}.link" if field else "link"
    index = _frame(robot, name, where)
    if robot.model.frames[index].parentJoint == 0:
        raise InputError(f"{where}: no planned joint moves '{name}': it is fixed to the world, or held")
    return index


def end_effector(robot: Robot, field: str) -> str:
    """Return the link that a goal is about where it names none, one that every planned joint moves: the one with the
    SRDF's end effector, or else the last one of the group's chain, or of the planned joints.

    Raises InputError, naming the scene's `field`, where there is not one such link: the planned joints branch, as two
    arms do, or several end effectors are at their end.
    """
    model = robot.model
    last = [joint for joint in range(1, model.njoints) if _moved_by_all(robot, joint)]
    links = links_of(robot)
    hands = {hand.link for hand in robot.semantics.end_effectors if hand.link in links}
    found = sorted(link for link in hands if model.frames[links[link]].parentJoint in last)
    if last and not found:
        before = _last_joint(robot, last[0])
        found = [link for link, index in links.items() if model.frames[index].parentFrame == before][:1]
    if len(found) != 1:
        why = f"its end effectors are {', '.join(found)}" if found else "no one link is moved by all planned joints"
        raise InputError(f"{field}: the key 'link' is missing, and {robot.name} has no one end effector: {why}")
    return found[0]


def _moved_by_all(robot: Robot, joint: int) -> bool:
    """True if all planned joints, or what follows them, move what a joint of the model carries."""
    own = [index - 1 for index in robot.model.supports[joint] if index > 0]
    return len(set(robot.linkage.leader[own].tolist() if robot.linkage else own)) == robot.n


def _last_joint(robot: Robot, joint: int) -> int:
    """Return the frame of the last joint of the planned group, which may be a fixed one behind a joint of the model."""
    frames, planned = robot.model.frames, set(robot.joint_names)
    groups = [set(joints) for joints in robot.semantics.groups.values()]
    whole = [joints for joints in groups if planned <= joints and not joints & set(robot.locked)]
    fixed = [
        index
        for index, frame in enumerate(frames)
        if frame.type == pin.FrameType.FIXED_JOINT and frame.parentJoint == joint and whole and frame.name in whole[0]
    ]
    return fixed[-1] if fixed else int(robot.model.getFrameId(robot.model.names[joint], pin.FrameType.JOINT))


class TwoLinks(NamedTuple):
    """Two links, one of which is to keep its pose in the other's frame."""

    joints: tuple[int, int]  # of the model, that carry the link and the other one; 0: the world
    placements: tuple[Array, Array]  # (4, 4) of the two in their joints' frames
    pose: Array  # (4, 4) of the link's frame in the other's, to be kept


def relative_links(scene: Scene, robot: Robot, constraint: Relative) -> TwoLinks:
    """Look up the two links of ``path.relative``, and their relative pose at the scene's start where none is given.

    Raises InputError for a link that the robot does not have, for two that do not move relative to each other, and for
    a start that does not fit the robot.
    """
    frames = links_apart(robot, constraint.link, constraint.to, "path.relative")
    link, other = (int(frame.parentJoint) for frame in frames)
    placements = (frames[0].placement.homogeneous, frames[1].placement.homogeneous)
    if constraint.pose is not None:
        return TwoLinks((link, other), placements, constraint.pose.matrix)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.pin_q(robot.configuration(scene.start, scene.from_request)))
    held = (data.oMi[other] * frames[1].placement).actInv(data.oMi[link] * frames[0].placement)
    return TwoLinks((link, other), placements, held.homogeneous)


def links_apart(robot: Robot, link: str | None, to: str, field: str) -> tuple[pin.Frame, pin.Frame]:
    """Return the frames of two links that move relative to each other; without a name, the first is the end effector.

    Raises InputError, naming the scene's `field` (if any), for a link that the robot does not have, for two that do not
    move relative to each other, and as `end_effector`.
    """
    link = end_effector(robot, field or "link") if link is None else link
    before = f"{field}." if field else ""
    one, other = (
        robot.model.frames[_frame(robot, name, f"{before}{key}")] for name, key in ((link, "link"), (to, "to"))
    )
    if one.parentJoint == other.parentJoint:
        raise InputError(f"{field or 'link'}: '{link}' and '{to}' do not move relative to each other")
    return one, other


def _frame(robot: Robot, link: str, field: str) -> int:
    if link not in (known := frames_of(robot)):
        raise InputError(f"{field}: unknown link '{link}'{nearest(link, known)}")
    return known[link]


def link_poses(robot: Robot, q: Array, frame: int) -> Array:
    """Return the poses (k, 4, 4) of a frame of the model in the world at joint values q (k, n), by Pinocchio."""
    model, data, found = robot.model, robot.model.createData(), []
    for values in robot.pin_q(q):
        pin.forwardKinematics(model, data, values)
        found.append(pin.updateFramePlacement(model, data, frame).homogeneous)
    return np.array(found).reshape(-1, 4, 4)


@made_once(8)
def links_of(robot: Robot) -> Mapping[str, int]:
    """Return the frames of all links in the model, by name, the root first."""
    frames = enumerate(robot.model.frames)
    return MappingProxyType({str(frame.name): index for index, frame in frames if frame.type == pin.FrameType.BODY})


@made_once(8)
def frames_of(robot: Robot) -> Mapping[str, int]:
    """Return the frames of all links and of the objects that a robot holds in the model, by name."""
    frames, held = robot.model.frames, {each.name for each in robot.attached}
    objects = {str(each.name): i for i, each in enumerate(frames) if each.type == HELD and each.name in held}
    return MappingProxyType({**links_of(robot), **objects})
