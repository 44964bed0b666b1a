"""Slope of the duration of the fastest law along a path by the path.

Each squared path speed x of the law T is what one line lets it be: a row of the limits, from the x before it, or what
bounds its set from above, of the next set. Backwards along these, by the chain rule, ∂T/∂x becomes a multiplier μ of
each row that binds,

    dT = Σ μ (dc − ü da − x db),

and, as a, b and c are functions of q, q' and q'' at the points of the grid, the derivative by these, and by the
waypoints through which the spline is drawn. It is exact but at kinks, where two lines bind as soon.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from hdplan.planner.timing.path_spline import smooth
from hdplan.planner.timing.time_optimal import (
    GRID,
    MOST_ABOVE,
    MOST_BELOW,
    NEXT_HIGH,
    NEXT_LOW,
    NO_LINE,
    FastestLaw,
    OnGrid,
    PathRows,
    fastest,
)
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import HdplanError


class Binding(NamedTuple):
    """Rows of limits that bind, each (k,)."""

    point: Rows  # of the grid
    row: Rows
    push: Array  # ü of the step
    square: Array  # x at the point
    multiplier: Array  # μ


@runtime_checkable
class SlopedLimit(Protocol):
    """A limit of which it is known how its rows change with the path."""

    @property
    def in_law(self) -> bool:
        """True if the fastest law knows this limit."""

    def rows(self, path: OnGrid) -> PathRows | None:
        """Rows of the limit on a path; None if there is no law within it."""

    def slopes(self, path: OnGrid, binding: Binding) -> OnGrid:
        """Return the derivatives of the duration by q, q' and q'' through rows of this limit that bind."""


def duration_slope(waypoints: Array, limits: Sequence[SlopedLimit]) -> tuple[float, Array]:
    """Return the duration [s] of the fastest law along waypoints (N, n), regardless of its jerk, and its derivative (N,
    n) by them; limits are those that the law knows. Raises HdplanError if there is none."""
    basis = _basis(len(waypoints))
    path = OnGrid(*(basis @ waypoints))
    given = [(limit, rows) for limit in limits if (rows := limit.rows(path)) is not None]
    if len(given) < len(limits):
        raise HdplanError("gravity alone exceeds a limit")
    law = fastest([rows for _, rows in given])
    binding, slope, first = _binding(law), np.zeros((3, *path.q.shape)), 0
    for limit, rows in given:
        own = (binding.row >= first) & (binding.row < first + rows.a.shape[1])
        if own.any():
            point, row, *values = (each[own] for each in binding)
            slope += limit.slopes(path, Binding(point, row - first, *values))
        first += rows.a.shape[1]
    return law.stepwise.duration, np.einsum("dpk,dpn->kn", basis, slope)


@functools.lru_cache(maxsize=8)
def _basis(count: int) -> Array:
    """Return q, q' and q'' at the points of the grid by each of N waypoints (3, points, N)."""
    return np.stack(OnGrid.of(smooth(np.eye(count))))


def _binding(law: FastestLaw) -> Binding:
    """Return the rows that bind, each with its multiplier."""
    (a, b, _), rows, twice = law.rows, law.rows.a.shape[1], 2.0 / GRID
    x, pushed, held = (each.tolist() for each in (law.squares, law.pushed, law.held))
    beside = {NEXT_HIGH: (twice, 1.0), NEXT_LOW: (-twice, -1.0), MOST_ABOVE: (1.0, 0.0), MOST_BELOW: (-1.0, 0.0)}
    by_x, by_high = _by_square(law), [0.0] * (GRID + 1)
    found: list[tuple[int, int, float, float, float]] = []

    def slopes(step: int, line: int) -> tuple[float, float]:
        """Return a and b of a line, with the x where the step begins."""
        if line >= 2 * rows:
            return beside[line - 2 * rows]
        ahead, row = divmod(line, rows)
        by_speed = b.item(step + ahead, row)
        return a.item(step + ahead, row) + ahead * twice * by_speed, by_speed

    def bind(step: int, line: int, multiplier: float) -> None:
        if line < 2 * rows:
            ahead, row = divmod(line, rows)
            found.append((step + ahead, row, (x[step + 1] - x[step]) / twice, x[step + ahead], multiplier))
        elif line == 2 * rows + NEXT_HIGH:
            by_high[step + 1] += multiplier

    for step in reversed(range(GRID)):
        by_next = by_x[step + 1]
        push, by_speed = slopes(step, pushed[step + 1])
        bind(step, pushed[step + 1], twice * by_next / push)
        by_x[step] += by_next * (1.0 - twice * by_speed / push)  # 0 where the step leads to the end of a set
    for step, (above, below) in enumerate(held[:-1]):
        if by_high[step] and above != NO_LINE:
            below = 2 * rows + MOST_BELOW if below == NO_LINE else below
            (up, by_up), (down, by_down) = slopes(step, above), slopes(step, below)
            share = by_high[step] / (by_down * up - by_up * down)
            bind(step, above, -down * share)
            bind(step, below, up * share)
    if not found:
        return Binding(*np.zeros((2, 0), dtype=np.int64), *np.zeros((3, 0)))
    point, row, *values = zip(*found, strict=True)
    return Binding(np.array(point), np.array(row), *(np.array(each) for each in values))


def _by_square(law: FastestLaw) -> list[float]:
    """Return ∂T/∂x at the points; 0 where the law stands."""
    speeds = np.sqrt(law.squares)
    by_speed = np.zeros(GRID + 1)
    each = -2.0 / GRID / (speeds[1:] + speeds[:-1]) ** 2
    by_speed[1:] += each
    by_speed[:-1] += each
    found: list[float] = np.divide(0.5 * by_speed, speeds, out=np.zeros_like(speeds), where=speeds > 0.0).tolist()
    return found
