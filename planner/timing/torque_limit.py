"""The torque limit along a path: when time is stretched by k, the torque of the motion falls by k², that of gravity
does not change.

Torques are sampled here, not bounded; the certificate bounds them.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from hdplan.planner.kinematics.inverse_dynamics import dynamics_of
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.duration_slope import Binding
from hdplan.planner.timing.time_optimal import OnGrid, PathRows
from hdplan.scenes.array_types import Array

MARGIN = 2e-3  # [–] of the limits that is left unused, as torques are sampled, not bounded
LEAST_MARGIN = 5e-3  # [–] of a limit: if gravity leaves less, a motion would have to creep for minutes


class TorqueLimit:
    """A limit (n,) on the joints' torques [Nm] or [N], with the scene's loads."""

    def __init__(self, setup: Setup) -> None:
        """Build the dynamics. Raises InputError for loads that do not match the robot."""
        self.dynamics, self.limit = dynamics_of(setup), setup.limits["torque"]
        self.robot, self.model = setup.robot, setup.loaded_model

    in_law = True

    def rows(self, path: OnGrid) -> PathRows | None:
        """Rows on a path at the points of `grid`; None if gravity alone exceeds a limit: then no time law helps,
        and the certificate says where."""
        along = self.dynamics.coefficients(*path)
        return None if self._too_heavy(along.c) else PathRows.both(along.a, along.b, along.c, (1 - MARGIN) * self.limit)

    def slopes(self, path: OnGrid, binding: Binding) -> OnGrid:
        """Return the derivatives of the duration by q, q' and q'' through rows of this limit that bind: with the torque
        τ(q, q̇, q̈) of q̇ = q' u̇ and q̈ = q' ü + q'' u̇²."""
        found, n, data = OnGrid(*np.zeros((3, *path.q.shape))), path.q.shape[1], self.model.createData()
        q, speed = self.robot.pin_q(path.q), np.sqrt(binding.square)
        factors = np.where(binding.row < n, -1.0, 1.0) * binding.multiplier
        for k, point in enumerate(binding.point.tolist()):
            slope, joint = path.slope[point], binding.row[k] % n
            acceleration = slope * binding.push[k] + path.curvature[point] * binding.square[k]
            by_q, by_v, _ = pin.computeRNEADerivatives(self.model, data, q[point], slope * speed[k], acceleration)
            mass = np.concatenate([data.M[:joint, joint], data.M[joint, joint:]])  # its upper triangle is filled
            found.q[point] += factors[k] * by_q[joint]
            found.slope[point] += factors[k] * (by_v[joint] * speed[k] + mass * binding.push[k])
            found.curvature[point] += factors[k] * mass * binding.square[k]
        return found

    def stretch(self, curve: Curve) -> float:
        """Compute it from samples at the rows and between them."""
        q, v, a = (evenly(curve.over_time(order)) for order in range(3))
        count = len(q)
        both = self.dynamics.torques(
            *(np.concatenate([each, rest]) for each, rest in ((q, q), (v, 0.0 * v), (a, 0.0 * a)))
        )
        moving, gravity = both[:count], both[count:]
        return float(self._stretch(moving - gravity, gravity).max(initial=0.0))

    def _stretch(self, moving: Array, gravity: Array) -> Array:
        """Return the k (m,) by which time must be stretched for |gravity + moving/k²| ≤ limit, each (m, n); 0 if
        gravity alone exceeds a limit, as no stretch helps then."""
        if self._too_heavy(gravity):
            return np.zeros(len(gravity))
        room = (1 - MARGIN) * self.limit - np.where(moving > 0.0, gravity, -gravity)
        stretch: Array = np.sqrt((np.abs(moving) / room).max(axis=1))
        return stretch

    def _too_heavy(self, gravity: Array) -> bool:
        """True if the gravity torques (m, n) alone leave next to nothing of a limit anywhere."""
        return bool((np.abs(gravity) > (1 - LEAST_MARGIN) * self.limit).any())


def evenly(curve: Curve) -> Array:
    """Return the values of a curve (2 N − 1, n) at its rows and half way between them."""
    weights = np.array([math.comb(curve.degree, i) for i in range(curve.degree + 1)]) / 2.0**curve.degree
    values = np.stack([curve.control[:, 0], np.einsum("d,kdn->kn", weights, curve.control)], axis=1)
    return np.concatenate([values.reshape(-1, values.shape[2]), curve.control[-1:, -1]])
