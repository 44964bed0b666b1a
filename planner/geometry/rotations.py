"""Rotation matrices, rotation vectors and unit quaternions, many at once, in NumPy: importing SciPy's takes longer than
planning a whole motion.

Quaternions (x, y, z, w) go between the two others, as they are exact to rounding at no turn and at half a turn, too
(Markley, "Unit quaternion from rotation matrix", 2008).
"""

from __future__ import annotations

import numpy as np

from hdplan.scenes.array_types import Array

SERIES_ANGLE = 1e-3  # [rad] below which sines are series


def quaternions_of(matrices: Array) -> Array:
    """Return unit quaternions (k, 4), x y z w, of rotation matrices (k, 3, 3)."""
    m = np.asarray(matrices, dtype=np.float64)
    diagonal = np.diagonal(m, axis1=1, axis2=2)
    trace = diagonal.sum(axis=1)
    chosen = np.concatenate([diagonal, trace[:, None]], axis=1).argmax(axis=1)
    found = np.empty((len(m), 4))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows = chosen == i
        r = m[rows]
        found[rows, i] = 1.0 - trace[rows] + 2.0 * r[:, i, i]
        found[rows, j] = r[:, j, i] + r[:, i, j]
        found[rows, k] = r[:, k, i] + r[:, i, k]
        found[rows, 3] = r[:, k, j] - r[:, j, k]
    rows = chosen == 3
    r = m[rows]
    found[rows, 0], found[rows, 1] = r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0]
    found[rows, 2], found[rows, 3] = r[:, 1, 0] - r[:, 0, 1], 1.0 + trace[rows]
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def vectors_of(matrices: Array) -> Array:
    """Return rotation vectors (k, 3) [rad], of at most half a turn, of rotation matrices (k, 3, 3)."""
    q = quaternions_of(matrices)
    q = np.where(q[:, 3:] < 0.0, -q, q)
    sine = np.linalg.norm(q[:, :3], axis=1)
    angle = 2.0 * np.arctan2(sine, q[:, 3])
    series = 2.0 + angle**2 / 12.0 + 7.0 * angle**4 / 2880.0
    scale = np.where(angle < SERIES_ANGLE, series, angle / np.maximum(sine, np.sin(0.25 * SERIES_ANGLE)))
    return np.asarray(scale[:, None] * q[:, :3])


def matrices_of(vectors: Array) -> Array:
    """Return rotation matrices (k, 3, 3) of rotation vectors (k, 3) [rad]."""
    angle = np.linalg.norm(vectors, axis=1)
    series = 0.5 - angle**2 / 48.0 + angle**4 / 3840.0
    share = np.where(angle < SERIES_ANGLE, series, np.sin(0.5 * angle) / np.maximum(angle, SERIES_ANGLE))
    x, y, z = (share[:, None] * vectors).T
    w = np.cos(0.5 * angle)
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def slight_turns(count: int, angle: float) -> Array:
    """Return rotation matrices (count, 3, 3) by a small angle [rad] about axes drawn at random, always the same."""
    axes = np.random.default_rng(0).normal(size=(count, 3))
    return matrices_of(angle * axes / np.linalg.norm(axes, axis=1, keepdims=True))


def turn_of(matrix: Array) -> float:
    """Return the angle [rad] of a rotation matrix (3, 3)."""
    return float(np.linalg.norm(vectors_of(matrix[None])))
