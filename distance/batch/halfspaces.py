"""The planner's distance in JAX: the HD-SDF between a swept body and a body given by its planes, for whole arrays.

    D = Phi( ⊞_k Phi( ⊕_i (n_k · a_i − r_A − h_k) ) )

as in the planner (Definition III.2 of the paper, B's supports exact); a lower bound in sign, an approximation in value.
JAX differentiates it itself, in any order of grad, vmap and jit: Hölder operators are sums over all that tie, so that
its derivatives are right at aligned poses too; the extreme by which they are scaled cancels, and is held fixed.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

Array = jax.Array


def halfspace_distance(
    points: Array, weights: Array, radius: Array, planes: Array, gamma: int, shaping_length: float
) -> Array:
    """Return D (...) [m] of bodies of V vertices and bodies of K planes, in the latter's frames.

    points: (..., V, 3) [m]; weights: (..., V) how often each counts, 0 for a slot that repeats one; radius: (...) [m];
    planes: (..., K, 4) unit normals and supports [m].
    """
    along = jnp.einsum("...vi,...ki->...kv", points, planes[..., :3])
    x = along - (planes[..., 3] + radius[..., None])[..., None]
    inner = shaping(holder_minimum(x, weights[..., None, :], gamma + 1), gamma, shaping_length)
    return shaping(-holder_minimum(-inner, jnp.ones_like(inner), gamma + 1), gamma, shaping_length)


def holder_minimum(x: Array, weights: Array, p: int) -> Array:
    """Return the Hölder minimum of x (..., n) of order p, each counted `weights` (..., n) times, along the last
    axis."""
    least = lax.stop_gradient(x.min(axis=-1, keepdims=True))
    above, below = least > 0, least < 0
    high, low = jnp.where(above, least, 1.0), jnp.where(below, least, -1.0)
    apart = jnp.sum(weights * (high / jnp.where(above, x, 1.0)) ** p, axis=-1)
    within = jnp.sum(weights * (jnp.minimum(x, 0.0) / low) ** p, axis=-1)
    above, below, high, low = (part[..., 0] for part in (above, below, high, low))
    apart, within = jnp.where(above, apart, 1.0), jnp.where(below, within, 1.0)  # a root has no slope at 0
    return jnp.where(above, high * apart ** (-1.0 / p), jnp.where(below, low * within ** (1.0 / p), 0.0))


def shaping(u: Array, gamma: int, shaping_length: float) -> Array:
    """Return Phi(u) = u |u|^γ / (|u|^γ + δ^γ)."""
    raised = (jnp.abs(u) / shaping_length) ** gamma
    return u * (raised / (raised + 1.0))
