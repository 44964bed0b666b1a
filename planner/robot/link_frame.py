"""A link of a robot as a frame of its Pinocchio model, looked up by name for goals and path constraints."""

from __future__ import annotations

import pinocchio as pin

from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import InputError, nearest

AXES = ("x", "y", "z")


def link_frame(robot: Robot, link: str, field: str) -> int:
    """Return the index of a link among the model's frames. Raises InputError, naming the scene's `field`, for a link
    that the robot does not have or that does not move."""
    frames = robot.model.frames
    links = {str(frame.name): index for index, frame in enumerate(frames) if frame.type == pin.FrameType.BODY}
    if link not in links:
        raise InputError(f"{field}.link: unknown link '{link}'{nearest(link, links)}")
    if frames[links[link]].parentJoint == 0:
        raise InputError(f"{field}.link: '{link}' is fixed to the world, so no motion can move it")
    return links[link]
