"""Costs of steps between two layers of configurations in a loop of C: `Layers._between`, equal but for rounding."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from hdplan.scenes.array_types import Array, Mask

TURN = 2.0 * np.pi


def steps_between(loops: ModuleType, last: Array, rows: Array, quick: Array, circles: Mask, farthest: float) -> Array:
    """Return the costs (l, k) of steps from configurations (k, n) to others (l, n)."""
    costs = np.empty((len(rows), len(last)))
    given = np.ascontiguousarray(last), np.ascontiguousarray(rows), np.ascontiguousarray(quick)
    loops.steps_between(*given, circles.astype(np.int64), farthest, TURN, costs)
    return costs
