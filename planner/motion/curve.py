"""The executed curve: how the joints move between the rows of a trajectory.

Rows hold positions, and may hold times, velocities and accelerations. Between two rows every joint follows the
polynomial of least degree that matches both rows:

    positions: a straight line; with velocities: a cubic; with accelerations too: a quintic (Hermite interpolation)

which is the rule of ROS' joint_trajectory_controller. It is stored in Bernstein form, q(s) = Σ_i c_i B_i,d(s) between
two rows, 0 ≤ s ≤ 1: a polynomial lies within the hull of its control points c_i, and its parts and derivatives within
the hulls of theirs (Farin, Curves and Surfaces for CAGD, chapters 4 and 5). So all bounds here are proven, up to
rounding. Units: [rad] or [m], and [s].

Numbers have bounds (FARTHEST_VALUE, SHORTEST, LONGEST), so that nothing overflows: a derivative of order k ≤ 4 is at
most d! / (d − k)! 2ᵏ FARTHEST_VALUE / SHORTESTᵏ < 1e250, and so are products of rates whose orders add up to four, as
in bounds on torques.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import read_only

FARTHEST_VALUE = 1e6  # [rad] or [m] that a control point may be from 0
SHORTEST, LONGEST = 1e-60, 1e60  # [s] between two rows, and from time 0
ROW_RATES = ("velocities", "accelerations")  # that rows may hold beside times and positions
RULES = {1: "linear", 3: "cubic", 5: "quintic"}  # by the degree
PARTS = 8  # of an interval, each bounded by its own control points
BLOCK = 512  # polynomials at once: their parts stay in the cache, and BLAS starts no threads that wait for each other


@dataclass(frozen=True, eq=False)
class Curve:
    """A piecewise polynomial motion of n joints through N rows."""

    control: Array  # (N − 1, d + 1, n) control points of each interval
    times: Array | None = None  # (N,) of the rows [s]; None: a path without times
    given: tuple[Array, ...] = ()  # (N, n) its derivatives at the rows, as far as the rows say them

    @classmethod
    def through(
        cls,
        positions: Array,
        times: Array | None = None,
        velocities: Array | None = None,
        accelerations: Array | None = None,
    ) -> Curve:
        """Interpolate rows (N, n); velocities and accelerations need times, accelerations need velocities."""
        first, last = positions[:-1], positions[1:]
        if times is None or velocities is None:
            return cls(np.stack([first, last], axis=1), times)
        width = np.diff(times)[:, None]
        if accelerations is None:
            start, end = velocities[:-1] * width / 3, velocities[1:] * width / 3
            return cls(np.stack([first, first + start, last - end, last], axis=1), times, (velocities,))
        fifth, twentieth = width / 5, width**2 / 20
        start, end = velocities[:-1] * fifth, velocities[1:] * fifth
        bend, unbend = accelerations[:-1] * twentieth, accelerations[1:] * twentieth
        inner = [first + start, first + 2 * start + bend, last - 2 * end + unbend, last - end]
        return cls(np.stack([first, *inner, last], axis=1), times, (velocities, accelerations))

    @property
    def rule(self) -> str:
        """The interpolation: "linear", "cubic" or "quintic"."""
        return RULES[self.degree]

    @property
    def degree(self) -> int:
        """The degree d of the polynomials."""
        return int(self.control.shape[1]) - 1

    def __len__(self) -> int:
        """The number of rows N."""
        return len(self.control) + 1

    @property
    def rows(self) -> Array:
        """The positions at the rows (N, n)."""
        return np.concatenate([self.control[:, 0], self.control[-1:, -1]])

    @cached_property
    def widths(self) -> Array:
        """Durations of the intervals (N − 1,) [s]; 1 for a path without times."""
        return np.ones(len(self.control)) if self.times is None else np.diff(self.times)

    def columns(self, chosen: Rows | list[int]) -> Curve:
        """Return the curve of some of the joints, or of all in another order."""
        return Curve(self.control[:, :, chosen], self.times, tuple(each[:, chosen] for each in self.given))

    def at(self, interval: Rows, fraction: Array) -> Array:
        """Return the positions (k, n) on intervals (k,) at fractions (k,) of them."""
        control = self.control[interval]
        if self.degree == 1:
            fraction = fraction[:, None]
            return np.asarray((1.0 - fraction) * control[:, 0] + fraction * control[:, 1])
        return _left(control, fraction)[:, -1]

    def interval_of(self, parameter: ArrayLike) -> tuple[Rows, Array]:
        """Return the intervals in which path parameters in [0, 1] lie, and the fractions within them."""
        where = np.asarray(parameter, dtype=np.float64) * len(self.control)
        interval = np.clip(np.floor(where).astype(np.int64), 0, len(self.control) - 1)
        return interval, where - interval

    def at_parameter(self, parameter: ArrayLike) -> Array:
        """Return the positions (…, n) at path parameters in [0, 1], over which the rows are evenly spaced."""
        interval, fraction = self.interval_of(parameter)
        found = self.at(interval.ravel(), fraction.ravel())
        return np.asarray(found.reshape(*interval.shape, -1))

    def at_time(self, time: ArrayLike, order: int = 0) -> Array:
        """Return the positions (…, n) at times [s], or a derivative of that order."""
        return self.over_time(order).at_parameter(self.parameter_of(time))

    def place_of(self, time: Array) -> tuple[Rows, Array]:
        """Return the intervals of a curve with times in which times (…) [s] from the first row to the last lie, the one
        after a row, and the fractions within them: at rows 0 or 1 to the bit."""
        assert self.times is not None
        interval = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.control) - 1)
        return interval, np.clip((time - self.times[interval]) / self.widths[interval], 0.0, 1.0)

    def parameter_of(self, time: ArrayLike) -> Array:
        """Return the path parameters at times [s]: 0 before the first row, 1 after the last."""
        rows = np.linspace(0.0, 1.0, len(self))
        return np.asarray(np.interp(np.asarray(time), rows if self.times is None else self.times, rows))

    def time_of(self, parameter: ArrayLike) -> Array:
        """Return the times [s] at path parameters; the parameters themselves for a path without times."""
        rows = np.linspace(0.0, 1.0, len(self))
        return np.asarray(np.interp(np.asarray(parameter), rows, rows if self.times is None else self.times))

    @cached_property
    def derivative(self) -> Curve:
        """The time derivative: velocities of positions, accelerations of velocities.

        What the rows say it has to the bit, and no control point takes more rounding than they do: a rounding e of a
        position makes a jerk of 60 e/h³ between rows h apart, and would make the acceleration jump.
        """
        degree, widths = self.degree, self.widths[:, None]
        if not degree:
            return Curve(np.zeros_like(self.control), self.times)
        control = degree * np.diff(self.control, axis=1) / widths[:, None]
        if self.given:
            value, *slope = self.given
            control[:, 0], control[:, -1] = value[:-1], value[1:]
            for each in slope:
                control[:, 1] = value[:-1] + each[:-1] * widths / (degree - 1)
                control[:, -2] = value[1:] - each[1:] * widths / (degree - 1)
            if degree == 2 * len(self.given) + 1:  # the middle one follows from the others and their mean
                control[:, degree // 2] = 0.0
                mean = (self.control[:, -1] - self.control[:, 0]) / widths
                control[:, degree // 2] = degree * mean - control.sum(axis=1)
        return Curve(control, self.times, self.given[1:])

    def over_time(self, order: int) -> Curve:
        """Return the time derivative of that order."""
        return self if order == 0 else self.derivative.over_time(order - 1)

    def part(self, interval: Rows, start: Array, width: Array) -> tuple[Array, Array, Array]:
        """Return midpoint, slope and deviation on parts of intervals: q_m (k, n), δ (k, n) and ε (k, n) with

            |q(s) − q_m − s δ| ≤ ε,   −1 ≤ s ≤ 1 over the part,   q_m = q(0) on the curve,

        since the difference has the control points c_i − q_m − s_i δ, s_i = 2 i/d − 1. ε is 0 for straight lines and
        falls with the square of the width. Parts of an even width are so many whole intervals, and all are of one
        width: s is even over each of them, and has a share of [−1, 1] for it.
        """
        if len(width) and width[0] > 1.0:
            return self._several(interval, int(width[0]))
        control = self.control[interval]
        if self.degree == 1:
            step = control[:, 1] - control[:, 0]
            middle = control[:, 0] + (start + 0.5 * width)[:, None] * step
            return middle, 0.5 * width[:, None] * step, np.zeros_like(step)
        control = _between(control, start, start + width)
        middle = _left(control, np.full(len(control), 0.5))[:, -1]
        delta = 0.5 * (control[:, -1] - control[:, 0])
        places = np.linspace(-1.0, 1.0, self.degree + 1)[:, None]
        away = np.abs(control - middle[:, None] - places * delta[:, None]).max(axis=1)
        return middle, delta, away

    def _several(self, first: Rows, count: int) -> tuple[Array, Array, Array]:
        """Return the same over an even number of intervals each, from the first ones (k,) on."""
        control = self.control[first[:, None] + np.arange(count)]  # (k, count, d + 1, n)
        middle, delta = control[:, count // 2, 0], 0.5 * (control[:, -1, -1] - control[:, 0, 0])
        places = np.add.outer(np.arange(count), np.linspace(0.0, 1.0, self.degree + 1)) * (2.0 / count) - 1.0
        straight = middle[:, None, None] + places[:, :, None] * delta[:, None, None]
        return middle, delta, np.abs(control - straight).max(axis=(1, 2))

    def span(self, interval: Rows, start: Array, width: Array) -> tuple[Array, Array]:
        """Return the middle of parts of intervals and half their duration (k,) [s]; the curve must have times."""
        if self.times is None:
            raise ValueError("a path without times has no duration")
        taken = self.widths[interval]
        return self.times[interval] + (start + 0.5 * width) * taken, 0.5 * width * taken

    def bounds(self) -> tuple[Array, Array]:
        """Return proven bounds (N − 1, n) on the curve's values on every interval: low, high."""
        if self.degree <= 1:
            return self.control.min(axis=1), self.control.max(axis=1)
        count, order, n = self.control.shape
        control = self.control.transpose(1, 0, 2).reshape(order, -1)
        low, high = np.empty((2, count * n))
        for first in range(0, count * n, BLOCK):
            block = slice(first, first + BLOCK)
            parts = _parts(self.degree) @ control[:, block]
            parts.min(axis=0, out=low[block])
            parts.max(axis=0, out=high[block])
        return low.reshape(count, n), high.reshape(count, n)

    def largest(self) -> Array:
        """Return a proven bound (n,) on the curve's absolute values."""
        low, high = self.bounds()
        return np.asarray(np.maximum(-low, high).max(axis=0))

    def largest_on(self, interval: Rows, start: Array, end: Array) -> Array:
        """Return proven bounds (k, n) on the absolute values on parts of intervals (k,), from start to end (k,)."""
        return np.asarray(np.abs(_between(self.control[interval], start, end)).max(axis=1))

    def steps(self, before: Array | float = 0.0, after: Array | float = 0.0) -> Array:
        """Return by how much (N, n) the curve, a derivative, jumps at each row, with its sign; `before` the first row
        and `after` the last it is as given (n,), or 0."""
        first, last = (np.zeros_like(self.control[:1, 0]) + each for each in (before, after))
        ends = np.concatenate([first, self.control[:, -1]])
        starts = np.concatenate([self.control[:, 0], last])
        return np.asarray(starts - ends)

    def jumps(self, before: Array | float = 0.0, after: Array | float = 0.0) -> Array:
        """Return the sizes (N, n) of its steps."""
        return np.asarray(np.abs(self.steps(before, after)))


