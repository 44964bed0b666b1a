"""The loops of one evaluation in C: the hinge on the distance of close pairs, summed at their samples, and sums over
samples carried back to waypoints.

`clearance` and `samples` have the same in NumPy, for machines without a compiler; the two agree but for rounding, as
sums are taken in another order.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C, Record
from hdplan.planner.collision.close_pairs import LEAST_SEPARATION
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.terms import Penalty
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.problem.problem import Problem
    from hdplan.planner.problem.samples import Samples


def penalties(of: Record, kinematics: KinematicsBatch, weight: Array | None) -> Penalty:
    """Penalty of a `term` at samples; without weights (B,) only the depth, 0 and empty arrays for the others."""
    batch, n = kinematics.columns.shape[:2]
    count = 0 if weight is None else batch
    found = np.zeros((count, n)), np.zeros((count, n, n)), np.zeros(batch)
    given = of.struct, LEAST_SEPARATION, kinematics.placements, kinematics.columns, weight
    return Penalty(C.penalties(*given, *found), *found)


def at_samples(problem: Problem, positions: Array) -> Penalty:
    """The penalties of terms of pairs, with the kinematics, in one call, and those of the other terms."""
    record, others = problem.loop
    batch, n, joints = len(problem.samples.weight), problem.kinematics.n, problem.kinematics.nj
    kinematics = KinematicsBatch(np.empty((batch, joints, 12)), np.empty((batch, n, 6)))
    found = np.zeros((batch, n)), np.zeros((batch, n, n)), np.zeros(batch)
    given = np.ascontiguousarray(positions), kinematics.placements, kinematics.columns
    total = Penalty(C.at_samples(record.struct, LEAST_SEPARATION, *given, *found), *found)
    return sum(filter(None, (term.at_samples(kinematics, problem.samples) for term in others)), total)


def to_waypoints(samples: Samples, gradient: Array, curvature: Array) -> tuple[Array, Array, Array]:
    """Gradient, diagonal and coupling blocks of the waypoints."""
    intervals, n = len(samples.counts), gradient.shape[1]
    slope, diagonal = np.zeros((intervals + 1, n)), np.zeros((intervals + 1, n, n))
    coupling = np.zeros((intervals, n, n))
    given = map(np.ascontiguousarray, (np.array(samples.counts), samples.fraction, gradient, curvature))
    C.to_waypoints(*given, slope, diagonal, coupling)
    return slope, diagonal, coupling
