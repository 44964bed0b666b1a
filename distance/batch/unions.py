"""The HD-SDF of unions of convex bodies in JAX: the Hölder minimum over the pairs of pieces, at many poses at once.

Two convex bodies are unions of one piece each. All pieces of a union move as one body, so that every pair has the same
places and twists. Pairs whose arrays have equal shapes are stacked and go through one loop: they compile once, however
many there are. What ⊕ needs no shaping for, and why its sign is safe: ``hdplan.distance.unions``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from hdplan.distance.batch.kernel import Places, moved, pair_distance, pair_separation, power
from hdplan.distance.batch.tables import Pair

Array = jax.Array
Pairs = tuple[Pair, ...]  # groups of equal shapes, each of them stacked: every array has the pairs first


def stacked(pairs: Sequence[Pair]) -> Pairs:
    """Return pairs in groups of equal shapes."""
    groups: dict[tuple[tuple[int, ...], ...], list[Pair]] = {}
    for pair in pairs:
        groups.setdefault(tuple(part.shape for part in jax.tree.leaves(pair)), []).append(pair)
    return tuple(jax.tree.map(lambda *parts: jnp.stack(parts), *group) for group in groups.values())


@partial(jax.jit, static_argnames=("gamma", "order", "lanes"))
def evaluate(
    pairs: Pairs, length: Array, places: Places, witnesses: Array, *, gamma: int, order: int, lanes: int
) -> tuple[Array, ...]:
    """Return D and D̃ (N,) [m]; from order 1 on the gradient (N, 12), for order 2 the Hessian (N, 12, 12).

    Witnesses (N, W, 3), unit, in B's frame; N is a multiple of ``lanes``, the number of poses evaluated at a time: few
    enough for the processor's cache, so that memory does not grow with N.
    """

    def some(places: Places, witnesses: Array) -> tuple[Array, ...]:
        def one(pair: Pair) -> tuple[Array, ...]:
            return pair_distance(pair, length, places, witnesses, gamma=gamma, order=order)

        found = _of_every(one, pairs)
        return _least(*found, gamma=gamma) if len(found[0]) > 1 else tuple(part[0] for part in found)

    return _mapped(some, places, witnesses, lanes)


@partial(jax.jit, static_argnames=("lanes",))
def separation_gradient(pairs: Pairs, places: Places, witnesses: Array, *, lanes: int) -> Array:
    """Return the gradient (N, 12) of D̃ by the same twists; where pairs, axes or vertices tie, a mean of theirs."""

    def some(places: Places, witnesses: Array) -> tuple[Array]:
        def least(twists: Array) -> Array:
            there = moved(places, twists)
            (found,) = _of_every(lambda pair: (pair_separation(pair, there, witnesses),), pairs)
            return jnp.min(found, axis=0)

        slopes = jax.jacfwd(least)(jnp.zeros(12, places.offset.dtype))
        return (jnp.moveaxis(slopes, -1, 0),)

    return _mapped(some, places, witnesses, lanes)[0]


def _of_every(one: Callable[[Pair], tuple[Array, ...]], pairs: Pairs) -> list[Array]:
    """Return the results of ``one`` for every pair, along a new first axis."""
    found = []
    for group in pairs:
        if len(group.radii) > 1:
            found.append(lax.map(one, group))
        else:
            found.append(tuple(part[None] for part in one(jax.tree.map(lambda part: part[0], group))))
    return [jnp.concatenate(parts) for parts in zip(*found, strict=True)]


def _least(x: Array, separations: Array, *derivatives: Array, gamma: int) -> tuple[Array, ...]:
    """Return u = ⊕ x over the first axis, the least separation, and the derivatives of u.

    Of the pairs that count, all where u > 0 and those with x_k < 0 where u < 0, the shares s_k = (u/x_k)^p or (x_k/u)^p
    sum to 1. With d_k = dx_k/x_k, which is moderate even where x_k is tiny, and their mean d = Σ s_k d_k,

        du = u d,    d²u = u (Σ s_k d²x_k/x_k - c Σ s_k (d_k - d)(d_k - d)ᵀ),    c = p + 1 or 1 - p.
    """
    p, smallest = gamma + 1, np.finfo(x.dtype).tiny
    m = jnp.min(x, axis=0)
    above, below = m > smallest, m < -smallest
    counted = above | (below & (x < -smallest))
    over = jnp.where(counted, 1 / jnp.where(counted, x, 1), 0)
    shares = power(jnp.where(counted, jnp.where(above, m * over, x / jnp.where(below, m, 1)), 0), p)
    total = jnp.maximum(jnp.sum(shares, axis=0), 1)  # the least x alone contributes 1
    root = jnp.exp(jnp.log(total) / p)
    u = jnp.where(above, m / root, jnp.where(below, m * root, 0))
    shares = shares / total
    results = [u, jnp.min(separations, axis=0)]
    if derivatives:
        slopes = derivatives[0] * over[:, None]
        mean = jnp.sum(shares[:, None] * slopes, axis=0)
        results.append(u * mean)
    if len(derivatives) > 1:
        spread = slopes - mean
        curved = jnp.sum((shares * over)[:, None, None] * derivatives[1], axis=0)
        weighted = jnp.where(above, p + 1, 1 - p) * shares[:, None] * spread
        results.append(u * (curved - jnp.einsum("kin,kjn->ijn", weighted, spread)))
    return tuple(results)


def _mapped(some: Callable[..., tuple[Array, ...]], places: Places, witnesses: Array, lanes: int) -> tuple[Array, ...]:
    """Return the results of ``some`` for all poses, called with as many as there are lanes, the poses last."""

    def block(inputs: tuple[Places, Array]) -> tuple[Array, ...]:
        return some(*jax.tree.map(lambda part: jnp.moveaxis(part, 0, -1), inputs))

    split = jax.tree.map(lambda x: x.reshape(len(x) // lanes, lanes, *x.shape[1:]), (places, witnesses))
    return tuple(jnp.moveaxis(part, -1, 1).reshape(-1, *part.shape[1:-1]) for part in lax.map(block, split))
