"""The GDF of many pairs of boxes at once: the same iteration as ``gdf.gdf``, in NumPy over all pairs together.

In: half sides and poses of boxes. Out: D (N,) and its wrench (N, 6). An unsigned approximation, not sign-safe: 0 where
the boxes meet, without a derivative there. See ``gdf`` for the equations; a box has N = 1 and |l|² = 4 |half|².
"""

from __future__ import annotations

import numpy as np

from hdplan.scenes.array_types import Array


def gdf_boxes(
    half_a: Array,
    turn_a: Array,
    origin_a: Array,
    half_b: Array,
    turn_b: Array,
    origin_b: Array,
    *,
    h: float = 0.1,
    bulging: float = 0.01,
    tolerance: float = 2e-4,
    iterations: int = 300,
) -> tuple[Array, Array]:
    """Return D (N,) [m] and its derivative by a motion of A (N, 6), force and torque about the world's origin.

    half_a, half_b: (N, 3) half sides [m]; turn_*: (N, 3, 3) world from box; origin_*: (N, 3) centres [m]. The other
    arguments are those of ``gdf.gdf``, with which this agrees pair by pair; defaults are those of the paper's published
    experiment.
    """
    point_a = origin_a.copy()
    point_b = np.empty_like(point_a)
    value_a = np.zeros(len(half_a))
    going = np.arange(len(half_a))
    for _ in range(iterations):
        k = going
        point_b[k] = point_a[k] - _energy(half_b[k], turn_b[k], origin_b[k], point_a[k], h, bulging)[1]
        value_a[k], slope = _energy(half_a[k], turn_a[k], origin_a[k], point_b[k], h, bulging)
        before, point_a[k] = point_a[k], point_b[k] - slope
        going = k[np.linalg.norm(before - point_a[k], axis=1) >= tolerance]
        if not len(going):
            break
    value_b = _energy(half_b, turn_b, origin_b, point_a, h, bulging)[0]
    apart = point_a - point_b
    distance = np.sqrt(np.maximum(2.0 * (value_a + value_b) - np.einsum("ni,ni->n", apart, apart), 0.0))
    force = np.divide(apart, distance[:, None], out=np.zeros_like(apart), where=distance[:, None] > 0)
    return distance, np.concatenate([force, np.cross(point_a, force)], axis=1)


def _energy(half: Array, turn: Array, origin: Array, point: Array, h: float, bulging: float) -> tuple[Array, Array]:
    """Return E (N,) [m²] and ∇E (N, 3) [m] of boxes at world points (N, 3)."""
    power, other = 1.0 - 1.0 / h, 2.0 - 1.0 / h
    kept = max(1.0 - 2.0 * bulging, 0.0)
    local = ((point - origin)[:, None] @ turn)[:, 0]
    x = np.maximum(np.abs(local) - half, 0.0)  # of two opposite planes at most one is crossed
    grown = np.expm1(power * np.log1p(x))
    g = (0.5 * x * x - ((grown + x + x * grown) / other - x) / power).sum(axis=1)
    f = 0.5 * bulging * (np.einsum("ni,ni->n", local, local) - 1.2 * np.einsum("ni,ni->n", half, half))
    root = np.sqrt(f * f + kept * g * g)
    # f + root without cancellation where f < 0; 0 at the bodies' inside, where root may vanish
    below = np.divide(kept * g * g, root - f, out=np.zeros_like(f), where=root - f > 0)
    energy = np.where(f > 0, f + root, below)
    along = np.sign(local) * (x - grown / power)
    total = energy[:, None] * bulging * local + (kept * g)[:, None] * along
    slope = np.divide(total, root[:, None], out=np.zeros_like(total), where=root[:, None] > 0)
    return energy, (turn @ slope[..., None])[..., 0]
