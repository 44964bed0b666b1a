"""The forward kinematics of many configurations in one loop of C: the recursion of `forward`, equal but for
rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.kinematics.forward import Kinematics


def forward(kinematics: Kinematics, values: Array) -> tuple[Array, Array]:
    """Placements (B, nj, 12) and columns (B, n, 6) at joint values (B, n)."""
    batch, n = values.shape
    placements, columns = np.empty((batch, kinematics.nj, 12)), np.empty((batch, n, 6))
    C.forward(kinematics.tree.struct, values, placements, columns)
    return placements, columns
