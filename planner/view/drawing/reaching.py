"""Inverse kinematics for dragging: a configuration follows a handle from its posture, and no other one is searched.

Damped least squares (`kinematics.inverse`), within the joint limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from hdplan.planner.kinematics.inverse import Aim, damped_step
from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.motion import Tip
from hdplan.scenes.array_types import Array

MOST_STEPS = 60  # of damped least squares
CONVERGED = 1e-5  # [m] and [rad] at which it has converged
TOLERANCE_SHARE = 0.75  # share of a goal's tolerance
LONGEST_STEP = 0.3  # [rad] or [m] of one step of a joint


def follow_tip(tip: Tip, postures: Sequence[Array], target: pin.SE3) -> tuple[Array, float]:
    """Return the configuration (n,) whose tip is nearest to `target` (world frame), and how far it is off [m]: near the
    first of some postures (n,) from which it arrives."""
    robot = tip.robot
    data = robot.model.createData()
    offset = pin.SE3(np.eye(3), tip.offset)

    def linearized(q: Array) -> tuple[Array, Array]:
        pin.computeJointJacobians(robot.model, data, robot.pin_q(q))
        error = pin.log6((data.oMi[tip.joint] * offset).actInv(target)).vector
        own = pin.getJointJacobian(robot.model, data, tip.joint, pin.ReferenceFrame.LOCAL)
        return error[None], robot.fold(offset.toActionMatrixInverse() @ own)[None]

    q, _ = _follow(robot, linearized, postures)
    return q, float(np.linalg.norm(tip.placement(q).translation - target.translation))


def follow_pose(aim: Aim, postures: Sequence[Array]) -> tuple[Array, bool, float]:
    """Return the configuration (n,) that is nearest to the aim, near the first of some postures (n,) from which it
    arrives, whether it is within three quarters of the tolerances, and how far the farthest link's origin is off
    [m]."""
    q, error = _follow(aim.robot, lambda q: aim.linearized(q[None]), postures)
    return q, bool(aim.within(error, TOLERANCE_SHARE)[0]), float(aim.sizes(error)[0, :, 0].max())


def _follow(
    robot: Robot, linearized: Callable[[Array], tuple[Array, Array]], postures: Sequence[Array]
) -> tuple[Array, Array]:
    """Return the configuration (n,) of the least error found, and that error (1, m): `linearized` gives the error and
    its Jacobian (1, m, n)."""
    best, least, left = postures[0], np.inf, np.zeros((1, 0))
    for q in postures:
        for _ in range(MOST_STEPS):
            error, jacobian = linearized(q)
            size = float(np.linalg.norm(error))
            if size < least:
                best, least, left = q, size, error
            if size < CONVERGED:
                return best, left
            q = damped_step(robot, q[None], error, jacobian, LONGEST_STEP)[0]
    return best, left
