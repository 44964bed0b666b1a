"""The loops of one evaluation in C: the hinge on the distance of close pairs, summed at their samples, and sums over
samples carried back to waypoints.

`clearance` and `samples` have the same in NumPy, for machines without a compiler; the two agree but for rounding, as
sums are taken in another order.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.collision import close_pairs
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.exact import ExactPairs
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.planner.problem.terms import Penalty
from hdplan.scenes.array_types import Array, Rows


def penalties(
    loops: ModuleType, of: Record, kinematics: KinematicsBatch, weight: Array | None
) -> tuple[float, Array, Array, Array]:
    """Return the cost of a `term` at samples, its gradient (B, n) and curvature (B, n, n), and the depth (B,) [m];
    without weights (B,) only the depth, and 0 and empty arrays for the others."""
    batch, n = kinematics.columns.shape[:2]
    count = 0 if weight is None else batch
    gradient, curvature, depth = np.zeros((count, n)), np.zeros((count, n, n)), np.zeros(batch)
    cost = loops.penalties(
        *(of.struct, close_pairs.LEAST_SEPARATION, kinematics.placements, kinematics.columns, weight),
        *(gradient, curvature, depth),
    )
    return float(cost), gradient, curvature, depth


def term(pairs: BodyPairs, distance: HdsdfPairs | ExactPairs) -> Record:
    """The C struct of that name."""
    if isinstance(distance, ExactPairs):
        return Record("term", pairs.tables, 1, 0.0, distance.record, pairs.moves)
    return Record("term", pairs.tables, distance.gamma, distance.shaping_length, None, pairs.moves)


class AtSamples:
    """The penalties of terms of pairs at the samples of a robot's motion, and the kinematics there, in one call."""

    def __init__(
        self, kinematics: Kinematics, counts: Rows, fraction: Array, weight: Array, terms: Sequence[Record]
    ) -> None:
        """Take the constant part: samples as in `Samples`, and a `term` for each."""
        self.shape = len(weight), kinematics.n, kinematics.nj
        self.record = Record("motion", kinematics.tree, counts, fraction, weight, tuple(terms))

    def __call__(self, loops: ModuleType, positions: Array) -> tuple[KinematicsBatch, Penalty]:
        """Evaluate at waypoints (N, n)."""
        batch, n, joints = self.shape
        placements, columns = np.empty((batch, joints, 12)), np.empty((batch, n, 6))
        gradient, curvature, depth = np.zeros((batch, n)), np.zeros((batch, n, n)), np.zeros(batch)
        found = (placements, columns, gradient, curvature, depth)
        cost = loops.at_samples(
            self.record.struct, close_pairs.LEAST_SEPARATION, np.ascontiguousarray(positions), *found
        )
        return KinematicsBatch(placements, columns), Penalty(float(cost), gradient, curvature, depth)


def to_waypoints(
    loops: ModuleType, counts: Rows, fraction: Array, gradient: Array, curvature: Array
) -> tuple[Array, Array, Array]:
    """Return the result of `Samples.to_waypoints`."""
    intervals, n = len(counts), gradient.shape[1]
    slope, diagonal = np.zeros((intervals + 1, n)), np.zeros((intervals + 1, n, n))
    coupling = np.zeros((intervals, n, n))
    given = map(np.ascontiguousarray, (counts, fraction, gradient, curvature))
    loops.to_waypoints(*given, slope, diagonal, coupling)
    return slope, diagonal, coupling
