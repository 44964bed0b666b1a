"""The limits of a scene in the timing: for each rows for the fastest law, and a factor by which to stretch time.

When a motion is stretched in time by k, velocities fall by k, accelerations by k², and jerks by k³.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.duration_slope import Binding
from hdplan.planner.timing.time_optimal import GREATEST_RATE, OnGrid, PathRows
from hdplan.scenes.array_types import Array

MARGIN = 1e-6  # [–] of a limit that is left unused


class TimingLimit(Protocol):
    """One limit of a scene."""

    def rows(self, path: OnGrid) -> PathRows | None:
        """Rows of the limit on a path at the points of `grid`; None if the fastest law does not know this limit."""

    def stretch(self, curve: Curve) -> float:
        """Return by how much an executed curve must be stretched for the limit to hold along it; at most 1 if it
        holds."""


class RateLimit:
    """A limit (n,) on a time derivative of the joints' values."""

    def __init__(self, order: int, limit: Array) -> None:
        """Take the order of the derivative and its greatest absolute values."""
        self.order, self.limit = order, limit

    @property
    def in_law(self) -> bool:
        """True for velocities and accelerations."""
        return self.order <= 2

    def rows(self, path: OnGrid) -> PathRows | None:
        """Rows of the limit, for velocities and accelerations."""
        if not self.in_law:
            return None
        if self.order == 2:
            return PathRows.both(path.slope, path.curvature, np.zeros_like(path.slope), self.limit)
        with np.errstate(divide="ignore"):
            most = np.minimum(self.limit / np.abs(path.slope), GREATEST_RATE).min(axis=1, keepdims=True) ** 2
        return PathRows(np.zeros_like(most), np.ones_like(most), most)

    def slopes(self, path: OnGrid, binding: Binding) -> OnGrid:
        """Return the derivatives of the duration by q, q' and q'' through rows of this limit that bind."""
        found, point = OnGrid(*np.zeros((3, *path.q.shape))), binding.point
        if self.order == 2:  # a = ±q', b = ±q''
            joint, sign = binding.row % path.q.shape[1], np.where(binding.row < path.q.shape[1], 1.0, -1.0)
            np.subtract.at(found.slope, (point, joint), sign * binding.multiplier * binding.push)
            np.subtract.at(found.curvature, (point, joint), sign * binding.multiplier * binding.square)
            return found
        joint = (np.abs(path.slope[point]) / self.limit).argmax(axis=1)  # c = (v/q')², of the slowest joint
        by_slope = -2.0 * self.limit[joint] ** 2 / path.slope[point, joint] ** 3
        np.add.at(found.slope, (point, joint), binding.multiplier * by_slope)
        return found

    def stretch(self, curve: Curve) -> float:
        """Compute it from a bound on the whole curve, not from samples."""
        share = float((curve.over_time(self.order).largest() / self.limit).max())
        return float(((1 + MARGIN) * share) ** (1 / self.order))


def timing_limits(setup: Setup) -> tuple[TimingLimit, ...]:
    """Return the limits that a scene has; modules for the others are not even imported. Raises InputError for limits
    and loads that do not match the robot, LookupError for a limit that nothing here keeps."""
    of_tool = []
    if setup.scene.path.follow is not None and setup.scene.path.follow.rated:
        from hdplan.planner.timing.tool_limit import ToolLimit

        of_tool.append(ToolLimit.of(setup))
    return (*(_kept(name, limit, setup) for name, limit in setup.limits.items()), *of_tool)


def _kept(quantity: str, limit: Array, setup: Setup) -> TimingLimit:
    if quantity in DERIVATIVES:
        return RateLimit(DERIVATIVES[quantity], limit)
    match quantity:
        case "torque":
            from hdplan.planner.timing.torque_limit import TorqueLimit

            return TorqueLimit(setup)
    raise LookupError(f"no time law keeps limits.{quantity}")
