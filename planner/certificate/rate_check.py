"""Whether an executed curve respects the limits of velocity, acceleration and jerk: everywhere, not only at its rows.

Curve and limits -> for each quantity the greatest share of a joint's limit, proven: a derivative of a polynomial is one
too, and lies within the hull of its control points. A jump of a velocity is an infinite acceleration, one of an
acceleration an infinite jerk; before its first row and after its last a motion is at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.joint_limits import RATES, rate_limits
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.scene import Scene

Array = NDArray[np.float64]

JUMP = 1e-6  # [rad/s], [rad/s²] or the like: what rounding makes of two equal values
ROUNDING = 1e-9  # relative


@dataclass(frozen=True)
class Use:
    """How much of what the joints can do a motion takes, where it takes most."""

    quantity: str  # "velocity", "acceleration", "jerk", "torque"
    share: float  # of the limit, proven; inf where a jump makes it infinite
    joint: str
    interval: int  # between rows `interval` and `interval` + 1
    limit: float  # of that joint

    @property
    def within(self) -> bool:
        """Whether the limit holds."""
        return self.share <= 1.0 + ROUNDING


def rates(curve: Curve, scene: Scene, robot: Robot) -> tuple[Use, ...]:
    """Return the use of every limit of the scene on velocity, acceleration and jerk; for a curve with times.

    Raises InputError for limits that do not fit the robot.
    """
    found = []
    for order, (quantity, limit) in enumerate(zip(RATES, rate_limits(scene, robot), strict=True), start=1):
        if limit is not None:
            found.append(_use(quantity, curve.over_time(order - 1), limit, robot, order > 1))
    return tuple(found)


def _use(quantity: str, below: Curve, limit: Array, robot: Robot, jumps: bool) -> Use:
    """Bound the derivative of a curve; where that curve itself may jump, it must not."""
    low, high = below.derivative().bounds()
    shares = np.maximum(-low, high) / limit  # (N − 1, n)
    if jumps:
        jump = below.jumps()  # (N, n) before each row, at rest before the first and after the last
        at, joint = np.argwhere(jump > JUMP)[0] if (jump > JUMP).any() else (None, 0)
        if at is not None:
            shares[min(int(at), len(shares) - 1), joint] = np.inf
    interval, joint = (int(i) for i in np.unravel_index(int(shares.argmax()), shares.shape))
    return Use(quantity, float(shares[interval, joint]), robot.joint_names[joint], interval, float(limit[joint]))
