"""The rows of the controller's program: the constraint of every pair of bodies on the velocity u of the next period.

Where the robot would come to rest if it braked now, q_s at t_s, a pair with distance Δ and margin δ asks, by its
derivatives there,

    g · (u − u_b) + ∂Δ/∂t ≥ −η (Δ − δ),        g_j = w_j ∂Δ/∂q_j,   w_j = ∂q_s,j/∂u_j / T,

with u_b the velocity that begins to brake: the barrier is one of the places where the robot can come to rest
(backup barriers: Gurriet et al., "An online approach to active set invariance", CDC 2018). u_b keeps it for ever, if
the obstacle stands still. A robot whose accelerations have no limit stops at once: then q_s = q, u_b = 0, w = 1.

w_j grows with the speed of a joint, from 1 to over 100, and jumps where its acceleration changes sign: along such rows
alone commands shake at the greatest jerk. So every pair also asks at q, with w = 1 and u_b = 0, for

    ∂Δ/∂q · u + ∂Δ/∂t ≥ −η (Δ − δ),

and outside of its margin η is `sight.AT_REST` times as large at q_s: there the row only acts where a robot is too fast
to follow that at q. It guarantees Δ ≥ δ at any rate; the row at q has no floor.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hdplan.planner.control.moment import BarrierRows
from hdplan.planner.control.quadratic_program import SoftConstraints
from hdplan.scenes.array_types import Array, Mask, Rows

NEAR_DISTANCE = 0.01  # [m] below which the exact distance of a pair that is inside its margin must not fall
MOVING_WEIGHT = 1e3  # [s/m] of violations for moving obstacles
RECOVERY_WEIGHT = 30.0  # [s/m or s] of violations for recovery to a margin
NEAR_MOVING = 0.01  # [m] from a moving obstacle, below which its weight is constant


class BarrierConstraint(NamedTuple):
    """Rows of m pairs."""

    pairs: Rows  # (m,)
    rows: BarrierRows  # their distances and derivatives
    slack: Array  # (m,) Δ − δ [m]
    rates: Array  # (m,) η of each [1/s]
    free: Mask  # (m,) which may fall: pairs with what moves, and those that overlap (`sight`)


def pair_constraints(constraint: BarrierConstraint, gains: Array, base: Array, coming: Mask) -> SoftConstraints:
    """Return rows for the velocity, by `gains` w (n,) and `base` u_b (n,); coming (m,): pairs with what moves, which
    have a weight that grows as they come closer. Those that are not free at least get no worse than by braking."""
    matrix = constraint.rows.gradient * gains
    begun = matrix @ base
    target = begun - constraint.rates * constraint.slack - constraint.rows.drift
    floor = np.where(constraint.free, -np.inf, np.minimum(target, begun))
    urgency = NEAR_MOVING / np.maximum(constraint.rows.separation, NEAR_MOVING)
    return SoftConstraints(matrix, target, floor, np.where(coming, MOVING_WEIGHT * urgency, RECOVERY_WEIGHT))


def joint_constraints(beyond: Array, above: Mask, fastest: Array, base: Array) -> SoftConstraints:
    """Return rows that bring joints back which are outside their limits, by `beyond` (n,) > 0 [rad/s or m/s], on the
    side `above` (n,)."""
    joints = np.flatnonzero(beyond > 0.0)
    matrix = np.eye(len(beyond))[joints] * np.where(above, -1.0, 1.0)[joints, None]
    target = np.minimum(beyond, fastest)[joints]
    return SoftConstraints(matrix, target, np.minimum(target, matrix @ base), np.full(len(joints), RECOVERY_WEIGHT))
