"""How fast the joints go where the time law is fixed: a penalty on what comes close to their limits of velocity.

Where obstacles move, when a waypoint is reached is known beforehand, u(t), and with it the joints' velocities between
waypoints, by the steepest du/dt there. Of each joint j and interval k the share of its limit v_j

    s_kj = |q_{k+1,j} − q_{k,j}| (N − 1) max_k(du/dt) / v_j

is kept below AIM by  h Σ_kj ½ (LEVER max(s_kj − AIM, 0))²,  h = 1/(N − 1), quadratic where it acts: the curvature is
exact. Elsewhere the time law is fitted to the limits afterwards (`retiming`), and this term is not there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.terms import MotionPenalty, MotionTerm
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.time_laws import MinimumJerk

Floats = NDArray[np.float64]

AIM = 0.85  # share of a limit from which on the penalty acts
LEVER = 0.06  # [m] that a whole limit too much counts as, beside bodies inside their margins
LOOKS = 9  # at the law on every interval


def pace(setup: Setup) -> Pace:
    """Return the term of a scene with `timing.duration`. Raises InputError for limits that do not fit the robot."""
    scene = setup.scene
    return Pace(setup.limits["velocity"], MinimumJerk(scene.end_time), scene.planner.waypoints)


class Pace(MotionTerm):
    """The joints' velocities on the intervals between N waypoints."""

    name = "pace"

    def __init__(self, limits: Floats, law: MinimumJerk, waypoints: int) -> None:
        """Take limits (n,) [rad/s] or [m/s]."""
        edges = np.linspace(0.0, 1.0, waypoints)
        looks = edges[:-1, None] + np.linspace(0.0, 1.0, LOOKS) * np.diff(edges)[:, None]
        pace = law(law.time_at(looks.ravel()))[1].reshape(looks.shape).max(axis=1)  # (N − 1,) [1/s]
        self.shares = (waypoints - 1) * pace[:, None] / limits  # (N − 1, n) of the limits, per unit of a joint's step

    def over_motion(self, positions: Floats, kinematics: KinematicsBatch) -> MotionPenalty:
        """The penalty of waypoints (N, n)."""
        count, n = positions.shape
        step = np.diff(positions, axis=0)
        beyond = LEVER * np.maximum(np.abs(step) * self.shares - AIM, 0.0)  # (N − 1, n) [m]
        weight, slope = 1 / (count - 1), LEVER * self.shares
        push = weight * beyond * slope * np.sign(step)
        gradient = np.zeros((count, n))
        gradient[1:] += push
        gradient[:-1] -= push
        bend = np.where(beyond > 0.0, weight * slope**2, 0.0)[:, :, None] * np.eye(n)
        diagonal = np.zeros((count, n, n))
        diagonal[1:] += bend
        diagonal[:-1] += bend
        return MotionPenalty(0.5 * weight * float(np.sum(beyond**2)), gradient, diagonal, -bend, beyond.max(axis=1))
