"""Distance from points to the convex hull of a few vertices, with the nearest points."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array

MOST_NUMBERS = 60_000  # numbers in one array: larger ones leave the processor's cache, and cost several times as much


@cache
def _subsets(count: int) -> tuple[NDArray[np.intp], Array]:
    """Return every set of one to four of `count` rows, filled up to four with its first row, and the diagonal
    (T, 3, 3) that makes the Gram matrix of a filled-up set regular."""
    sets = [rows for size in range(1, min(count, 4) + 1) for rows in itertools.combinations(range(count), size)]
    filled = np.array([[0.0] * (len(rows) - 1) + [1.0] * (4 - len(rows)) for rows in sets])
    return np.array([rows + rows[:1] * (4 - len(rows)) for rows in sets]), filled[:, None] * np.eye(3)


def distance_to_hull(points: Array, vertices: Array) -> tuple[Array, Array]:
    """Return distances (N,) from points (N, 3) to conv of vertices (m, 3), and the nearest points' weights (N, m); or
    those of many hulls at once, all three with an axis more in front.

    Projects onto every vertex, segment, triangle and tetrahedron (Caratheodory) at once, which is an affine map: for m
    up to about 8. A value is never too small, since each is the distance to a point of the hull.
    """
    rows, filled = _subsets(vertices.shape[-2])
    at_once, count = max(1, MOST_NUMBERS // (7 * len(rows))), points.shape[-2]
    if points.ndim == 3 and len(points) > max(1, at_once // count):
        parts = range(0, len(points), max(1, at_once // count))
        found = [distance_to_hull(points[k : k + parts.step], vertices[k : k + parts.step]) for k in parts]
        return np.concatenate([each[0] for each in found]), np.concatenate([each[1] for each in found])
    if count > at_once:
        parts = range(0, count, at_once)
        found = [distance_to_hull(points[..., k : k + at_once, :], vertices) for k in parts]
        return np.concatenate([each[0] for each in found], -1), np.concatenate([each[1] for each in found], -2)
    origin = vertices[..., rows[:, 0], :]
    edges = vertices[..., rows[:, 1:], :] - origin[..., None, :]  # (..., T, 3, 3)
    across = edges.swapaxes(-1, -2)
    gram = edges @ across
    gram += filled + (1e-12 * np.trace(gram, axis1=-2, axis2=-1) + 1e-24)[..., None, None] * np.eye(3)
    along = np.linalg.solve(gram, edges)
    maps = np.concatenate([-along.sum(-2, keepdims=True), along, np.eye(3) - across @ along], axis=-2)
    shift = -(maps @ origin[..., None])  # both (..., T, 7, .): four shares, then what is left of the point
    shift[..., 0, :] += 1.0
    flat = (*maps.shape[:-3], 7 * len(rows), -1)
    affine = maps.reshape(flat) @ points.swapaxes(-1, -2) + shift.reshape(flat)
    affine = affine.reshape(*maps.shape[:-1], count)  # (..., T, 7, N)
    square = np.einsum("...in,...in->...n", affine[..., 4:, :], affine[..., 4:, :])
    square[affine[..., :4, :].min(-2) < 0.0] = np.inf
    chosen = square.argmin(-2)
    shares = np.take_along_axis(affine[..., :4, :], chosen[..., None, None, :], -3)[..., 0, :, :]
    weights = np.zeros((*points.shape[:-1], vertices.shape[-2]))
    for corner in (3, 2, 1, 0):  # the first comes last: what filled the set up has its row and no share
        np.put_along_axis(weights, rows[chosen, corner][..., None], shares[..., corner, :, None], -1)
    return np.linalg.norm(points - weights @ vertices, axis=-1), weights
