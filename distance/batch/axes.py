"""The axes of a pair in JAX: their directions at N poses, and the derivatives of the projections as the bodies move.

All are closed forms: nothing is differentiated automatically. Every array has the poses last (N), so that one
instruction works on many of them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from hdplan.distance.batch.tables import MovingAxes, OwnAxes

Array = jax.Array


class Axes(NamedTuple):
    """A group of n axes at N poses: x_ij = level_i - (direction·point_j + base) - drop, as the other body's points see
    them.

    Derivatives are by the other body's twist ξ in its own frame. x is linear in ψ_ij = (1, point_j[, level_point_i]), m
    numbers; sums of ψ times weights are moments, which the functions turn into derivatives.
    """

    levels: Array  # (L, n, N) [m]
    level_counts: Array  # (L, n, 1)
    directions: Array  # (3, n, N) in the other body's frame
    base: Array  # (n, N) [m] projected offset of the origins
    drop: Array  # (n, N) or () [m] r_A + r_B + f
    points: Array  # (V, 3, n, 1) [m] of the other body, in its frame
    point_counts: Array  # (V, n, 1)
    counts: Array  # (n, 1) how often each axis counts in the maximum
    level_points: Array | None  # (3, L, n, 1) [m] where the levels move too
    squares: Array | None  # (n, N) |w|² of axes that are not unit vectors
    slopes: Callable[[Array], Array]  # moments (m, K, n, N) -> dx/dξ (6, K, n, N)
    bend: Callable[[Array], Array]  # moments (m, n, N) -> d²x/dξ² (6, 6, N), summed over the axes


def own_axes(own: OwnAxes, rotation: Array, position: Array, radii: Array, points: Array) -> Axes:
    """Return the axes fixed in one body: x = level - n·exp(ξ)ψ. Rotation and position are the other's in its frame."""
    normals = dot(rotation[:, :, None], own.normals[:, None])  # in the other's frame
    return Axes(
        levels=own.levels,
        level_counts=own.level_counts,
        directions=normals,
        base=dot(own.normals, position[:, None]),
        drop=radii,
        points=points[..., None],
        point_counts=jnp.ones_like(points[:, 0, :, None]),
        counts=own.counts,
        level_points=None,
        squares=None,
        slopes=partial(_slopes, normals[:, None]),
        bend=partial(_bend, normals),
    )


