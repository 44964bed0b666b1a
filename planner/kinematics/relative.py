"""The pose of a link in the frame of another one, linearized.

The target T is a pose in the other link's frame, so that what is wanted, W = X T, moves with it. In world axes, with p
and ω of the link, p_W and ω_X of what is wanted,

    d(p_W − p)/dt = v_W − v,      and the turn from the link to W changes by ω_X − ω, to first order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.kinematics.inverse import LinkPose, off_pose
from hdplan.planner.robot.link_frame import links_apart
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.targets import PoseTarget


class RelativePose(NamedTuple):
    """A target in the frame of a link, and the other link that is to reach it."""

    link: LinkPose
    wanted: LinkPose  # the target, as a frame of the link to which it is relative

    @classmethod
    def of(cls, robot: Robot, target: PoseTarget, to: str) -> RelativePose:
        """Take a robot, its target and the link in whose frame that is. Raises InputError as `links_apart`."""
        arm, link = kinematics_of(robot), target.link
        frames = links_apart(robot, link, to, target.field)
        own, other = (LinkPose(robot, target, arm, frame.parentJoint, frame.placement.homogeneous) for frame in frames)
        return cls(own, other._replace(placement=other.placement @ target.pose.matrix))

    def linearized(self, q: Array) -> tuple[Array, Array]:
        """The error (B, 6) of the relative pose, translation [m] and rotation [rad] in world axes, and its Jacobian
        (B, 6, n)."""
        robot, target = self.link.robot, self.link.target
        state = self.link.arm.evaluate(robot.expand(q))
        own, other = self.link.moving(state), self.wanted.moving(state)
        wanted = np.zeros((len(q), 4, 4))
        wanted[:, :3, :3], wanted[:, :3, 3] = other.rotation, other.origin
        error, kept = off_pose(own, wanted, target.free_rotation)
        turning = kept(own.angular - other.angular)
        return error, robot.fold(np.concatenate([own.linear - other.linear, turning], axis=2).transpose(0, 2, 1))
