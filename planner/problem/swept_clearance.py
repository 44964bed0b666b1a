"""Clearance between waypoints without samples: the hull of a link body at two consecutive waypoints, to an obstacle.

    h Σ_intervals Σ_pairs ½ min(D, 0)²,   D(q_k, q_{k+1}) of conv(A(q_k) ∪ A(q_{k+1})) and B,   h = 1/(N − 1)

In: the kinematics of the waypoints. Out: the penalty with its gradient at both ends of every interval, and Gauss-Newton
curvature with the block between them. The hull contains every straight-line motion from one placement to the other. A
turning link leaves it slightly between the two; that is for the certificate to find, as it is with samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.distance.symbolic.halfspaces import swept_halfspace_distance
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.clearance import Inside, PairTerm
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.second_order import by_joints
from hdplan.planner.problem.terms import MotionPenalty
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import made_once

if TYPE_CHECKING:
    import casadi as ca

    from hdplan.planner.problem.symbolic_place import SymbolicMotion


class SweptClearance(PairTerm):
    """The clearance of obstacles, swept over the intervals of a motion."""

    def __init__(
        self,
        name: str,
        pairs: BodyPairs,
        distance: PairDistance,
        gamma: int,
        shaping_length: float,
        pieces: Sequence[HalfspaceBody] = (),
    ) -> None:
        """Take pairs whose second bodies all stand in the world; compile the swept distance, or find it in the
        cache."""
        super().__init__(name, pairs, distance, pieces)
        self.gamma, self.shaping_length = gamma, shaping_length
        self.kernels = {count: self._kernel(count, 1) for count in sorted(pairs.plane_tables)}

    @property
    def functions(self) -> Mapping[str, Any]:
        """Functions of its distance at single configurations, and of the swept distance."""
        return {**super().functions, **{f"{count} planes, swept": run.function for count, run in self.kernels.items()}}

    def between(self, kinematics: KinematicsBatch) -> Inside:
        """Every pair with D < 0 on every interval between N configurations: `sample` is the interval, `gradient` (S, 2
        n) is with respect to the configurations at its start and its end."""
        interval, pair, (distance, *wrenches, separation) = self._rows(1, kinematics)
        gradient = [
            (kinematics.columns[interval + end] @ wrenches[end][..., None])[:, :, 0] * self.pairs.moves[pair]
            for end in (0, 1)
        ]
        return Inside(interval, pair, distance[:, 0], separation[:, 0], np.hstack(gradient))

    def _rows(self, order: int, kinematics: KinematicsBatch) -> tuple[Rows, Rows, list[Array]]:
        """The intervals and pairs (S,) with D < 0, and the outputs of `swept_halfspace_distance`."""
        interval, pair = self.pairs.close_between(kinematics)
        joints = kinematics.placements.shape[1]
        placements = kinematics.placements.reshape(-1, 12)  # row of waypoint k and joint j: k·joints + j
        slots = self.pairs.plane_slots[pair]
        results = [np.zeros((len(pair), width)) for width in (1, 6, 6, 1, 144)[: order + 3]]
        for count in self.kernels:
            chosen = np.flatnonzero(slots == count)
            p = pair[chosen]
            first = interval[chosen] * joints
            found = self._kernel(count, order)(
                [placements, placements, placements, self.pairs.body_table, self.pairs.plane_tables[count]],
                [
                    first + self.pairs.joint_a[p],
                    first + joints + self.pairs.joint_a[p],
                    first,  # joint 0, the world
                    self.pairs.body[p],
                    self.pairs.plane_row[p],
                ],
            )
            for result, values in zip(results, found, strict=True):
                result[chosen] = values
        kept = np.flatnonzero(results[0][:, 0] < 0)
        return interval[kept], pair[kept], [result[kept] for result in results]

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

    def written_over_motion(self, motion: SymbolicMotion) -> ca.MX:
        """h Σ_intervals Σ_pairs ½ min(D, 0)²."""
        import casadi as ca

        from hdplan.planner.problem.closed_sum import closed_sum

        count, places = motion.first.shape[1], motion.ends()
        each = closed_sum("intervals", places, self._written(places), np.full(count, 1 / count))
        ends = motion.first, motion.first + motion.step
        return each(*ends, ca.repmat(motion.frames, 1, count))

    def second_order(self, kinematics: KinematicsBatch, samples: Samples) -> None:
        """Zero: the term has no part at the samples."""

    def second_order_over_motion(self, positions: Array, kinematics: Kinematics) -> tuple[Array, Array]:
        """h Σ_pairs D ∇²D: both ends of an interval by themselves, and the block between them."""
        count, n = positions.shape
        diagonal, coupling = np.zeros((count, n, n)), np.zeros((count - 1, n, n))
        placed = kinematics.evaluate(positions)
        interval, pair, (distance, *wrenches, _, hessian) = self._rows(2, placed)
        blocks, moves = hessian.reshape(-1, 2, 6, 2, 6), self.pairs.moves[pair]
        columns = [placed.columns[interval + end] for end in (0, 1)]
        scale = distance[:, :, None] / (count - 1)
        for end in (0, 1):
            within = by_joints(columns[end], moves, wrenches[end], blocks[:, end, :, end])
            np.add.at(diagonal, interval + end, scale * within)
        first, second = (each * moves[..., None] for each in columns)
        np.add.at(coupling, interval, scale * (second @ blocks[:, 1, :, 0] @ first.swapaxes(1, 2)))
        return diagonal, coupling

    def _kernel(self, count: int, order: int) -> RowFunction:
        return _kernel(self.pairs.vertex_slots, count, self.gamma, self.shaping_length, order)


@made_once(64)
def _kernel(vertices: int, planes: int, gamma: int, shaping_length: float, order: int) -> RowFunction:
    return RowFunction(swept_halfspace_distance(vertices, planes, gamma, shaping_length, order))
