"""B-splines as polynomials between knots: what a timed path is drawn with, evaluated for many parameters at once.

Each piece is its Taylor expansion about the knot where it begins; the second half of the last one that about the knot
where it ends: so the ends are those of the control points to the last bit. SciPy has splines, too, but takes longer to
import than a path to time.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from hdplan.scenes.array_types import Array


class PathSpline:
    """A spline of curves in n joints over the range of its inner knots."""

    def __init__(self, knots: Array, control: Array, degree: int) -> None:
        """Take knots (k + degree + 1,) and control points (k, n)."""
        spans = np.append(np.arange(degree, len(control)), len(control) - 1)
        self._centres = knots[np.append(spans[:-1], len(control))]
        self._begins = np.append(self._centres[:-1], 0.5 * (self._centres[-2] + self._centres[-1]))
        terms = []
        for order in range(degree + 1):
            terms.append(
                _at_knots(knots, control, degree - order, spans - order, self._centres) / math.factorial(order)
            )
            rise = np.diff(control, axis=0)
            if order < degree:
                width = knots[degree - order + 1 : -1] - knots[1 : -(degree - order) - 1]
                control, knots = (degree - order) * rise / width[:, None], knots[1:-1]
        self._terms = terms  # [j] (pieces, n): of x ** j

    def __call__(self, u: ArrayLike, order: int = 0) -> Array:
        """Return a derivative (…, n) of some order at parameters (…)."""
        at = np.asarray(u, dtype=np.float64)
        piece = np.clip(np.searchsorted(self._begins, at, side="right") - 1, 0, len(self._begins) - 1)
        x = (at - self._centres[piece])[..., None]
        found = np.zeros((*at.shape, self._terms[0].shape[1]))
        for j in range(len(self._terms) - 1, order - 1, -1):
            found *= x
            found += math.perm(j, order) * self._terms[j][piece]
        return found


def smooth(waypoints: Array) -> PathSpline:
    """Return the B-spline over [0, 1] with control points on the polyline of waypoints (N, n) (see
    `retiming`)."""
    count, degree = len(waypoints), min(3, len(waypoints) - 1)
    inner = np.linspace(0.0, 1.0, count - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    greville = np.array([knots[i + 1 : i + degree + 1].mean() for i in range(count)])
    even = np.linspace(0.0, 1.0, count)
    control = np.stack([np.interp(greville, even, column) for column in waypoints.T], axis=1)
    return PathSpline(knots, control, degree)


def _at_knots(knots: Array, control: Array, degree: int, spans: Array, at: Array) -> Array:
    """Return the values (pieces, n) of the pieces between knots `spans` and the next ones, by de Boor's rule."""
    rows = control[spans[:, None] + np.arange(-degree, 1)]
    for level in range(1, degree + 1):
        for j in range(degree, level - 1, -1):
            low, high = knots[spans - degree + j], knots[spans + 1 + j - level]
            share = ((at - low) / (high - low))[:, None]
            rows[:, j] = (1.0 - share) * rows[:, j - 1] + share * rows[:, j]
    return np.asarray(rows[:, degree])
