"""Path speed of a motion: the cost that makes it quick where joint velocities are limited.

A step d takes joint j at least |d_j|/v_j, and all joints together the largest of these. So a path through waypoints q_k
takes at least Σ_k max_j |q_{k+1,j} − q_{k,j}|/v_j, whatever its timing; the joints that are not the slowest may go a
longer way for nothing. In place of the largest stands the p-norm, which has derivatives, and, as in the smoothness,
squares, which keep the steps even:

    ½ V² Σ_k h ‖x_k‖_p²,   x_kj = (q_{k+1,j} − q_{k,j}) / (h v_j),   h = 1/(N − 1),   p = 16

It is convex. V², the mean of v_j², gives it the size of the smoothness. For n joints the p-norm exceeds the largest by
a factor of at most n^(1/p), 1.13 for seven.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C, twin_of
from hdplan.planner.problem.terms import MotionPenalty
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    import casadi as ca

P = 16  # of the norm
FASTEST_JOINT = 1e6  # [rad/s] or [m/s] the largest limit that a scene may give; a URDF's larger one counts as none


def _value(path_speed: PathSpeed, positions: Array) -> MotionPenalty:
    count, n = positions.shape
    gradient, diagonal, coupling = np.zeros((count, n)), np.zeros((count, n, n)), np.zeros((count - 1, n, n))
    cost = C.path_speed(np.ascontiguousarray(positions), path_speed.shares, gradient, diagonal, coupling)
    return MotionPenalty(float(cost), gradient, diagonal, coupling, np.zeros(count - 1))


@dataclass(frozen=True, eq=False)
class PathSpeed:
    """The cost of the steps between waypoints."""

    limits: Array  # (n,) v [rad/s] or [m/s]; at least one is not above FASTEST_JOINT

    @cached_property
    def shares(self) -> Array:
        """V/v_j (n,), 0 for a joint without a limit."""
        return np.where(self.limits <= FASTEST_JOINT, np.sqrt(self.mean_square) / self.limits, 0.0)

    @property
    def mean_square(self) -> float:
        """V² [(rad/s)² or (m/s)²]."""
        return float(np.mean(self.limits[self.limits <= FASTEST_JOINT] ** 2))

    @twin_of(_value)
    def value(self, positions: Array) -> MotionPenalty:
        """Cost, gradient and Hessian, which is exact, at waypoints (N, n); its depth is 0."""
        count, n = positions.shape
        gradient, diagonal = np.zeros((count, n)), np.zeros((count, n, n))
        x = np.diff(positions, axis=0) * self.shares
        size = np.abs(x)
        largest = size.max(axis=1, keepdims=True)
        ratio = np.divide(size, largest, out=np.ones_like(size), where=largest > 0.0)  # keeps powers within range
        square = ratio * ratio
        fourth = square * square
        slender = fourth * fourth * fourth * square  # the power P − 2, by products: pow takes ten times as long
        total = (slender * square).sum(axis=1, keepdims=True)
        length = largest * total ** (1 / P)  # (N − 1, 1) ‖x‖_p, times h
        direction = slender * ratio * np.sign(x)
        outer = total ** (2 / P - 1)
        slope = (count - 1) * largest * outer * direction * self.shares
        second_order = (2 - P) / total[..., None] * direction[:, :, None] * direction[:, None, :]
        second_order[:, range(n), range(n)] += (P - 1) * slender
        second_order *= (count - 1) * outer[..., None] * self.shares[:, None] * self.shares
        gradient[1:] += slope
        gradient[:-1] -= slope
        diagonal[1:] += second_order
        diagonal[:-1] += second_order
        return MotionPenalty(
            0.5 * (count - 1) * float(np.sum(length**2)), gradient, diagonal, -second_order, np.zeros(count - 1)
        )

    def expression(self, steps: ca.MX) -> ca.MX:
        """The path speed as an expression of the steps (n, N − 1) between waypoints."""
        import casadi as ca

        square = (steps * self.shares) ** 2 + 1e-18  # the norm has no second derivative where nothing moves
        return 0.5 * steps.shape[1] * ca.sum2(ca.sum1(square ** (P // 2)) ** (2 / P))
