"""Ground truth for the signed distance of two polytopes: least squares if separated, separating axes if in contact.

In: vertices of both in the world [m] and the axes N(A, B) of ``normals.separating_axes``. Out: ``Proximity``, exact to
rounding, positive = separated.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from hdplan.scenes.array_types import Array

AXIS_ROUNDING = 1e-13  # of the size: where the closest points exceed an axis' gap by no more, that axis is their normal
COINCIDENT_SHARE = 1e-15  # of the size: closest points this close coincide


@dataclass(frozen=True, eq=False)
class Proximity:
    """Exact signed distance, and two points that attain it: point_a - point_b = distance * normal."""

    distance: float  # [m] positive = separated, negative = penetration depth
    point_a: Array  # (3,) [m] on A's surface, in the world
    point_b: Array  # (3,) [m] on B's surface, in the world
    normal: Array  # (3,) unit, from B to A, accurate to about 1e-8: moving A by -distance * normal makes them touch


def ground_truth(a: Array, b: Array, axes: Array) -> Proximity:
    """Return the signed distance of the hulls of ``a`` (m, 3) and ``b`` (k, 3), given the axes N(A, B) up to sign (K,
    3).

    If separated: the closest points. In contact: the largest gap over the axes, which contain all face normals of A - B
    (paper: eq. (3)); the witness points are where the bodies touch once A is moved out along that axis.
    """
    along_a, along_b = a @ axes.T, b @ axes.T
    forward, backward = along_a.min(0) - along_b.max(0), along_b.min(0) - along_a.max(0)
    best = int(np.argmax(np.maximum(forward, backward)))
    gap = float(max(forward[best], backward[best]))
    point_a, point_b, difference = closest_points(a, b)
    distance = float(np.linalg.norm(difference))
    if distance > max(gap, 0.0) + AXIS_ROUNDING * _size(a, b):
        return Proximity(distance, point_a, point_b, difference / distance)
    normal = axes[best] if forward[best] >= backward[best] else -axes[best]
    point_a, point_b, _ = closest_points(a - gap * normal, b)
    middle = 0.5 * (point_a + point_b)  # one point up to rounding
    return Proximity(gap, middle + gap * normal, middle, normal)


def closest_points(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Return the closest points of the hulls of ``a`` (m, 3) and ``b`` (k, 3), and their difference (0 in contact).

    The point of least norm in the hull of the differences c = a_i - b_j (Wolfe's method): the combination of at most
    four of them that is nearest to 0 is kept, and the c that lies farthest in the opposite direction enters, until none
    brings it closer.
    """
    size = _size(a, b)
    pairs, answer = [(0, 0)], (a[0], b[0], np.full(3, np.inf))
    while True:
        i, j = np.array(pairs).T
        weights, difference = _nearest_combination(a[i] - b[j])
        distance = np.linalg.norm(difference)
        if distance >= np.linalg.norm(answer[2]):
            return answer
        answer = weights @ a[i], weights @ b[j], difference
        if distance <= COINCIDENT_SHARE * size:
            return answer
        pairs = [pair for pair, weight in zip(pairs, weights, strict=True) if weight > 0]
        pairs.append((int(np.argmin(a @ difference)), int(np.argmax(b @ difference))))


def _nearest_combination(points: Array) -> tuple[Array, Array]:
    """Return weights (n,) and place (3,) of the point nearest to 0 among the simplices with the last of ``points``.

    The simplices have up to four corners; each is solved by least squares, and its point is projected off its own plane
    once more, so that its direction is exact even where its length is all rounding.
    """
    last = len(points) - 1
    best, place = np.eye(last + 1)[last], points[last]
    for others in chain.from_iterable(combinations(range(last), count) for count in (1, 2, 3)):
        edges = points[list(others)] - points[last]
        left, extents, plane = np.linalg.svd(edges, full_matrices=False)
        if extents[-1] <= COINCIDENT_SHARE * extents[0]:
            continue  # a flat simplex: its faces suffice
        inner = -left @ (plane @ points[last] / extents)
        off_plane = points[last] - plane.T @ (plane @ points[last])
        off_plane = off_plane - plane.T @ (plane @ off_plane)
        if inner.min() >= 0 and inner.sum() <= 1 and np.linalg.norm(off_plane) < np.linalg.norm(place):
            best, place = np.zeros(last + 1), off_plane
            best[list(others)], best[last] = inner, 1 - inner.sum()
    return best, place


def _size(a: Array, b: Array) -> float:
    """Return the largest coordinate difference of a point of ``a`` and one of ``b``, or 1 if there is none."""
    return float(max(np.abs(a.max(0) - b.min(0)).max(), np.abs(b.max(0) - a.min(0)).max())) or 1.0
