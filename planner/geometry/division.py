"""Triangles halved until they are small."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hdplan.scenes.array_types import Array, Mask, Rows


def divided(corners: Array, longest: float, near: Callable[[Array, Array], Mask] | None = None) -> Array:
    """Return triangles (m, 3, 3), halved across their longest edges until none is longer than `longest` [m]; without
    those of which balls around them, centres (k, 3) and radii (k,), are not `near`."""
    done = [corners[:0]]
    while len(corners):
        if near is not None:
            middle = corners.mean(axis=1)
            corners = corners[near(middle, np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1))]
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)  # (m, 3) from corner i to i + 1
        large = edges.max(axis=1) > longest
        done.append(corners[~large])
        corners = _halves(corners[large], edges[large].argmax(axis=1))
    return np.concatenate(done)


def _halves(corners: Array, edge: Rows) -> Array:
    """Return the halves (2 m, 3, 3) of triangles that are cut through the middle of one edge (m,)."""
    order = (edge[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
