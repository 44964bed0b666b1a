"""Triangles halved until they are small."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdplan.scenes.array_types import Array, Mask


def divided(corners: Array, longest: float, near: Callable[[Array, Array], Mask] | None = None) -> Array:
    """Return triangles (m, 3, 3), halved across their longest edges until none is longer than `longest` [m]; without
    those of which balls around them, centres (k, 3) and radii (k,), are not `near`."""
    done = [corners[:0]]
    while len(corners):
        if near is not None:
            middle = corners.mean(axis=1)
            corners = corners[near(middle, np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1))]
        large = _edges(corners).max(axis=1) > longest
        done.append(corners[~large])
        corners = halved(corners[large])
    return np.concatenate(done)


def _edges(corners: Array) -> Array:
    """Return the lengths (m, 3) of the edges of triangles, from corner i to i + 1."""
    return np.asarray(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2))


def halved(corners: Array) -> Array:
    """Return both halves (2 m, 3, 3) of triangles (m, 3, 3), cut across their longest edges."""
    order = (_edges(corners).argmax(axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
