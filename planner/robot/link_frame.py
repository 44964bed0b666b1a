"""A link of a robot as a frame of its Pinocchio model: found by its name, for goals and for path constraints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.path_constraints import Relative
from hdplan.scenes.scene import Scene

Array = NDArray[np.float64]

AXES = ("x", "y", "z")


def link_frame(robot: Robot, link: str | None, field: str) -> int:
    """Return the index of a link among the model's frames. Raises InputError, naming the scene's `field`, for a link
    that the robot does not have, or that does not move."""
    if link is None:
        raise InputError(f"{field}.link: is missing")
    index = _frame(robot, link, f"{field}.link")
    if robot.model.frames[index].parentJoint == 0:
        raise InputError(f"{field}.link: '{link}' is fixed to the world, so no motion brings it anywhere")
    return index


class TwoLinks(NamedTuple):
    """Two links of which one is to keep its pose in the other's frame."""

    joints: tuple[int, int]  # of the model, that carry the link and the other one; 0: the world
    placements: tuple[Array, Array]  # (4, 4) of the two in their joints' frames
    pose: Array  # (4, 4) of the link's frame in the other's, that is to be kept


def relative_links(scene: Scene, robot: Robot, asked: Relative) -> TwoLinks:
    """Look up the two links of ``path.relative``, and their pose at the scene's start where it says none.

    Raises InputError for a link that the robot does not have, for two that do not move against each other, and for a
    start that does not fit the robot.
    """
    field = "path.relative"
    frames = [
        robot.model.frames[_frame(robot, *each)] for each in ((asked.link, f"{field}.link"), (asked.to, f"{field}.to"))
    ]
    link, other = (int(frame.parentJoint) for frame in frames)
    if link == other:
        raise InputError(f"{field}: '{asked.link}' and '{asked.to}' do not move against each other")
    placements = (frames[0].placement.homogeneous, frames[1].placement.homogeneous)
    if asked.pose is not None:
        return TwoLinks((link, other), placements, asked.pose.matrix)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.pin_q(robot.configuration(scene.start, scene.from_request)))
    held = (data.oMi[other] * frames[1].placement).actInv(data.oMi[link] * frames[0].placement)
    return TwoLinks((link, other), placements, held.homogeneous)


def _frame(robot: Robot, link: str, field: str) -> int:
    frames = robot.model.frames
    links = {str(frame.name): index for index, frame in enumerate(frames) if frame.type == pin.FrameType.BODY}
    if link not in links:
        raise InputError(f"{field}: unknown link '{link}'{nearest(link, links)}")
    return links[link]
