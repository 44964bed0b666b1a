"""The check of a curve against the limits of velocity, acceleration and jerk: everywhere, not only at its rows.

Curve and limits -> for each quantity the greatest share of a joint's limit that is used, proven: a derivative of a
polynomial is a polynomial too, and lies within the hull of its control points. A jump of the velocity is an infinite
acceleration, a jump of the acceleration an infinite jerk; before its first row and after its last a motion is at rest,
or has the rates that the scene gives its start and goal.

Jumps of at most J = ROUNDING_JUMP may be rounding. A motion can grow by many of them all the same, a stair instead of a
slope. So let S(i, j) be the sum of those from row i to row j. The least slope L ≥ 0 with

    |S(i, j)| ≤ J + L (t_j − t_i)   for all i ≤ j

is added to the derivative: up to J in all, not for each row, the curve is then one whose derivative keeps the bound.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hdplan.planner.certificate.limit_checks import ROUNDING_JUMP, LimitFinding, Use
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows

SLOPE_ERROR = 1e-9  # relative, of the slope of a stair


class RateCheck:
    """A scene's limits on time derivatives of joint values."""

    def __init__(self, setup: Setup) -> None:
        """Resolve the limits. Raises InputError for limits that do not match the robot."""
        self.limits = {name: setup.limits[name] for name in DERIVATIVES if name in setup.limits}
        self._joints, self._around = setup.robot.joint_names, setup.rates_around
        lags = setup.scene.robot.tracking is not None and setup.scene.robot.tracking.of_rates
        self._lags = ("robot.tracking.velocity",) if lags and "velocity" in self.limits else ()  # limits are less

    def check(self, curve: Curve) -> LimitFinding:
        """Prove the limits along a timed curve."""
        uses = tuple(
            self._use(quantity, curve.over_time(DERIVATIVES[quantity] - 1), limit)
            for quantity, limit in self.limits.items()
        )
        return LimitFinding(uses, tuple(_complaints(uses, curve)), loads=self._lags)

    def values(self, quantity: str, curve: Curve, interval: Rows, fraction: Array) -> Array:
        """Return a derivative (k, n) on intervals (k,) at fractions (k,) of them."""
        return curve.over_time(DERIVATIVES[quantity]).at(interval, fraction)

    def overload(self, q: Array) -> None:
        """Return None: a robot at rest has no rates."""

    def _use(self, quantity: str, below: Curve, limit: Array) -> Use:
        """Bound the derivative of a curve, which is infinite where the curve itself jumps."""
        low, high = below.derivative.bounds()
        shares = np.maximum(-low, high) / limit  # (N − 1, n)
        if DERIVATIVES[quantity] > 1:
            steps = below.steps(*self._around(DERIVATIVES[quantity] - 1))  # (N, n) before each row
            abrupt = np.abs(steps) > ROUNDING_JUMP
            times = np.concatenate([[0.0], np.cumsum(below.widths)])
            shares += slope_of_steps(np.where(abrupt, 0.0, steps), times) / limit
            at, joint = np.argwhere(abrupt)[0] if abrupt.any() else (None, 0)
            if at is not None:
                shares[min(int(at), len(shares) - 1), joint] = np.inf
        interval, joint = (int(i) for i in np.unravel_index(int(shares.argmax()), shares.shape))
        return Use(quantity, float(shares[interval, joint]), self._joints[joint], interval, float(limit[joint]))


def slope_of_steps(steps: Array, times: Array) -> Array:
    """Return the least slopes L (n,) for which every window of steps (N, n), from row i to row j at `times` (N,), sums
    up to at most ROUNDING_JUMP + L (t_j − t_i).

    Each round finds the windows that exceed this by most, and takes the slopes that they need (W. Dinkelbach, "On
    nonlinear fractional programming", 1967): they only rise, and end at the least.
    """
    after = np.cumsum(steps, axis=0)
    before, columns = after - steps, np.arange(steps.shape[1])
    slopes = np.zeros(steps.shape[1])
    for sign in (1.0, -1.0):
        while True:
            low = sign * before - times[:, None] * slopes
            least = np.minimum.accumulate(low, axis=0)
            excess = sign * after - times[:, None] * slopes - least
            last = excess.argmax(axis=0)
            first = np.array([int((low[: end + 1, k]).argmin()) for k, end in enumerate(last.tolist())], np.int64)
            taken = times[last] - times[first]
            rise = sign * (after[last, columns] - before[first, columns]) - ROUNDING_JUMP
            needed = np.divide(rise, taken, out=np.zeros_like(rise), where=taken > 0.0)
            if not (needed > slopes * (1.0 + SLOPE_ERROR)).any():
                break
            slopes = np.maximum(slopes, needed)
    return slopes * (1.0 + SLOPE_ERROR)


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
