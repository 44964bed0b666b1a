"""The HD-SDF of many body pairs at many samples: the planner's own distance, in C or, without a compiler, in CasADi's
interpreter.

A lower bound in sign, an approximation in value: see `hdplan.distance.symbolic.halfspaces`, whose function is the
definition. The loop in C has the same equations by hand and is several times as fast: one plane after another lies in
memory, so that every step of the sums runs over planes in the widest vectors of the processor; roots are found without
`pow`; and numbers of vertices and planes are arguments, so that no robot and no obstacle needs a compilation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hdplan.distance.compiled.loops import C, Record, twin_of
from hdplan.distance.symbolic.halfspaces import halfspace_distance
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.collision.broad_phase import BodyPairs
from hdplan.planner.collision.pair_distance import PairDistance
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import made_once


def _hdsdf_rows(hdsdf: HdsdfPairs, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
    found = distance, wrench, separation = np.empty(len(pair)), np.empty((len(pair), 6)), np.empty(len(pair))
    rows = (np.ascontiguousarray(each, np.int64) for each in (sample, pair))
    given = hdsdf.pairs.tables.struct, hdsdf.gamma, hdsdf.shaping_length, kinematics.placements, *rows
    C.hdsdf_rows(*given, *found)
    return distance, wrench, separation


class HdsdfPairs(PairDistance):
    """D of the pairs' bodies, the halfspace bodies enlarged by the margin."""

    def __init__(self, pairs: BodyPairs, gamma: int, shaping_length: float) -> None:
        """Take the pairs; the distance is compiled when it is first needed."""
        self.pairs, self.gamma, self.shaping_length = pairs, gamma, shaping_length

    @property
    def how(self) -> str:
        """Compiled or interpreted."""
        return f"HD-SDF, {'compiled C' if C else 'by CasADi’s interpreter: no C compiler'}"

    @property
    def shaping(self) -> tuple[int, float, Record | None] | None:
        """γ and the shaping length of this distance, without solids."""
        return (self.gamma, self.shaping_length, None) if C else None

    @property
    def functions(self) -> Mapping[str, Any]:
        """Kernels of the pairs, by their number of planes."""
        return {
            f"{count} planes": halfspace_distance(self.pairs.vertex_slots, count, self.gamma, self.shaping_length)
            for count in sorted(self.pairs.plane_tables)
        }

    @twin_of(_hdsdf_rows)
    def __call__(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return D (S,) [m], its wrench (S, 6) and D̃ (S,) [m] for S pairs (row of the pairs) at samples."""
        distance, wrench, separation = self._by_casadi(1, kinematics, sample, pair)
        return distance[:, 0], wrench, separation[:, 0]

    def with_hessian(self, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
        """Return D (S,) [m], its wrench (S, 6) and its Hessian (S, 6, 6) by the same motion."""
        distance, wrench, _, hessian = self._by_casadi(2, kinematics, sample, pair)
        return distance[:, 0], wrench, hessian.reshape(-1, 6, 6)

    def _by_casadi(self, order: int, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> list[Array]:
        """The outputs of `halfspace_distance`."""
        batch, joints = kinematics.placements.shape[:2]
        placements = kinematics.placements.reshape(batch * joints, 12)  # row of sample s and joint j: s·joints + j
        results = [np.zeros((len(pair), width)) for width in (1, 6, 1, 36)[: order + 2]]
        slots = self.pairs.plane_slots[pair]
        for count in sorted(set(slots.tolist())):
            kernel = _kernel(self.pairs.vertex_slots, count, self.gamma, self.shaping_length, order)
            chosen = np.flatnonzero(slots == count)
            s, p = sample[chosen], pair[chosen]
            found = kernel(
                [placements, placements, self.pairs.body_table, self.pairs.plane_tables[count]],
                [
                    s * joints + self.pairs.joint_a[p],
                    s * joints + self.pairs.joint_b[p],
                    self.pairs.body[p],
                    self.pairs.plane_row[p],
                ],
            )
            for result, values in zip(results, found, strict=True):
                result[chosen] = values
        return results


@made_once(64)
def _kernel(vertices: int, planes: int, gamma: int, shaping_length: float, order: int) -> RowFunction:
    return RowFunction(halfspace_distance(vertices, planes, gamma, shaping_length, order))
