"""Clearance of body pairs: a squared hinge on their distance, at single configurations and at the samples of a motion.

In: the kinematics of samples. Out: the penalty with its exact gradient and Gauss-Newton curvature; the derivatives come
from the distance's hand-written wrench and the geometric Jacobian.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem import loops
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.second_order import by_joints
from hdplan.planner.problem.terms import Penalty, Term
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    from hdplan.distance.symbolic.closed import ClosedForm
    from hdplan.planner.problem.symbolic_place import SymbolicPlace


@dataclass(frozen=True)
class Inside:
    """The S body pairs that are inside their margin, samples ascending."""

    sample: Rows  # (S,)
    pair: Rows  # (S,) row of the term's pairs
    distance: Array  # (S,) D < 0 [m]
    separation: Array  # (S,) D̃ [m], a lower bound of the true distance less the margin
    gradient: Array  # (S, n) dD/dq


class PairTerm(Term):
    """A squared hinge on the distance of body pairs, ½ min(D, 0)².

    D is measured between bodies enlarged by clearance + activation. The penalty thus sets in at that distance, and the
    HD-SDF's flat spot, where its gradient vanishes, lies at the outer rim, where the penalty vanishes as well.
    """

    def __init__(
        self, name: str, pairs: BodyPairs, distance: PairDistance, pieces: Sequence[HalfspaceBody] = ()
    ) -> None:
        """Take the pairs and their distance; and the second bodies, where their sizes are to be parameters in
        symbols."""
        self.name, self.pairs, self.distance, self.pieces = name, pairs, distance, tuple(pieces)

    @property
    def functions(self) -> Mapping[str, Any]:
        """Functions of the distance."""
        return self.distance.functions

    def met(self, kinematics: KinematicsBatch, times: Array) -> KinematicsBatch:
        """The kinematics of configurations with the obstacles at times (B,) [s]: unchanged, as these obstacles
        stand."""
        return kinematics

    def inside(self, kinematics: KinematicsBatch) -> Inside:
        """Every pair with D < 0 at every sample."""
        sample, pair = self.pairs.close(kinematics)
        distance, wrench, separation = self.distance(kinematics, sample, pair)
        kept = np.flatnonzero(distance < 0)
        sample, pair = sample[kept], pair[kept]
        gradient = (kinematics.columns[sample] @ wrench[kept, :, None])[:, :, 0] * self.pairs.moves[pair]
        return Inside(sample, pair, distance[kept], separation[kept], gradient)

    @cached_property
    def record(self) -> Record | None:
        """The C struct `term`; None for a distance that has no loop of C."""
        shaping = self.distance.shaping
        return Record("term", self.pairs.tables, *shaping, self.pairs.moves) if shaping else None

    def _written(self, places: Sequence[SymbolicPlace]) -> ClosedForm:
        """The penalty of one configuration, or of one interval between two, in symbols."""
        from hdplan.planner.collision.growth import growths
        from hdplan.planner.problem.pair_symbols import clearance_form

        if not isinstance(self.distance, HdsdfPairs):
            raise InputError(f"form: {self.distance.how} is not written in symbols; allowed: external")
        shaped = self.distance.gamma, self.distance.shaping_length
        return clearance_form(places, self.pairs, growths(self.pieces), *shaped)

    def depth(self, kinematics: KinematicsBatch, parameter: Array | None = None) -> Array:
        """Depth that the worst pair may have inside its margin (B,) [m], the same all along the motion."""
        if self.record:
            return loops.penalties(self.record, kinematics, None).depth
        inside, result = self.inside(kinematics), np.zeros(len(kinematics.placements))
        np.maximum.at(result, inside.sample, -inside.separation)
        return result


class Clearance(PairTerm):
    """The clearance of body pairs at the samples of a motion: Σ_samples w_s Σ_pairs ½ min(D, 0)²."""

    def at_samples(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty:
        """The penalty at the samples of a motion."""
        weight, (batch, n) = samples.weight, kinematics.columns.shape[:2]
        if self.record:
            return loops.penalties(self.record, kinematics, weight)
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

    def written_at_sample(self, place: SymbolicPlace) -> ClosedForm:
        """Σ_pairs ½ min(D, 0)²."""
        return self._written([place])

    def second_order(self, kinematics: KinematicsBatch, samples: Samples) -> Array:
        """Σ_pairs w_s D ∇²D at the samples."""
        result = np.zeros(kinematics.columns.shape[:2] + kinematics.columns.shape[1:2])
        sample, pair = self.pairs.close(kinematics)
        distance, wrench, hessian = self.distance.with_hessian(kinematics, sample, pair)
        scale = samples.weight[sample] * np.minimum(distance, 0.0)
        kept = np.flatnonzero(scale)
        if len(kept):
            sample, pair, scale = sample[kept], pair[kept], scale[kept]
            each = by_joints(kinematics.columns[sample], self.pairs.moves[pair], wrench[kept], hessian[kept])
            starts = np.flatnonzero(np.diff(sample, prepend=-1))
            result[sample[starts]] = np.add.reduceat(scale[:, None, None] * each, starts)
        return result
