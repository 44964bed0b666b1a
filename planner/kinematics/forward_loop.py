"""The forward kinematics of many configurations in one loop of C: the recursion of `forward`, equal but for
rounding."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.scenes.array_types import Array


def forward(loops: ModuleType, tree: Record, q: Array, joints: int) -> tuple[Array, Array]:
    """Return placements (B, joints, 12) and columns (B, n, 6) at configurations (B, n)."""
    batch, n = q.shape
    placements, columns = np.empty((batch, joints, 12)), np.empty((batch, n, 6))
    loops.forward(tree.struct, q, placements, columns)
    return placements, columns
