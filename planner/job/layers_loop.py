"""Costs of steps between two layers of configurations, in a loop of C and in NumPy, equal but for rounding."""

from __future__ import annotations

import numpy as np

from hdplan.distance.compiled.loops import C, twin_of
from hdplan.scenes.array_types import Array, Mask

TURN = 2.0 * np.pi


def _in_c(last: Array, rows: Array, quick: Array, circles: Mask, farthest: float) -> Array:
    costs = np.empty((len(rows), len(last)))
    given = np.ascontiguousarray(last), np.ascontiguousarray(rows), np.ascontiguousarray(quick)
    C.steps_between(*given, circles.astype(np.int64), farthest, TURN, costs)
    return costs


@twin_of(_in_c)
def steps_between(last: Array, rows: Array, quick: Array, circles: Mask, farthest: float) -> Array:
    """Costs (l, k) of steps from configurations (k, n) to others (l, n); infinite for one that is farther than
    `farthest` [rad] or [m]."""
    cost, far = np.zeros((len(rows), len(last))), np.zeros((len(rows), len(last)), dtype=bool)
    for joint, speed in enumerate(quick.tolist()):
        step = np.subtract.outer(rows[:, joint], last[:, joint])
        if circles[joint]:
            step -= TURN * np.round(step / TURN)
        far |= ~(np.abs(step) <= farthest)
        cost += (step / speed) ** 2
    cost[far] = np.inf
    return cost
