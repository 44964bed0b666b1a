"""Smoothness of a motion: the cost that keeps it short and its bends gentle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.scenes.array_types import Array


@dataclass(frozen=True)
class Smoothness:
    """CHOMP's prior: squared velocity and acceleration of the motion over a duration of one, by finite differences.

        ½ β Σ_k h |(q_{k+1} − q_k)/h|² + ½ α Σ_k h |(q_{k+1} − 2 q_k + q_{k−1})/h²|²,  h = 1/(N − 1)

    The velocity makes the motion short and even, the acceleration makes its bends gentle; β is 1 but where the
    `PathSpeed` of a motion counts. Ratliff et al., CHOMP, ICRA
    2009, section II.
    """

    waypoints: int  # N
    acceleration: float  # α, relative to the squared duration
    velocity: float = 1.0  # β

    @cached_property
    def matrix(self) -> Array:
        """The Hessian M (N, N), the same for every joint: the cost is ½ Σ_j q_jᵀ M q_j."""
        h = 1 / (self.waypoints - 1)
        first = np.diff(np.eye(self.waypoints), axis=0)
        second = np.diff(first, axis=0)
        matrix: Array = self.velocity * first.T @ first / h + self.acceleration * second.T @ second / h**3
        return matrix

    @cached_property
    def diagonals(self) -> Array:
        """Diagonals 0, 1 and 2 of M without the ends (3, N − 2), each beginning at its first column."""
        inner = self.matrix[1:-1, 1:-1]
        rows = [np.diagonal(inner, offset) for offset in range(3)]
        return np.array([np.pad(row, (0, len(inner) - len(row))) for row in rows])

    def value(self, positions: Array) -> tuple[float, Array]:
        """Cost and gradient (N, n) at waypoints (N, n)."""
        gradient = self.matrix @ positions
        return float(0.5 * np.sum(positions * gradient)), gradient
