"""The effects of a problem, one class each: smoothness over the whole motion, clearance at sampled configurations.

`Term` is what every effect but smoothness looks like. In: waypoints, or the kinematics of samples. Out: a cost, its
exact gradient and a positive semidefinite curvature (Gauss-Newton; for smoothness the exact Hessian). The derivatives
come from the distance's hand-written wrench and the geometric Jacobian.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.samples import Samples

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Smoothness:
    """CHOMP's prior: squared velocity and acceleration of the motion over a duration of one, by finite differences.

        ½ Σ_k h |(q_{k+1} − q_k)/h|² + ½ α Σ_k h |(q_{k+1} − 2 q_k + q_{k−1})/h²|²,  h = 1/(N − 1)

    Velocity makes the motion short and even, acceleration bends it gently. Ratliff et al., CHOMP, ICRA 2009, section
    II.
    """

    waypoints: int  # N
    acceleration: float = 0.01  # α, relative to the squared duration

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
class MotionPenalty:
    """A penalty on a whole motion of N waypoints."""

    cost: float
    gradient: Floats  # (N, n)
    diagonal: Floats  # (N, n, n) Gauss-Newton curvature of each waypoint
    coupling: Floats  # (N − 1, n, n) of q_{k+1} (rows) with q_k
    depth: Floats  # (N − 1,) how far the worst may be inside its margin on the interval, 0 if nothing is [m]


@dataclass(frozen=True)
class Inside:
    """The S body pairs that are inside their margin, samples ascending."""

    sample: NDArray[np.int64]  # (S,)
    pair: NDArray[np.int64]  # (S,) row of the term's pairs
    distance: Floats  # (S,) D < 0 [m]
    separation: Floats  # (S,) D̃ [m], a lower bound of the true distance less the margin
    gradient: Floats  # (S, n) dD/dq


class Term(Protocol):
    """An effect that a scene calls for: a penalty on configurations along the motion."""

    @property
    def name(self) -> str:
        """What the user calls it."""
        ...

    def value(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty:
        """The penalty at the samples of a motion, with their weights."""
        ...

    def depth(self, kinematics: KinematicsBatch, time: Floats | None = None) -> Floats:
        """How far each of B configurations may be inside the margin (B,) [m], 0 if it is not; of no particular time, or
        at path parameters `time` (B,)."""
        ...


class MotionTerm:
    """An effect on the motion between waypoints, not on configurations along it."""

    name: str

    def over_motion(self, positions: Floats, kinematics: KinematicsBatch) -> MotionPenalty:
        """The penalty of a motion through waypoints (N, n), and their kinematics."""
        raise NotImplementedError

    def depth(self, kinematics: KinematicsBatch, time: Floats | None = None) -> Floats:
        """How far single configurations may be inside the margin (B,) [m]: nothing, unless the effect is one on them
        too."""
        return np.zeros(len(kinematics.placements))


class Clearance:
    """Squared hinge on the distance of body pairs: Σ_samples w_s Σ_pairs ½ min(D, 0)².

    D is taken to bodies enlarged by clearance + activation, so that the penalty sets in that far away and the HD-SDF's
    flat spot, where its gradient fades, lies at the outer rim, where the penalty fades as well.
    """

    def __init__(self, name: str, pairs: BodyPairs, distance: PairDistance) -> None:
        """Take the pairs and their distance."""
        self.name, self.pairs, self.distance = name, pairs, distance

    def inside(self, kinematics: KinematicsBatch) -> Inside:
        """Every pair with D < 0 at every sample."""
        sample, pair = self.pairs.close(kinematics)
        distance, wrench, separation = self.distance(kinematics, sample, pair)
        kept = np.flatnonzero(distance < 0)
        sample, pair = sample[kept], pair[kept]
        gradient = (kinematics.columns[sample] @ wrench[kept, :, None])[:, :, 0] * self.pairs.moves[pair]
        return Inside(sample, pair, distance[kept], separation[kept], gradient)

    def depth(self, kinematics: KinematicsBatch, time: Floats | None = None) -> Floats:
        """How far the worst pair may be inside its margin (B,) [m], the same at any time."""
        inside, result = self.inside(kinematics), np.zeros(len(kinematics.placements))
        np.maximum.at(result, inside.sample, -inside.separation)
        return result

    def value(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty:
        """The penalty at the samples of a motion."""
        weight, (batch, n) = samples.weight, kinematics.columns.shape[:2]
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
