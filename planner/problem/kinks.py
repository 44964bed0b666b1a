"""Jumps and kinks of a function along a segment, found by bisection.

In: values of a scalar function along a segment, its slope and its Hessian. Out: the place of a jump. Between two points
that are close together, a value changes as the slopes say, and a slope as the Hessians say (trapezoidal rule). The
error of this rule falls with the cube of the distance where a function is smooth, and stays where the function jumps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdplan.scenes.array_types import Array

POINTS = 65  # on the segment, before the bisection
INTERVAL_HALVINGS = 40  # of the interval in which the rule fails most
JUMP_SHARE = 1e-6  # of the largest value or slope: a jump, and no rounding

Sampled = Callable[[Array], tuple[Array, Array, Array]]


def place_of_jump(sampled: Sampled, start: Array, end: Array) -> float | None:
    """Place in [0, 1] of a segment at which a function or its slope jumps; None where no jump is found.

    Args:
        sampled: of points (M, k), values (M, 1), slopes (M, k) and Hessians (M, k, k).
        start, end: of the segment (k,).
    """
    share = np.linspace(0.0, 1.0, POINTS)
    values, slopes, hessians = sampled(start + share[:, None] * (end - start))
    along = end - start
    for levels, rates in ((values, slopes[:, None] @ along), (slopes, hessians @ along)):
        size = float(np.abs(levels).max(initial=0.0))
        worst = int(_unexplained(share, levels, rates).argmax())
        ends = share[worst], share[worst + 1]
        for _ in range(INTERVAL_HALVINGS):
            three = np.array([ends[0], 0.5 * (ends[0] + ends[1]), ends[1]])
            value, slope, hessian = sampled(start + three[:, None] * along)
            level, rate = (value, slope[:, None] @ along) if levels is values else (slope, hessian @ along)
            later = int(_unexplained(three, level, rate).argmax())
            ends = three[later], three[later + 1]
        if np.abs(level[later + 1] - level[later]).max() > JUMP_SHARE * size:
            return float(ends[0])
    return None


def _unexplained(share: Array, levels: Array, rates: Array) -> Array:
    """Change of the levels (M, m) in each interval beyond that of their rates."""
    width = np.diff(share)[:, None]
    gap: Array = np.abs(np.diff(levels, axis=0) - 0.5 * width * (rates[1:] + rates[:-1])).max(axis=1)
    return gap
