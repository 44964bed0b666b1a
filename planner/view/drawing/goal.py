"""Inverse kinematics for dragging: the goal's configuration follows the tip's handle.

Damped least squares on the tip's placement (`kinematics.inverse`), from the previous goal, within the joint limits. It
follows the handle from the current posture and does not search for another one.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hdplan.planner.kinematics.inverse import damped_step
from hdplan.planner.view.drawing.motion import Tip
from hdplan.scenes.array_types import Array

STEPS = 60  # at most
CLOSE = 1e-5  # [m] and [rad] at which it has converged
LONGEST = 0.3  # [rad] or [m] of one step of a joint


def follow(tip: Tip, q: Array, target: pin.SE3) -> tuple[Array, float]:
    """Return the configuration (n,) near `q` whose tip is nearest to `target` (world frame), and how far it is off
    [m]."""
    robot = tip.robot
    data = robot.model.createData()
    offset = pin.SE3(np.eye(3), tip.offset)
    best, least, off = q, np.inf, np.inf
    for _ in range(STEPS):
        pin.computeJointJacobians(robot.model, data, robot.pin_q(q))
        placement = data.oMi[tip.joint] * offset
        error = pin.log6(placement.actInv(target)).vector
        size = float(np.linalg.norm(error))
        if size < least:
            best, least = q, size
            off = float(np.linalg.norm(placement.translation - target.translation))
        if size < CLOSE:
            break
        jacobian = offset.toActionMatrixInverse() @ pin.getJointJacobian(
            robot.model, data, tip.joint, pin.ReferenceFrame.LOCAL
        )
        q = damped_step(robot, q[None], error[None], jacobian[None], LONGEST)[0]
    return best, off
