"""Configurations along a straight line of a link: inverse kinematics from each place to the next."""

from __future__ import annotations

import numpy as np

from hdplan.planner.job.places import link_pose
from hdplan.planner.kinematics.inverse import Aim, damped_step
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.poses import Pose
from hdplan.scenes.targets import PoseTarget

STEPS = 60  # of damped least squares at a place, at most
EXACT = 1e-7  # [m] and [rad]
FARTHEST = 0.5  # [rad] or [m] that a joint may move between two places: beyond it the line runs through a singularity


class NotFollowedError(Exception):
    """A line that the arm cannot follow from where it begins, and where it ends to do so."""


def along_line(robot: Robot, start: Array, target: PoseTarget, count: int) -> Array:
    """Return configurations (count, n) that bring the target's link from where it is at `start` (n,) straight to the
    target's position, evenly, without turning. Raises NotFollowedError."""
    assert target.link is not None
    begins = link_pose(robot, start, target.link)
    ends = np.array(target.pose.position)
    rows = [start]
    for share in np.linspace(0.0, 1.0, count)[1:]:
        place = (1.0 - share) * begins[:3, 3] + share * ends
        aim = Aim.at(robot, PoseTarget(target.link, Pose(place, target.pose.quaternion_xyzw)))
        q = np.clip(2.0 * rows[-1] - rows[-2] if len(rows) > 1 else start, robot.lower, robot.upper)[None]
        for _ in range(STEPS):
            error, jacobian = aim.linearized(q)
            if (aim.sizes(error) <= EXACT).all():
                break
            q = damped_step(robot, q, error, jacobian)
        else:
            at_limit = np.flatnonzero((q[0] <= robot.lower + 1e-9) | (q[0] >= robot.upper - 1e-9))
            why = (
                f"'{robot.joint_names[int(at_limit[0])]}' is at its limit"
                if len(at_limit)
                else "no joints reach farther"
            )
            raise NotFollowedError(f"{target.link} cannot be brought along beyond {share:.0%} of the line: {why}")
        if np.abs(q[0] - rows[-1]).max() > FARTHEST:
            raise NotFollowedError(f"the arm would have to turn over at {share:.0%} of the line")
        rows.append(q[0])
    return np.array(rows)
