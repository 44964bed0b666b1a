"""The miss of a configuration at a pose goal, by Pinocchio's own kinematics, for the certificate.

A pose is reached if the link's origin is within `position_tolerance` [m] of the target's, and the angle [rad] between
the two frames is within `orientation_tolerance`: the angle of the rotation between them, or, if the link may rotate
freely about one of its axes, the angle between the two directions of that axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hdplan.planner.robot.link_frame import AXES, link_frame, link_poses
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.targets import PoseTarget

POSE_ROUNDING = 1e-9  # [m] and [rad] accepted beyond a tolerance


class Miss(NamedTuple):
    """Distance and angle of a link from its target."""

    position: float  # [m]
    angle: float  # [rad], 0 if any orientation is allowed

    def within(self, target: PoseTarget) -> bool:
        """True if the target counts as reached."""
        return (
            self.position <= target.position_tolerance + POSE_ROUNDING
            and self.angle <= target.orientation_tolerance + POSE_ROUNDING
        )

    def __str__(self) -> str:
        """The deviation as text, such as "3.2 mm and 0.1 rad"."""
        return f"{self.position * 1e3:.3g} mm" + f" and {self.angle:.3g} rad" * (self.angle > 0.0)


def miss_of(robot: Robot, target: PoseTarget, q: Array) -> Miss:
    """Return the distance by which configuration q (n,) misses the target, exact to rounding. Raises InputError as
    `link_frame`."""
    found = _found(robot, target, q[None])
    return Miss(float(_off(target, found)[0]), float(_angles(target, found)[0]))


def reached_by(robot: Robot, target: PoseTarget, q: Array) -> Mask:
    """Return, for each of the configurations q (B, n), whether it reaches the target: those whose `miss_of` is `within`
    it."""
    found = _found(robot, target, q)
    near = _off(target, found) <= target.position_tolerance + POSE_ROUNDING
    near[near] = _angles(target, found[near]) <= target.orientation_tolerance + POSE_ROUNDING
    return near


def _found(robot: Robot, target: PoseTarget, q: Array) -> Array:
    """The link's poses (B, 4, 4)."""
    return link_poses(robot, q, link_frame(robot, target.link, target.field))


def _off(target: PoseTarget, found: Array) -> Array:
    """Distances [m] (B,) of poses (B, 4, 4) from the wanted one."""
    return np.asarray(np.sqrt(((found[:, :3, 3] - target.pose.matrix[:3, 3]) ** 2).sum(axis=1)))


def _angles(target: PoseTarget, found: Array) -> Array:
    """The angles [rad] (B,) between poses (B, 4, 4) and the wanted one that count."""
    wanted = target.pose.matrix
    if target.free_rotation == "all":
        return np.zeros(len(found))
    if target.free_rotation in AXES:
        axis = AXES.index(target.free_rotation)
        one, other = found[:, :3, axis], wanted[:3, axis]
        return _angle(np.cross(one, other), one @ other)
    turn = found[:, :3, :3].transpose(0, 2, 1) @ wanted[:3, :3]
    skew = turn - turn.transpose(0, 2, 1)
    return _angle(0.5 * skew[:, (2, 0, 1), (1, 2, 0)], 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0))


def _angle(sine: Array, cosine: Array) -> Array:
    """Angles (B,) of vectors (B, 3) as long as their sines, and of their cosines."""
    return np.asarray(np.arctan2(np.sqrt((sine**2).sum(axis=1)), cosine))


def pose_words(target: PoseTarget) -> str:
    """Describe the pose that the target requires of its link."""
    x, y, z = target.pose.position
    if target.free_rotation == "all":
        turn = "in any orientation"
    else:
        free = "" if target.free_rotation == "none" else f", free to rotate about its {target.free_rotation} axis"
        turn = f"within {target.orientation_tolerance:g} rad{free}"
    return f"{target.link} within {target.position_tolerance * 1e3:g} mm of ({x:g}, {y:g}, {z:g}), {turn}"
