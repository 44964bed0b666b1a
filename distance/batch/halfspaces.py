"""The planner's distance in JAX: the HD-SDF between a swept body and a body given by its planes, for whole arrays.

    D = Phi( ⊞_k Phi( ⊕_i (n_k · a_i − r_A − h_k) ) )

as in the planner (Definition III.2 of the paper, B's supports exact); a lower bound in sign, an approximation in value.
JAX differentiates it in any order of grad, vmap and jit; the slopes of Hölder operators are closed forms, right where
vertices or planes tie, too.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jax import lax

Array = jax.Array


def halfspace_distance(
    points: Array, weights: Array, radius: Array, planes: Array, gamma: int, shaping_length: float | Array
) -> Array:
    """Return D (...) [m] of bodies of V vertices and bodies of K planes, in the latter's frames.

    points: (..., V, 3) [m]; weights: (..., V) how often each counts, 0 for a slot that repeats one; radius: (...) [m];
    planes: (..., 4, K) unit normals by coordinate and supports [m].
    """
    x, y, z = (points[..., :, None, i] * planes[..., None, i, :] for i in range(3))  # not matmul: they are small
    x = x + y + z - (planes[..., 3, :] + radius[..., None])[..., None, :]
    inner = shaping(holder_minimum(x, weights[..., None], gamma + 1, -2), gamma, shaping_length)
    return shaping(-holder_minimum(-inner, jnp.ones_like(inner), gamma + 1, -1), gamma, shaping_length)


@partial(jax.custom_jvp, nondiff_argnums=(2, 3))
def holder_minimum(x: Array, weights: Array, p: int, axis: int) -> Array:
    """Return the Hölder minimum of order p >= 2 of x along an axis, each of them counted `weights` times, held
    fixed."""
    return _with_slopes(x, weights, p, axis)[0]


@holder_minimum.defjvp
def _along(p: int, axis: int, at: tuple[Array, Array], way: tuple[Array, Array]) -> tuple[Array, Array]:
    least, slopes = _with_slopes(*at, p, axis)
    return least, jnp.sum(slopes * way[0], axis=axis)


def _with_slopes(x: Array, weights: Array, p: int, axis: int) -> tuple[Array, Array]:
    """Return the Hölder minimum u and du/dx: w (u/x)^(p+1) where u > 0, w (x/u)^(p−1) of the x < 0 where u < 0.

    Ratios to the least of x are powers of numbers up to 1; it cancels, and is held fixed."""
    least = lax.stop_gradient(x.min(axis=axis, keepdims=True))
    above, apart = least > 0, least != 0
    scale = jnp.where(apart, least, 1.0)
    ratio = jnp.where(above, scale / jnp.where(above, x, 1.0), jnp.minimum(x, 0.0) / scale)
    total = jnp.where(apart, jnp.sum(weights * ratio**p, axis=axis, keepdims=True), 1.0)  # a root has no slope at 0
    root = jnp.exp(jnp.log(total) * jnp.where(above, -1.0 / p, 1.0 / p))
    slopes = weights * jnp.where(above, (ratio * root) ** (p + 1), (ratio / root) ** (p - 1))
    return jnp.squeeze(jnp.where(apart, scale * root, 0.0), axis), jnp.where(apart, slopes, 0.0)


def shaping(u: Array, gamma: int, shaping_length: float | Array) -> Array:
    """Return Phi(u) = u |u|^γ / (|u|^γ + δ^γ), by a power of a number up to 1."""
    size = jnp.abs(u)
    far = size > shaping_length
    raised = jnp.where(far, shaping_length / jnp.where(far, size, 1.0), size / shaping_length) ** gamma
    return u * jnp.where(far, 1.0, raised) / (1.0 + raised)
