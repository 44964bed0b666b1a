"""Clearance between waypoints without samples: the hull of a link body at two consecutive waypoints, to an obstacle.

    h Σ_intervals Σ_pairs ½ min(D, 0)²,   D(q_k, q_{k+1}) of conv(A(q_k) ∪ A(q_{k+1})) and B,   h = 1/(N − 1)

In: the kinematics of the waypoints. Out: the penalty with its gradient at both ends of every interval, and Gauss-Newton
curvature with the block between them. The hull contains every straight-line motion from one placement to the other. A
link that turns leaves it slightly in between; that is for the certificate to find, as it is with samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdplan.distance.symbolic.halfspaces import swept_halfspace_distance
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.clearance import Inside, PairTerm
from hdplan.planner.problem.terms import MotionPenalty
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import made_once


class SweptClearance(PairTerm):
    """The clearance of obstacles, swept over the intervals of a motion."""

    def __init__(self, name: str, pairs: BodyPairs, distance: PairDistance, gamma: int, shaping_length: float) -> None:
        """Take pairs whose second bodies all stand in the world; compile the swept distance, or find it in the
        cache."""
        super().__init__(name, pairs, distance)
        slots = pairs.vertex_slots
        self.kernels = {count: _kernel(slots, count, gamma, shaping_length) for count in sorted(pairs.plane_tables)}

    @property
    def functions(self) -> Mapping[str, Any]:
        """Those of its distance at single configurations, and of the swept distance."""
        return {**super().functions, **{f"{count} planes, swept": run.function for count, run in self.kernels.items()}}

    def between(self, kinematics: KinematicsBatch) -> Inside:
        """Every pair with D < 0 on every interval between N configurations: `sample` is the interval, `gradient` (S, 2
        n) is with respect to the configurations at its start and its end."""
        interval, pair = self.pairs.close_between(kinematics)
        joints = kinematics.placements.shape[1]
        placements = kinematics.placements.reshape(-1, 12)  # row of waypoint k and joint j: k·joints + j
        slots = self.pairs.plane_slots[pair]
        distance, separation = np.zeros(len(pair)), np.zeros(len(pair))
        wrenches = np.zeros((2, len(pair), 6))
        for count, kernel in self.kernels.items():
            chosen = np.flatnonzero(slots == count)
            p = pair[chosen]
            first = interval[chosen] * joints
            found = kernel(
                [placements, placements, placements, self.pairs.body_table, self.pairs.plane_tables[count]],
                [
                    first + self.pairs.joint_a[p],
                    first + joints + self.pairs.joint_a[p],
                    first,  # joint 0, the world
                    self.pairs.body[p],
                    self.pairs.plane_row[p],
                ],
            )
            distance[chosen], separation[chosen] = found[0][:, 0], found[3][:, 0]
            wrenches[:, chosen] = found[1:3]
        kept = np.flatnonzero(distance < 0)
        interval, pair = interval[kept], pair[kept]
        gradient = [
            (kinematics.columns[interval + end] @ wrenches[end, kept, :, None])[:, :, 0] * self.pairs.moves[pair]
            for end in (0, 1)
        ]
        return Inside(interval, pair, distance[kept], separation[kept], np.hstack(gradient))

    def over_motion(self, positions: Array, kinematics: Kinematics) -> MotionPenalty:
        """The penalty over a motion through N waypoints."""
        count, n = positions.shape
        inside = self.between(kinematics.evaluate(positions))
        weight, slope = 1 / (count - 1), inside.gradient
        gradient, diagonal = np.zeros((count, n)), np.zeros((count, n, n))
        coupling, depth = np.zeros((count - 1, n, n)), np.zeros(count - 1)
        if len(inside.sample):
            starts = np.flatnonzero(np.diff(inside.sample, prepend=-1))
            k = inside.sample[starts]
            push = np.add.reduceat(weight * inside.distance[:, None] * slope, starts)
            outer = np.add.reduceat(weight * slope[:, :, None] * slope[:, None, :], starts)
            gradient[k] = push[:, :n]
            gradient[k + 1] += push[:, n:]
            diagonal[k] = outer[:, :n, :n]
            diagonal[k + 1] += outer[:, n:, n:]
            coupling[k] = outer[:, n:, :n]
            depth[k] = np.maximum.reduceat(-inside.separation, starts)
        return MotionPenalty(0.5 * weight * float(np.sum(inside.distance**2)), gradient, diagonal, coupling, depth)


@made_once(64)
def _kernel(vertices: int, planes: int, gamma: int, shaping_length: float) -> RowFunction:
    return RowFunction(swept_halfspace_distance(vertices, planes, gamma, shaping_length))
