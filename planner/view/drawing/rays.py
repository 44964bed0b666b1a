"""The point at which a ray meets what is drawn, as somebody clicked on it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array

Surface = tuple[NDArray[np.floating[Any]], NDArray[np.integer[Any]], Array]
"""A surface: its vertices (k, 3), its triangles (t, 3) of their numbers, and where it stands (4, 4)."""
PARALLEL = 1e-14  # of a ray and a triangle's plane, by their triple product [m²]


def first_hit(origin: Array, direction: Array, surfaces: Iterable[Surface]) -> Array | None:
    """Return the first point (3,) at which a ray from an origin (3,) along a direction (3,) meets one of some surfaces;
    None if it meets none."""
    nearest = np.inf
    for vertices, triangles, place in surfaces:
        turn, shift = place[:3, :3], place[:3, 3]
        nearest = min(
            nearest, _nearest(turn.T @ (origin - shift), turn.T @ direction, vertices[triangles].astype(np.float64))
        )
    return None if not np.isfinite(nearest) else origin + nearest * direction


def _nearest(origin: Array, direction: Array, corners: Array) -> float:
    """Distance along a ray at which it first meets triangles (t, 3, 3), by Möller and Trumbore; inf if it does not."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(direction, two)
    volume = np.einsum("ij,ij->i", one, across)
    inverse = 1.0 / np.where(np.abs(volume) > PARALLEL, volume, np.nan)
    away = origin - corners[:, 0]
    u = np.einsum("ij,ij->i", away, across) * inverse
    other = np.cross(away, one)
    v, far = other @ direction * inverse, np.einsum("ij,ij->i", two, other) * inverse
    with np.errstate(invalid="ignore"):
        hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (far > 0.0)
    return float(far[hit].min(initial=np.inf))
