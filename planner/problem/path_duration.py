"""The duration of the fastest law along a motion as a cost, beside its path speed: for the last touches to a motion
that is to be quick.

    ½ V² T² + path speed

The path speed knows velocities alone; T, the time of the fastest law, regardless of its jerk, also knows how a motion
gets under way and brakes, and what the joints' torques allow. T has kinks and no second derivatives: those of the path
speed, whose cost is about ½ V² T² too where velocities are what limits a motion, stand for both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from hdplan.planner.problem.path_speed import PathSpeed
from hdplan.planner.problem.terms import MotionPenalty
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True, eq=False)
class PathDuration:
    """The cost of a motion's duration."""

    path_speed: PathSpeed
    slope_along: Callable[[Array], tuple[float, Array]]  # T [s] of waypoints (N, n), or ∞, and its derivative (N, n)

    def value(self, positions: Array) -> MotionPenalty:
        """Cost, gradient and a curvature in place of the Hessian at waypoints (N, n); its depth is 0."""
        duration, slope = self.slope_along(positions)
        speed, factor = self.path_speed.value(positions), self.path_speed.mean_square * duration
        if math.isinf(duration):
            return replace(speed, cost=math.inf)
        return MotionPenalty(
            0.5 * factor * duration + speed.cost,
            factor * slope + speed.gradient,
            2.0 * speed.diagonal,
            2.0 * speed.coupling,
            speed.depth,
        )

    def expression(self, steps: ca.MX) -> ca.MX:
        """Refuse: it is found by a loop."""
        raise InputError("the duration of a motion is not written in symbols")
