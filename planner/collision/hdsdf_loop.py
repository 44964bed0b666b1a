"""The HD-SDF of `distance.symbolic.halfspaces` in hand-written C: the same equations, several times as fast.

In: a link body's vertices and a halfspace body's planes at two placements. Out: D, its wrench and D̃. A lower bound in
sign, an approximation in value. The CasADi function is the definition, and serves machines without a compiler; the two
agree but for rounding.

Why it is fast: one plane after another lies in memory, so that every step of the sums runs over planes in the widest
vectors of the processor; roots are found without `pow`; and numbers of vertices and planes are arguments, so that no
robot and no obstacle needs a compilation.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.scenes.array_types import Array, Rows


def hdsdf_rows(
    loops: ModuleType, tables: Record, gamma: int, length: float, kinematics: KinematicsBatch, sample: Rows, pair: Rows
) -> tuple[Array, Array, Array]:
    """Return D (S,) [m], its wrench (S, 6) and D̃ (S,) [m] for S pairs at samples."""
    count, placements = len(pair), kinematics.placements
    distance, wrench, separation = np.empty(count), np.empty((count, 6)), np.empty(count)
    rows = (np.ascontiguousarray(each, np.int64) for each in (sample, pair))
    loops.hdsdf_rows(tables.struct, gamma, length, placements, *rows, distance, wrench, separation)
    return distance, wrench, separation