def moving_axes(axes: MovingAxes, rotation: Array, position: Array, radii: Array) -> Axes:
    """Return the axes that turn with both bodies: x = w·d - f ψ_0, d = ψ_a - exp(ξ)ψ_b, w = e/√h, h = |e|² + softness².

    e is linear in B's pose, f = c/h + const. The part of an axis that does not turn is as in ``own_axes``; the rest
    follows by the chain rule in e.
    """
    rows, position = rotation.swapaxes(0, 1)[:, :, None, None], position[:, None, None]

    def placed(one: Array, points: Array) -> Array:
        """Return points of B (one = 1), directions (0) or sums of points (their number) (3, K, n, N) in A's frame."""
        return dot(rows, points[:, None]) + one * position

    lever = jnp.concatenate([axes.point[None], axes.lever])
    e = axes.start + dot(axes.matrix, placed(axes.point, axes.lever[:, None]))
    soft = axes.softness * axes.softness
    over = 1 / (dot(e, e) + soft)
    root = jnp.sqrt(over)
    w, c = e * root, axes.fade * soft * (1 + soft)
    held = dot(rotation[:, :, None], w[:, None])  # w in B's frame
    to_e = dot(axes.matrix[:, :, None], rows.swapaxes(0, 1)[:, None, :, 0])  # (3, 3, n, N) from B's frame
    de = -_slopes(to_e.swapaxes(0, 1), lever[:, None]).swapaxes(0, 1)  # (3, 6, n, N)

    def chain(psi: Array) -> tuple[Array, Array, Array]:
        """Return d (3, K, n, N), w·d, and the derivative of x by e."""
        d = psi[4:] - placed(psi[0], psi[1:4])
        along = dot(w[:, None], d)
        return d, along, root * (d - along * w[:, None]) + (2 * c * over * root * psi[0]) * w[:, None]

    def slopes(psi: Array) -> Array:
        return _slopes(held[:, None], psi[:4]) + dot(de[:, :, None], chain(psi)[2][:, None])

    def bend(psi: Array) -> Array:
        d, along, by_e = (part[..., 0, :, :] for part in chain(psi[:, None]))
        one, product = jnp.eye(3, dtype=d.dtype)[..., None, None], w[:, None] * w
        by_ee = (2 * c * over * over * psi[0]) * (one - 4 * product) - over * (
            d[:, None] * w + w[:, None] * d + along * (one - 3 * product)
        )
        moved = -_slopes(rows[:, :, 0], psi[:4, None]).swapaxes(0, 1)  # of exp(ξ)ψ_b
        half = 0.5 * dot(by_ee[:, :, None], de[:, None]) - root * (moved - w[:, None] * dot(w[:, None], moved))
        turned = sum_halves(dot(de[:, :, None], half[:, None]), 2)
        swung = _bend(dot(to_e, by_e[:, None]), lever)
        return _bend(held, psi[:4]) - swung + turned + turned.swapaxes(0, 1)

    return Axes(
        levels=dot(w[:, None], axes.points_a),
        level_counts=axes.counts_a,
        directions=held,
        base=dot(w, position[:, 0]),
        drop=radii + axes.fade * soft * (1 - dot(e, e)) * over,
        points=jnp.moveaxis(axes.points_b, 1, 0),
        point_counts=axes.counts_b,
        counts=jnp.ones_like(axes.point),
        level_points=axes.points_a,
        squares=dot(w, w),
        slopes=slopes,
        bend=bend,
    )


def _slopes(normals: Array, psi: Array) -> Array:
    """Return the derivative of -n·exp(ξ)ψ by ξ = (v, ω): -(n ψ_0, ψ×n)."""
    return -jnp.concatenate([normals * psi[0], cross(psi[1:], normals)])


def _bend(normals: Array, psi: Array) -> Array:
    """Return the second derivative of Σ -n·exp(ξ)ψ over the axes; to second order it is -½ n·(ω×(ω×ψ) + ω×v ψ_0)."""
    force, stress = 0.5 * skew(sum_halves(normals * psi[0], 1)), sum_halves(normals[:, None] * psi[1:], 2)
    trace = stress[0, 0] + stress[1, 1] + stress[2, 2]
    turned = 0.5 * (stress + stress.swapaxes(0, 1)) - trace * jnp.eye(3, dtype=trace.dtype)[..., None]
    return -blocks(jnp.zeros_like(force), force, -force, turned)


def sum_halves(terms: Array, axis: int) -> Array:
    """Return the sum, by halves: XLA's own reduction on CPUs goes through the lanes one by one."""
    rest = []
    while (count := terms.shape[axis]) > 1:
        half = count // 2
        if count % 2:
            rest.append(lax.index_in_dim(terms, count - 1, axis, keepdims=False))
        first, second = (lax.slice_in_dim(terms, k * half, (k + 1) * half, axis=axis) for k in (0, 1))
        terms = first + second
    return sum(rest, lax.index_in_dim(terms, 0, axis, keepdims=False))


def dot(a: Array, b: Array) -> Array:
    """Return Σ_k a_k b_k over the first axis, of length 3."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Array, b: Array) -> Array:
    """Return a×b along the first axis."""
    return jnp.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def skew(a: Array) -> Array:
    """Return the matrix (3, 3, ...) of a×."""
    zero = jnp.zeros_like(a[0])
    return jnp.stack([jnp.stack([zero, -a[2], a[1]]), jnp.stack([a[2], zero, -a[0]]), jnp.stack([-a[1], a[0], zero])])


def blocks(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return the matrix [[a, b], [c, d]] along the first two axes."""
    return jnp.concatenate([jnp.concatenate([a, b], axis=1), jnp.concatenate([c, d], axis=1)])
