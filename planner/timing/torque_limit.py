"""The limit of torques along a path: what moving takes of it falls by k² when time is stretched by k, gravity's part
does not.

Torques are looked at here, not bounded; the certificate bounds them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from toppra.constraint import LinearConstraint

from hdplan.planner.kinematics.inverse_dynamics import PathTorques, dynamics_of
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.limits import PathLook

Array = NDArray[np.float64]

LOOKS = 2  # between two rows
MARGIN = 2e-3  # [–] of the limits that is left, as torques are looked at, not bounded
ROOM = 5e-3  # [–] of a limit: where gravity leaves less, a motion would take minutes to creep past


class TorqueLimit:
    """A limit (n,) on the joints' torques [Nm] or [N], with the scene's loads."""

    def __init__(self, setup: Setup) -> None:
        """Build the dynamics. Raises InputError for loads that do not fit the robot."""
        self.dynamics, self.limit = dynamics_of(setup), setup.limits["torque"]

    def constraint(self, spline: BSpline, grid: Array) -> Any | None:
        """Return what keeps the torques on a path; None where gravity alone is too much: then no time law helps, and
        the certificate says where."""
        torques = self.dynamics.coefficients(*(spline(grid, order) for order in range(3)))
        return None if self._too_heavy(torques.c) else _TorqueConstraint(torques, (1 - MARGIN) * self.limit)

    def stretch_of_law(self, look: PathLook) -> float:
        """Return it for the very places."""
        (slope, bend, _), (first, second, _) = look.slopes, look.rates
        drive = self.dynamics.coefficients(look.q, slope, bend)
        return self._stretch(drive.a * second + drive.b * first**2, drive.c)

    def stretch(self, curve: Curve) -> float:
        """Return it by looks at rows and between them."""
        looks = np.linspace(0.0, 1.0, LOOKS * (len(curve) - 1) + 1)
        q, v, a = (curve.over_time(order).at_parameter(looks) for order in range(3))
        gravity = self.dynamics.torques(q, 0.0 * v, 0.0 * a)
        return self._stretch(self.dynamics.torques(q, v, a) - gravity, gravity)

    def _stretch(self, moving: Array, gravity: Array) -> float:
        """Return the k by which time must be stretched for |gravity + moving/k²| ≤ limit, each (m, n); where gravity
        alone is too much no stretch helps, and none is asked for."""
        if self._too_heavy(gravity):
            return 0.0
        room = (1 - MARGIN) * self.limit - np.where(moving > 0.0, gravity, -gravity)
        return float(np.sqrt((np.abs(moving) / room).max(initial=0.0)))

    def _too_heavy(self, gravity: Array) -> bool:
        """Whether gravity's torques (m, n) alone leave next to nothing of the limits somewhere."""
        return bool((np.abs(gravity) > (1 - ROOM) * self.limit).any())


class _TorqueConstraint(LinearConstraint):  # type: ignore[misc]
    """−limits ≤ a ü + b u̇² + c ≤ limits at the points of a grid on one path: toppra's own would ask for the torques one
    point at a time."""

    def __init__(self, torques: PathTorques, limits: Array) -> None:
        """Take the torques at the grid's points and limits (n,)."""
        super().__init__()
        self.torques, self.limits = torques, limits
        self.dof = len(limits)
        self.identical = True  # F and g are the same at all points

    def compute_constraint_params(self, path: Any, gridpoints: Array, *_: Any) -> tuple[Any, ...]:
        """Return a, b, c, F, g of F (a ü + b u̇² + c) ≤ g; the path and its grid are those of the torques."""
        both = np.vstack([np.eye(self.dof), -np.eye(self.dof)])
        return self.torques.a, self.torques.b, self.torques.c, both, np.tile(self.limits, 2), None, None