def _left(control: Array, fraction: Array) -> Array:
    """Return the control points (k, d + 1, n) of the part from 0 to fraction (k,), by de Casteljau's algorithm."""
    points, result = control, [control[:, 0]]
    weight = fraction[:, None, None]
    for _ in range(control.shape[1] - 1):
        points = (1.0 - weight) * points[:, :-1] + weight * points[:, 1:]
        result.append(points[:, 0])
    return np.stack(result, axis=1)


@functools.cache
def _parts(degree: int) -> Array:
    """Return the weights (PARTS (d + 1), d + 1), none negative, that make the control points of all PARTS of a
    polynomial from its own."""
    edges = np.linspace(0.0, 1.0, PARTS + 1)
    points = _between(np.tile(np.eye(degree + 1), (PARTS, 1, 1)), edges[:-1], edges[1:])
    return read_only(points.reshape(-1, degree + 1))


def _between(control: Array, first: Array, last: Array) -> Array:
    """Return the control points (k, d + 1, n) of the part from first (k,) to last (k,), 0 ≤ first ≤ last ≤ 1."""
    left = _left(control, last)
    share = np.divide(first, last, out=np.zeros_like(first), where=last > 0.0)
    return _left(left[:, ::-1], 1.0 - share)[:, ::-1]


def halves(control: Array) -> Array:
    """Return the control points (2 k, d + 1, n) of the two halves of each of k polynomials, one after the other."""
    middle = np.full(len(control), 0.5)
    left, right = _left(control, middle), _left(control[:, ::-1], middle)[:, ::-1]
    return np.stack([left, right], axis=1).reshape(-1, *control.shape[1:])


def row_count(duration: float, rate: float) -> int:
    """Return the number of rows of a motion that are at most 1/rate [s] apart."""
    return max(2, math.ceil(duration * rate - 1e-9) + 1)
