"""A penalty on joint velocities near their limits, for motions whose time law is fixed.

Where obstacles move, the time law u(t) is chosen before the motion. The joint velocities between waypoints then follow
from the waypoints and the largest du/dt on each interval. For joint j on interval k, the share of its limit v_j

    s_kj = |q_{k+1,j} − q_{k,j}| (N − 1) max_k(du/dt) / v_j

is kept below PENALIZED_SHARE by  h Σ_kj ½ (LEVER max(s_kj − PENALIZED_SHARE, 0))²,  h = 1/(N − 1), quadratic where it
acts: the curvature is exact. Elsewhere the timing is fitted to the limits afterwards (`retiming`), and this term is
absent.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.terms import MotionPenalty, Term
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.time_laws import MinimumJerk
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    import casadi as ca

    from hdplan.planner.problem.symbolic_place import SymbolicMotion

PENALIZED_SHARE = 0.85  # share of a limit above which the penalty acts
LEVER = 0.06  # [m] depth inside a margin that exceeding a limit by 100 % counts as
LOOKS = 9  # points of every interval at which the time law is evaluated


def velocity_penalty(setup: Setup) -> VelocityPenalty:
    """Return the term of a scene with `timing.duration`. Raises InputError for limits that do not fit the robot."""
    scene, most = setup.scene, np.full(setup.robot.model.nv, np.inf)  # of what follows: in the others' limits already
    most[setup.robot.coordinates] = setup.limits["velocity"]
    return VelocityPenalty(most, MinimumJerk(scene.end_time), scene.planner.waypoints)


class VelocityPenalty(Term):
    """The joints' velocities on the intervals between N waypoints."""

    name = "velocity"

    def __init__(self, limits: Array, law: MinimumJerk, waypoints: int) -> None:
        """Take limits (n,) [rad/s] or [m/s]."""
        edges = np.linspace(0.0, 1.0, waypoints)
        looks = edges[:-1, None] + np.linspace(0.0, 1.0, LOOKS) * np.diff(edges)[:, None]
        steepest = law(law.time_at(looks.ravel()))[1].reshape(looks.shape).max(axis=1)  # (N − 1,) du/dt [1/s]
        self.shares = (waypoints - 1) * steepest[:, None] / limits  # (N − 1, n) of a limit, per unit of a joint's step

    def over_motion(self, positions: Array, kinematics: Kinematics) -> MotionPenalty:
        """The penalty of waypoints (N, n)."""
        count, n = positions.shape
        step = np.diff(positions, axis=0)
        beyond = LEVER * np.maximum(np.abs(step) * self.shares - PENALIZED_SHARE, 0.0)  # (N − 1, n) [m]
        weight, slope = 1 / (count - 1), LEVER * self.shares
        push = weight * beyond * slope * np.sign(step)
        gradient = np.zeros((count, n))
        gradient[1:] += push
        gradient[:-1] -= push
        second_order = np.where(beyond > 0.0, weight * slope**2, 0.0)[:, :, None] * np.eye(n)
        diagonal = np.zeros((count, n, n))
        diagonal[1:] += second_order
        diagonal[:-1] += second_order
        return MotionPenalty(
            0.5 * weight * float(np.sum(beyond**2)), gradient, diagonal, -second_order, beyond.max(axis=1)
        )

    def written_over_motion(self, motion: SymbolicMotion) -> ca.MX:
        """h Σ ½ (LEVER max(s − PENALIZED_SHARE, 0))²."""
        import casadi as ca

        beyond = LEVER * ca.fmax(ca.fabs(motion.step) * ca.DM(self.shares.T) - PENALIZED_SHARE, 0.0)
        return ca.sumsqr(beyond) / (2 * motion.step.shape[1])

    def second_order(self, kinematics: KinematicsBatch, samples: Samples) -> None:
        """Zero: the curvature is exact."""
