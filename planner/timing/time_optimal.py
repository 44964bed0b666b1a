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

Which lines bound each set from above, and which one each step, is kept: `duration_slope` finds from these how the law's
duration changes with its limits. A line's number is that of its row, or, of the next point's rows, that and the number
of rows; those of NEXT_HIGH and what follows come last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hdplan.distance.compiled.loops import C, twin_of
from hdplan.planner.timing.time_laws import Stepwise
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import HdplanError

if TYPE_CHECKING:
    from hdplan.planner.timing.path_spline import PathSpline

GRID = 200  # intervals of the path
GREATEST_RATE = 1e8  # of ü and u̇² [1/s²]: a law's duration is not below 1e-4 s
SET_ROUNDING = 1e-8  # [1/s²] by which a set may be empty
SLACK = 1e-12  # [–] of a row that may be rounding: all that is left of one where a path turns back
# lines beside the rows: x' in its set, and |ü| at most GREATEST_RATE
NEXT_HIGH, NEXT_LOW, MOST_ABOVE, MOST_BELOW = range(4)
NO_LINE = -1  # in place of a line's number


class PathRows(NamedTuple):
    """Limits a ü + b u̇² ≤ c at the points of a grid on one path, each (points, rows)."""

    a: Array
    b: Array
    c: Array

    @classmethod
    def both(cls, a: Array, b: Array, c: Array, limit: Array) -> PathRows:
        """Return |a ü + b u̇² + c| ≤ limit (rows,), with a, b, c (points, rows)."""
        return cls(np.hstack([a, -a]), np.hstack([b, -b]), np.hstack([limit - c, limit + c]))


class OnGrid(NamedTuple):
    """A path q(u) at the points of a grid, each (points, n)."""

    q: Array
    slope: Array  # q'
    curvature: Array  # q''

    @classmethod
    def of(cls, spline: PathSpline) -> OnGrid:
        """Return a spline at the points of `grid`."""
        return cls(*(spline(grid(), order) for order in range(3)))


class FastestLaw(NamedTuple):
    """The fastest law within limits, and what bounds it, by numbers of lines."""

    rows: PathRows  # all limits side by side
    squares: Array  # (points,) u̇²
    highs: Array  # (points,) the upper ends of their sets
    held: Rows  # (points, 2) the lines, one or two, by which an upper end is what it is; or NO_LINE
    pushed: Rows  # (points,) the line that bounds the step to a point

    @property
    def stepwise(self) -> Stepwise:
        """The law as a function of time."""
        path_speeds = np.sqrt(self.squares)
        widths = 2.0 / GRID / (path_speeds[1:] + path_speeds[:-1])
        return Stepwise(np.concatenate([[0.0], np.cumsum(widths)]), path_speeds)


def grid() -> Array:
    """Return the parameters (GRID + 1,) at which limits are evaluated."""
    return np.linspace(0.0, 1.0, GRID + 1)


def time_optimal(limits: Sequence[PathRows]) -> Stepwise:
    """Return the fastest law, from rest to rest, within limits at the points of `grid`. Raises HdplanError if there is
    none."""
    return fastest(limits).stepwise


def fastest(limits: Sequence[PathRows]) -> FastestLaw:
    """Return the fastest law, and the lines that bound it."""
    none = np.zeros((GRID + 1, 0))
    a, b, c = (np.hstack(values) for values in zip(PathRows(none, none, none), *limits, strict=True))
    held, pushed = np.full((GRID + 1, 2), NO_LINE, dtype=np.int64), np.full(GRID + 1, NO_LINE, dtype=np.int64)
    law = FastestLaw(PathRows(a, b, c), np.zeros(GRID + 1), np.zeros(GRID + 1), held, pushed)
    known = np.isfinite(a).all() and np.isfinite(b).all() and not np.isnan(c).any()
    found = known and _law(law)
    path_speeds = np.sqrt(law.squares)
    if not found or not (path_speeds[1:] + path_speeds[:-1] > 0.0).all():
        raise HdplanError("no time law was found within the limits of velocity and acceleration")
    return law


def _in_c(law: FastestLaw) -> bool:
    return bool(C.time_optimal(*law.rows, 1.0 / GRID, GREATEST_RATE, SET_ROUNDING, SLACK, *law[1:]))


@twin_of(_in_c)
def _law(law: FastestLaw) -> bool:
    """Fill in the fastest law; whether there is one."""
    (a, b, c), x, highs, held, pushed = law
    twice, last, rows = 2.0 * (1.0 / GRID), len(x) - 1, a.shape[1]
    lows = np.zeros(last + 1)

    def lines(i: int) -> tuple[Array, Array, Array]:
        low, high = lows[i + 1], highs[i + 1]
        return (
            np.concatenate([a[i], a[i + 1] + twice * b[i + 1], [twice, -twice, 1.0, -1.0]]),
            np.concatenate([b[i], b[i + 1], [1.0, -1.0, 0.0, 0.0]]),
            np.concatenate([c[i], c[i + 1], [high, -low, GREATEST_RATE, GREATEST_RATE]]),
        )

    for i in reversed(range(last)):
        low, high, held[i] = _eliminated(*lines(i))
        if not low <= high + SET_ROUNDING:
            return False
        lows[i], highs[i] = min(low, high), high
    if lows[0] > SET_ROUNDING:
        return False
    for i in range(last):
        push, by_speed, bound = lines(i)
        above = np.flatnonzero(push > 0.0)
        used = by_speed * x[i]
        left = bound - used + SLACK * (np.abs(bound) + np.abs(used))
        allowed = left[above] / push[above]
        reached = x[i] + twice * min(GREATEST_RATE, float(allowed.min()))
        x[i + 1] = np.clip(reached, lows[i + 1], highs[i + 1])
        pushed[i + 1] = above[allowed.argmin()]
        if x[i + 1] != reached:
            pushed[i + 1] = 2 * rows + (NEXT_LOW if reached < x[i + 1] else NEXT_HIGH)
    return True


def _eliminated(a: Array, b: Array, c: Array) -> tuple[float, float, tuple[int, int]]:
    """Return the least and the greatest x for which some u satisfies a u + b x ≤ c, and which lines bound it from
    above; the least is ∞ if there is none."""
    above, below, flat = (np.flatnonzero(each) for each in (a > 0.0, a < 0.0, a == 0.0))
    ahead, behind = a[above][:, None], -a[below]
    slopes = np.concatenate([b[flat], (b[above][:, None] * behind + b[below] * ahead).ravel()])
    bounds = np.concatenate([c[flat], (c[above][:, None] * behind + c[below] * ahead).ravel()])
    if (bounds[slopes == 0.0] < 0.0).any():
        return np.inf, GREATEST_RATE, (NO_LINE, NO_LINE)
    ratio = np.divide(bounds, slopes, out=np.zeros_like(bounds), where=slopes != 0.0)
    low, high = float(ratio[slopes < 0.0].max(initial=0.0)), float(ratio[slopes > 0.0].min(initial=GREATEST_RATE))
    if high == GREATEST_RATE:
        return low, high, (NO_LINE, NO_LINE)
    place = int(np.where(slopes > 0.0, ratio, np.inf).argmin())
    if place < len(flat):
        return low, high, (int(flat[place]), NO_LINE)
    first, second = divmod(place - len(flat), len(below))
    return low, high, (int(above[first]), int(below[second]))
