"""The miss of a configuration at a pose goal, by Pinocchio's own kinematics, for the certificate.

A pose is reached if the link's origin is within `position_tolerance` [m] of the target's, and the angle [rad] between
the two frames is within `orientation_tolerance`: the angle of the rotation between them, or, if the link may rotate
freely about one of its axes, the angle between the two directions of that axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hdplan.planner.robot.link_frame import AXES, link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.targets import PoseTarget

ROUNDING = 1e-9  # [m] and [rad] accepted beyond a tolerance


class Miss(NamedTuple):
    """Distance and angle of a link from its target."""

    position: float  # [m]
    angle: float  # [rad], 0 if any orientation is allowed

    def within(self, target: PoseTarget) -> bool:
        """True if the target counts as reached."""
        return (
            self.position <= target.position_tolerance + ROUNDING
            and self.angle <= target.orientation_tolerance + ROUNDING
        )

    def __str__(self) -> str:
        """The deviation as text, such as "3.2 mm and 0.1 rad"."""
        return f"{self.position * 1e3:.3g} mm" + f" and {self.angle:.3g} rad" * (self.angle > 0.0)


def miss_of(robot: Robot, target: PoseTarget, q: Array) -> Miss:
    """Return how far configuration q (n,) misses the target, exact to rounding. Raises InputError as `link_frame`."""
    return misses_of(robot, target, q[None])[0]


def misses_of(robot: Robot, target: PoseTarget, q: Array) -> list[Miss]:
    """The same for configurations q (B, n)."""
    frame, data = link_frame(robot, target.link, target.field), robot.model.createData()
    wanted, found = target.pose.matrix, []
    for values in robot.pin_q(q):
        pin.framesForwardKinematics(robot.model, data, values)
        found.append(_miss(target, data.oMf[frame], wanted))
    return found


def _miss(target: PoseTarget, found: pin.SE3, wanted: Array) -> Miss:
    off = float(np.linalg.norm(found.translation - wanted[:3, 3]))
    if target.free_rotation == "all":
        return Miss(off, 0.0)
    if target.free_rotation in AXES:
        axis = AXES.index(target.free_rotation)
        one, other = found.rotation[:, axis], wanted[:3, axis]
        return Miss(off, float(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)))
    return Miss(off, float(np.linalg.norm(pin.log3(found.rotation.T @ wanted[:3, :3]))))


def pose_words(target: PoseTarget) -> str:
    """Describe the pose that the target asks of its link."""
    x, y, z = target.pose.position
    if target.free_rotation == "all":
        turn = "in any orientation"
    else:
        free = "" if target.free_rotation == "none" else f", free to rotate about its {target.free_rotation} axis"
        turn = f"within {target.orientation_tolerance:g} rad{free}"
    return f"{target.link} within {target.position_tolerance * 1e3:g} mm of ({x:g}, {y:g}, {z:g}), {turn}"
