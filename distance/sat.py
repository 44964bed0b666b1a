"""Ground truth for the signed distance of two polytopes, slow and simple: least squares apart, separating axes in
contact.

In: vertices of both in the world [m] and the axes N(A, B) of ``normals.separating_axes``. Out: ``Proximity``, exact to
rounding, positive = separated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

Array = NDArray[np.float64]

ROUNDING = (
    1e-13  # of the size: closest points this little farther apart than an axis' gap have that axis as their normal
)


@dataclass(frozen=True, eq=False)
class Proximity:
    """Exact signed distance, and two points that attain it: point_a - point_b = distance * normal."""

    distance: float  # [m] positive = separated, negative = penetration depth
    point_a: Array  # (3,) [m] on A's surface, in the world
    point_b: Array  # (3,) [m] on B's surface, in the world
    normal: Array  # (3,) unit, from B to A: moving A by -distance * normal makes the bodies touch


def ground_truth(a: Array, b: Array, axes: Array) -> Proximity:
    """Return the signed distance of the hulls of ``a`` (m, 3) and ``b`` (k, 3), given the axes N(A, B) up to sign (K,
    3).

    Apart: the closest points. In contact: the largest gap over the axes, which hold all face normals of A - B (paper:
    eq. ``eq:Dfinal``); the witness points are where the bodies touch once A is moved out along that axis.
    """
    along_a, along_b = a @ axes.T, b @ axes.T
    forward, backward = along_a.min(0) - along_b.max(0), along_b.min(0) - along_a.max(0)
    best = int(np.argmax(np.maximum(forward, backward)))
    gap = float(max(forward[best], backward[best]))
    point_a, point_b = closest_points(a, b)
    distance = float(np.linalg.norm(point_a - point_b))
    if distance > max(gap, 0.0) + ROUNDING * _size(a, b):
        return Proximity(distance, point_a, point_b, (point_a - point_b) / distance)
    normal = axes[best] if forward[best] >= backward[best] else -axes[best]
    point_a, point_b = closest_points(a - gap * normal, b)
    middle = 0.5 * (point_a + point_b)  # one point but for rounding
    return Proximity(gap, middle + gap * normal, middle, normal)


def closest_points(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the closest points of the hulls of ``a`` (m, 3) and ``b`` (k, 3); one common point where they meet.

    The point of least norm in the hull of the differences c: minimizing |C w|² + (1·w - 1)² over w >= 0 gives it
    exactly, as the second term only scales w. The differences enter one at a time, the one farthest against the current
    point first (Wolfe's method), until none brings the point nearer.
    """
    size = _size(a, b)
    pairs, best, answer = [(0, 0)], np.inf, (a[0], b[0])
    while True:
        i, j = np.array(pairs).T
        differences = (a[i] - b[j]) / size
        weights = nnls(np.vstack([differences.T, np.ones(len(pairs))]), np.array([0.0, 0.0, 0.0, 1.0]))[0]
        weights /= weights.sum()
        point = weights @ differences
        norm = float(np.linalg.norm(point))
        if norm >= best:
            return answer
        best, answer = norm, (weights @ a[i], weights @ b[j])
        pairs = [pair for pair, weight in zip(pairs, weights, strict=True) if weight > 0]
        pairs.append((int(np.argmin(a @ point)), int(np.argmax(b @ point))))


def _size(a: Array, b: Array) -> float:
    """Return the largest coordinate difference of a point of ``a`` and one of ``b``, or 1 if there is none."""
    return float(max(np.abs(a.max(0) - b.min(0)).max(), np.abs(b.max(0) - a.min(0)).max())) or 1.0
