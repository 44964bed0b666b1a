"""The effects of a problem, one class each: smoothness over the whole motion, clearance at sampled configurations.

In: waypoints, or the kinematics of samples. Out: a cost, its exact gradient and a positive semidefinite curvature
(Gauss-Newton; for smoothness the exact Hessian). The derivatives come from the distance's hand-written wrench and the
geometric Jacobian.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.compiled import RowFunction
from hdplan.distance.halfspaces import halfspace_distance
from hdplan.planner.kinematics import KinematicsBatch
from hdplan.planner.pairs import BodyPairs
from hdplan.scenes.model import PlannerSettings

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Smoothness:
    """CHOMP's prior: squared velocity and acceleration of the motion over a duration of one, by finite differences.

        ½ Σ_k h |(q_{k+1} − q_k)/h|² + ½ α Σ_k h |(q_{k+1} − 2 q_k + q_{k−1})/h²|²,  h = 1/(N − 1)

    Velocity makes the motion short and even, acceleration bends it gently. Ratliff et al., CHOMP, ICRA 2009, section
    II.
    """

    waypoints: int  # N
    acceleration: float = 0.002  # α, relative to the squared duration

    @cached_property
    def matrix(self) -> Floats:
        """The Hessian M (N, N), the same for every joint: the cost is ½ Σ_j q_jᵀ M q_j."""
        h = 1 / (self.waypoints - 1)
        first = np.diff(np.eye(self.waypoints), axis=0)
        second = np.diff(first, axis=0)
        matrix: Floats = first.T @ first / h + self.acceleration * second.T @ second / h**3
        return matrix

    def value(self, positions: Floats) -> tuple[float, Floats]:
        """Cost and gradient (N, n) at waypoints (N, n)."""
        gradient = self.matrix @ positions
        return float(0.5 * np.sum(positions * gradient)), gradient


@dataclass(frozen=True)
class Penalty:
    """A penalty at B samples."""

    cost: float
    gradient: Floats  # (B, n) with respect to the samples' configurations
    curvature: Floats  # (B, n, n) Gauss-Newton
    depth: Floats  # (B,) how far the worst pair may be inside its margin, 0 if none is [m]


@dataclass(frozen=True)
class Inside:
    """The S body pairs that are inside their margin, samples ascending."""

    sample: NDArray[np.int64]  # (S,)
    pair: NDArray[np.int64]  # (S,) row of the term's pairs
    distance: Floats  # (S,) D < 0 [m]
    separation: Floats  # (S,) D̃ [m], a lower bound of the true distance less the margin
    gradient: Floats  # (S, n) dD/dq


class Clearance:
    """Squared hinge on the HD-SDF of body pairs: Σ_samples w_s Σ_pairs ½ min(D, 0)².

    D is taken to bodies enlarged by clearance + activation, so that the penalty sets in that far away and D's flat
    spot, where its gradient fades, lies at the outer rim, where the penalty fades as well.
    """

    def __init__(self, name: str, pairs: BodyPairs, kernels: dict[int, RowFunction]) -> None:
        """Take the pairs and, for each number of plane slots among them, the distance."""
        self.name = name
        self.pairs = pairs
        self.kernels = kernels

    @classmethod
    def of(cls, name: str, pairs: BodyPairs, settings: PlannerSettings) -> Clearance:
        """Take the pairs with the distance that the settings ask for, compiled or from the cache."""
        slots, counts = (pairs.body_table.shape[1] - 1) // 4, sorted(set(pairs.plane_slots.tolist()))
        kernels = {count: _kernel(slots, count, settings.gamma, settings.shaping_length) for count in counts}
        return cls(name, pairs, kernels)

    def inside(self, kinematics: KinematicsBatch) -> Inside:
        """Every pair with D < 0 at every sample."""
        batch, joints = kinematics.translations.shape[:2]
        sample, pair = self.pairs.close(kinematics)
        placements = np.concatenate([kinematics.rotations.reshape(batch, joints, 9), kinematics.translations], axis=2)
        placements = placements.reshape(batch * joints, 12)  # row of sample s and joint j: s·joints + j
        distance, separation, wrench = np.zeros(len(pair)), np.zeros(len(pair)), np.zeros((len(pair), 6))
        slots = self.pairs.plane_slots[pair]
        for count, kernel in self.kernels.items():
            chosen = np.flatnonzero(slots == count)
            if len(chosen) == 0:
                continue
            s, p = sample[chosen], pair[chosen]
            values, wrenches, separations = kernel(
                [placements, placements, self.pairs.body_table, self.pairs.plane_tables[count]],
                [
                    s * joints + self.pairs.joint_a[p],
                    s * joints + self.pairs.joint_b[p],
                    self.pairs.body[p],
                    self.pairs.plane_row[p],
                ],
            )
            distance[chosen], wrench[chosen], separation[chosen] = values[:, 0], wrenches, separations[:, 0]
        kept = np.flatnonzero(distance < 0)
        columns = np.concatenate([kinematics.linear, kinematics.angular], axis=2)[sample[kept]]  # (S, n, 6)
        gradient = np.einsum("snw,sw->sn", columns, wrench[kept]) * self.pairs.moves[pair[kept]]
        return Inside(sample[kept], pair[kept], distance[kept], separation[kept], gradient)

    def value(self, kinematics: KinematicsBatch, weight: Floats) -> Penalty:
        """The penalty at samples of weight (B,)."""
        batch, n = kinematics.linear.shape[:2]
        inside = self.inside(kinematics)
        sample, slope = inside.sample, inside.gradient
        scale = weight[sample] * inside.distance
        gradient, curvature, depth = np.zeros((batch, n)), np.zeros((batch, n, n)), np.zeros(batch)
        if len(sample):
            starts = np.flatnonzero(np.diff(sample, prepend=-1))
            seen = sample[starts]
            gradient[seen] = np.add.reduceat(scale[:, None] * slope, starts)
            outer = weight[sample][:, None, None] * slope[:, :, None] * slope[:, None, :]
            curvature[seen] = np.add.reduceat(outer, starts)
            depth[seen] = np.maximum.reduceat(-inside.separation, starts)
        return Penalty(float(0.5 * np.sum(scale * inside.distance)), gradient, curvature, depth)


@functools.cache
def _kernel(vertices: int, planes: int, gamma: int, shaping_length: float) -> RowFunction:
    return RowFunction(halfspace_distance(vertices, planes, gamma, shaping_length))
