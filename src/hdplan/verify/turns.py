"""Rotations about an axis, enclosed; and, in plain numbers, the shortest turn from one rotation to the next, of all
axes or of one that is left free.

Whoever uses plain numbers allows for rounding, which is below 1e-12 for turns of at most LARGEST_TURN.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .balls import CROSS, Ball, cos_sin, dot, need

LARGEST_TURN = 3.0  # [rad] beyond it there may be two shortest turns


def rotation(axis: Ball, angle: Any) -> Ball:
    """Rotations (..., 3, 3) by exact angles (...,) about a unit axis: 1 + sin K + (1 - cos) K^2, K x = axis x x."""
    k, (cos, sin) = dot("ijk,...k->...ij", CROSS, axis), (x[..., None, None] for x in cos_sin(angle))
    return np.eye(3) + sin * k + (1.0 - cos) * dot("...ij,...jk->...ik", k, k)


def turns_between(one: Any, other: Any, free: str) -> Any:
    """Rotation vectors (k, 3) of the shortest turns that take rotations (k, 3, 3) to others; where an axis is `free` to
    be turned about, those that take that axis along."""
    if free == "none":
        between = other @ one.transpose(0, 2, 1)
        about = 0.5 * (between[:, [2, 0, 1], [1, 2, 0]] - between[:, [1, 2, 0], [2, 0, 1]])
        cosine = 0.5 * (np.trace(between, axis1=1, axis2=2) - 1.0)
    else:
        begins, ends = (x[:, :, "xyz".index(free)] for x in (one, other))
        about, cosine = np.cross(begins, ends), (begins * ends).sum(axis=1)
    sine = np.linalg.norm(about, axis=1)
    angle = np.arctan2(sine, cosine)
    need((angle <= LARGEST_TURN).all(), f"a curve turns by more than {LARGEST_TURN:g} rad from one place to the next")
    return about * (angle / np.maximum(sine, 1e-300))[:, None]


def turned(vectors: Any) -> Any:
    """Rotations (k, 3, 3) by rotation vectors (k, 3)."""
    angle = np.linalg.norm(vectors, axis=1)
    k = np.einsum("ijk,nk->nij", CROSS, vectors / np.maximum(angle, 1e-300)[:, None])
    return np.eye(3) + np.sin(angle)[:, None, None] * k + 2 * (np.sin(angle / 2) ** 2)[:, None, None] * (k @ k)
