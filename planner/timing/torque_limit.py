"""The torque limit along a path: when time is stretched by k, the torque of the motion falls by k², that of gravity
does not change.

Torques are sampled here, not bounded; the certificate bounds them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from hdplan.planner.kinematics.inverse_dynamics import dynamics_of
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.limits import PathSamples
from hdplan.planner.timing.time_optimal import PathRows

Array = NDArray[np.float64]

SAMPLES = 2  # per interval between two rows
MARGIN = 2e-3  # [–] of the limits that is left unused, as torques are sampled, not bounded
ROOM = 5e-3  # [–] of a limit: if gravity leaves less, a motion would have to creep for minutes


class TorqueLimit:
    """A limit (n,) on the joints' torques [Nm] or [N], with the scene's loads."""

    def __init__(self, setup: Setup) -> None:
        """Build the dynamics. Raises InputError for loads that do not match the robot."""
        self.dynamics, self.limit = dynamics_of(setup), setup.limits["torque"]

    def rows(self, spline: BSpline, grid: Array) -> PathRows | None:
        """Return it on a path at the points of a grid; None if gravity alone exceeds a limit: then no time law helps,
        and the certificate says where."""
        torques = self.dynamics.coefficients(*(spline(grid, order) for order in range(3)))
        if self._too_heavy(torques.c):
            return None
        return PathRows.both(torques.a, torques.b, torques.c, (1 - MARGIN) * self.limit)

    def stretch_of_law(self, samples: PathSamples) -> Array:
        """Compute it at the samples."""
        (slope, bend, _), (first, second, _) = samples.slopes, samples.rates
        drive = self.dynamics.coefficients(samples.path(samples.u), slope, bend)
        return self._stretch(drive.a * second + drive.b * first**2, drive.c)

    def stretch(self, curve: Curve) -> float:
        """Compute it from samples at the rows and between them."""
        parameters = np.linspace(0.0, 1.0, SAMPLES * (len(curve) - 1) + 1)
        q, v, a = (curve.over_time(order).at_parameter(parameters) for order in range(3))
        gravity = self.dynamics.torques(q, 0.0 * v, 0.0 * a)
        return float(self._stretch(self.dynamics.torques(q, v, a) - gravity, gravity).max(initial=0.0))

    def _stretch(self, moving: Array, gravity: Array) -> Array:
        """Return the k (m,) by which time must be stretched for |gravity + moving/k²| ≤ limit, each (m, n); 0 if
        gravity alone exceeds a limit, as no stretch helps then."""
        if self._too_heavy(gravity):
            return np.zeros(len(gravity))
        room = (1 - MARGIN) * self.limit - np.where(moving > 0.0, gravity, -gravity)
        stretch: Array = np.sqrt((np.abs(moving) / room).max(axis=1))
        return stretch

    def _too_heavy(self, gravity: Array) -> bool:
        """Whether the gravity torques (m, n) alone leave next to nothing of a limit anywhere."""
        return bool((np.abs(gravity) > (1 - ROOM) * self.limit).any())
