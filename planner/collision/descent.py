"""Many small smooth functions minimized side by side, so that NumPy's overhead is paid once for all of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdplan.scenes.array_types import Array, Mask, Rows

FIRST_STEP = 0.01  # how far the first step goes
PATIENCE, LEAST_GAIN = 5, 0.02  # a descent that gains less in so many rounds ends
LEAST_DIVISOR = 1e-300  # against division by zero


def minimized(objective: Callable[[Array, Rows], tuple[Array, Array]], start: Array, rounds: int) -> Array:
    """Return nearby points (B, n) at which B functions are small, by BFGS, all side by side.

    objective: points (B', n) and the requested functions, rows (B',) of them -> values (B',), gradients (B', n). In a
    round each function is evaluated once; it continues from there where it fell (Armijo), or else tries a shorter step.
    A function that hardly falls any more is left alone.
    """
    left: Rows = np.arange(len(start))
    ends, one = start.copy(), np.eye(start.shape[1])
    x, (value, slope) = start, objective(start, left)
    inverse = (FIRST_STEP / (np.linalg.norm(slope, axis=1) + LEAST_DIVISOR))[:, None, None] * one
    length: Array = np.ones(len(x))
    before: Array = np.full(len(x), np.inf)
    fresh: Mask = np.ones(len(x), dtype=np.bool_)
    for count in range(1, rounds + 1):
        step = -length[:, None] * (inverse @ slope[:, :, None])[:, :, 0]
        reached, new_slope = objective(x + step, left)
        falls = (step * slope).sum(1)
        good = reached <= value + 1e-4 * falls
        change = new_slope - slope
        curvature = (step * change).sum(1)
        known = good & (curvature > 1e-10 * np.linalg.norm(step, axis=1) * np.linalg.norm(change, axis=1))
        scale = np.where(known, curvature, 1.0)
        first = known & fresh  # now it is known how curved the function is
        inverse[first] = (scale / ((change**2).sum(1) + LEAST_DIVISOR))[first, None, None] * one
        fresh &= ~first
        bent = (inverse @ change[:, :, None])[:, :, 0]
        stretch = (1.0 + (change * bent).sum(1) / scale) / scale
        both = step[:, :, None] * (bent / scale[:, None])[:, None]
        updated = inverse + stretch[:, None, None] * step[:, :, None] * step[:, None] - both - both.swapaxes(1, 2)
        inverse = np.where(known[:, None, None], updated, inverse)
        bowl = np.maximum(reached - value - falls, LEAST_DIVISOR)  # of the parabola through what is known
        length = np.where(good, 1.0, length * np.clip(-0.5 * falls / bowl, 0.1, 0.5))
        x, slope = np.where(good[:, None], x + step, x), np.where(good[:, None], new_slope, slope)
        value = np.where(good, reached, value)
        ends[left] = x
        if count % PATIENCE == 0:
            on = value < (1.0 - LEAST_GAIN) * before
            if not on.any():
                break
            left, x, value, slope = left[on], x[on], value[on], slope[on]
            inverse, length, fresh = inverse[on], length[on], fresh[on]
            before = value
    return ends
