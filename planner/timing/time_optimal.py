"""The fastest law along a path within the limits of velocity, acceleration and torque: reachability analysis on a grid
(Pham & Pham, "A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis", T-RO 2018).

With x = u̇² the squared path speed and ü constant between grid points Δ apart, x' = x + 2 Δ ü at the next point, and
limits are rows

    a ü + b x ≤ c

at a point and, with that point's own a, b, c, at the next one, where x' takes the place of x. Backwards, from rest, the
x from which the next point's set can be reached are found by elimination of ü (Fourier and Motzkin): each row that
bounds it from above, with each from below, leaves a bound on x alone,

    (b₁ |a₂| + b₂ a₁) x ≤ c₁ |a₂| + c₂ a₁,   a₁ > 0 > a₂.

Forwards, from rest, ü is as large as the rows allow, but for rounding, and x' stays in its set. The loop in C and the
twin here agree to the bit; toppra, by the authors of the paper, solves linear programs at each point, and agrees but
for rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hdplan.distance.compiled.loops import library
from hdplan.planner.timing.time_laws import Stepwise
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError

GRID = 200  # intervals of the path
MOST = 1e8  # of ü and u̇² [1/s²]: a law's duration is not below 1e-4 s
ROUNDING = 1e-8  # [1/s²] by which a set may be empty
SLACK = 1e-12  # [–] of a row that may be rounding: all that is left of one where a path turns back


class PathRows(NamedTuple):
    """Limits a ü + b u̇² ≤ c at the points of a grid on one path, each (points, rows)."""

    a: Array
    b: Array
    c: Array

    @classmethod
    def both(cls, a: Array, b: Array, c: Array, limit: Array) -> PathRows:
        """Return |a ü + b u̇² + c| ≤ limit (rows,), with a, b, c (points, rows)."""
        return cls(np.hstack([a, -a]), np.hstack([b, -b]), np.hstack([limit - c, limit + c]))


def grid() -> Array:
    """Return the parameters (GRID + 1,) at which limits are asked for."""
    return np.linspace(0.0, 1.0, GRID + 1)


def time_optimal(limits: Sequence[PathRows]) -> Stepwise:
    """Return the fastest law, from rest to rest, within limits at the points of `grid`. Raises HdplanError if there is
    none."""
    none = np.zeros((GRID + 1, 0))
    a, b, c = (np.hstack(values) for values in zip(PathRows(none, none, none), *limits, strict=True))
    squares = np.zeros(GRID + 1)
    known = np.isfinite(a).all() and np.isfinite(b).all() and not np.isnan(c).any()
    loops = library()
    found = known and (
        loops.time_optimal(a, b, c, 1.0 / GRID, MOST, ROUNDING, SLACK, squares) if loops else _law(a, b, c, squares)
    )
    path_speeds = np.sqrt(squares)
    if not found or not (path_speeds[1:] + path_speeds[:-1] > 0.0).all():
        raise HdplanError("no time law was found within the limits of velocity and acceleration")
    widths = 2.0 / GRID / (path_speeds[1:] + path_speeds[:-1])
    return Stepwise(np.concatenate([[0.0], np.cumsum(widths)]), path_speeds)


def _law(a: Array, b: Array, c: Array, x: Array) -> bool:
    """Put the fastest law's squared path speeds into x (points,); whether there is one."""
    twice, last = 2.0 * (1.0 / GRID), len(x) - 1
    sets = np.zeros((last + 1, 2))

    def lines(i: int) -> tuple[Array, Array, Array]:
        low, high = sets[i + 1]
        return (
            np.concatenate([a[i], a[i + 1] + twice * b[i + 1], [twice, -twice, 1.0, -1.0]]),
            np.concatenate([b[i], b[i + 1], [1.0, -1.0, 0.0, 0.0]]),
            np.concatenate([c[i], c[i + 1], [high, -low, MOST, MOST]]),
        )

    for i in reversed(range(last)):
        low, high = _eliminated(*lines(i))
        if not low <= high + ROUNDING:
            return False
        sets[i] = min(low, high), high
    if sets[0, 0] > ROUNDING:
        return False
    x[0] = 0.0
    for i in range(last):
        pushed, by_speed, bound = lines(i)
        above = pushed > 0.0
        used = by_speed * x[i]
        left = bound - used + SLACK * (np.abs(bound) + np.abs(used))
        most = min(MOST, float((left[above] / pushed[above]).min()))
        x[i + 1] = np.clip(x[i] + twice * most, *sets[i + 1])
    return True


def _eliminated(a: Array, b: Array, c: Array) -> tuple[float, float]:
    """Return the least and the greatest x for which some u satisfies a u + b x ≤ c; the least is ∞ if there is none."""
    above, below, flat = a > 0.0, a < 0.0, a == 0.0
    ahead, behind = a[above][:, None], -a[below]
    slopes = np.concatenate([b[flat], (b[above][:, None] * behind + b[below] * ahead).ravel()])
    bounds = np.concatenate([c[flat], (c[above][:, None] * behind + c[below] * ahead).ravel()])
    if (bounds[slopes == 0.0] < 0.0).any():
        return np.inf, MOST
    ratio = np.divide(bounds, slopes, out=np.zeros_like(bounds), where=slopes != 0.0)
    return float(ratio[slopes < 0.0].max(initial=0.0)), float(ratio[slopes > 0.0].min(initial=MOST))
