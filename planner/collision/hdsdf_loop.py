"""The HD-SDF of `distance.symbolic.halfspaces` in hand-written C: the same equations, several times as fast.

In: a link body's vertices and a halfspace body's planes at two placements. Out: D, its wrench and D̃. A lower bound in
sign, an approximation in value. The CasADi function is the definition, and serves machines without a compiler; the two
agree but for rounding.

Why it is fast: one plane after another lies in memory, so that every step of the sums runs over planes in the widest
vectors of the processor; roots are found without `pow`; and numbers of vertices and planes are arguments, so that no
robot and no obstacle needs a compilation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Rows

if TYPE_CHECKING:
    from hdplan.planner.collision.hdsdf import HdsdfPairs


def hdsdf_rows(hdsdf: HdsdfPairs, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> tuple[Array, Array, Array]:
    """D (S,) [m], its wrench (S, 6) and D̃ (S,) [m] for S pairs at samples."""
    found = distance, wrench, separation = np.empty(len(pair)), np.empty((len(pair), 6)), np.empty(len(pair))
    rows = (np.ascontiguousarray(each, np.int64) for each in (sample, pair))
    given = hdsdf.pairs.tables.struct, hdsdf.gamma, hdsdf.shaping_length, kinematics.placements, *rows
    C.hdsdf_rows(*given, *found)
    return distance, wrench, separation
