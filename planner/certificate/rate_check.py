"""Whether an executed curve respects the limits of velocity, acceleration and jerk: everywhere, not only at its rows.

Curve and limits -> for each quantity the greatest share of a joint's limit that is used, proven: a derivative of a
polynomial is a polynomial too, and lies within the hull of its control points. A jump of the velocity is an infinite
acceleration, a jump of the acceleration an infinite jerk; before its first row and after its last a motion is at rest.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.certificate.limit_checks import JUMP, LimitFinding, Use
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.robot.setup import Setup

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class RateCheck:
    """A scene's limits on time derivatives of joint values."""

    def __init__(self, setup: Setup) -> None:
        """Resolve the limits. Raises InputError for limits that do not match the robot."""
        self.limits = {name: setup.limits[name] for name in DERIVATIVES if name in setup.limits}
        self._joints = setup.robot.joint_names

    def check(self, curve: Curve) -> LimitFinding:
        """Prove the limits along a timed curve."""
        uses = tuple(
            self._use(quantity, curve.over_time(DERIVATIVES[quantity] - 1), limit)
            for quantity, limit in self.limits.items()
        )
        return LimitFinding(uses, tuple(_complaints(uses, curve)))

    def values(self, quantity: str, curve: Curve, interval: Index, fraction: Array) -> Array:
        """Return a derivative (k, n) on intervals (k,) at fractions (k,) of them."""
        return curve.over_time(DERIVATIVES[quantity]).at(interval, fraction)

    def overload(self, q: Array) -> None:
        """Return None: a robot at rest has no rates."""

    def _use(self, quantity: str, below: Curve, limit: Array) -> Use:
        """Bound the derivative of a curve, which is infinite where the curve itself jumps."""
        low, high = below.derivative().bounds()
        shares = np.maximum(-low, high) / limit  # (N − 1, n)
        if DERIVATIVES[quantity] > 1:
            jump = below.jumps()  # (N, n) before each row, at rest before the first and after the last
            at, joint = np.argwhere(jump > JUMP)[0] if (jump > JUMP).any() else (None, 0)
            if at is not None:
                shares[min(int(at), len(shares) - 1), joint] = np.inf
        interval, joint = (int(i) for i in np.unravel_index(int(shares.argmax()), shares.shape))
        return Use(quantity, float(shares[interval, joint]), self._joints[joint], interval, float(limit[joint]))


def _complaints(uses: tuple[Use, ...], curve: Curve) -> Iterator[tuple[Status, str]]:
    for use in uses:
        if use.within:
            continue
        began = curve.time_of(use.interval / (len(curve) - 1))
        what, after = f"joint '{use.joint}': {use.quantity}", f"after waypoint {use.interval} ({began:.3f} s)"
        if np.isinf(use.share):
            yield Status.TOO_FAST, f"{what} is infinite {after}, as the quantity whose derivative it is jumps there"
        else:
            yield Status.TOO_FAST, f"{what} up to {use.share:.1%} of its limit {use.limit:g} {after}"
