"""The HD-SDF in JAX: value, gradient and Hessian of a pair of bodies at many poses at once, one per lane of an array.

Every array has the poses last (N), so that one instruction works on many of them. The derivatives are closed forms: the
shaped Hölder minimum gives its derivatives as sums over the vertices (moments), and ``axes`` turns moments into
wrenches. Automatic derivatives would include branches not taken, where they are 0/0.
"""

from __future__ import annotations

from functools import partial, reduce
from operator import add
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from hdplan.distance.batch.axes import Axes, blocks, cross, dot, moving_axes, own_axes, skew, sum_halves
from hdplan.distance.batch.tables import OwnAxes, Pair

Array = jax.Array
Frame = tuple[Array, Array]  # rotation (3, 3, N) and position (3, N)


class Places(NamedTuple):
    """The poses of two bodies, N times; positions are subtracted before anything is rounded to fewer digits."""

    turn_a: Array  # (N, 3, 3) world from A
    turn_b: Array  # (N, 3, 3) world from B
    offset: Array  # (N, 3) [m] from A's origin to B's, in the world


class Sums(NamedTuple):
    """Sums over all pairs of vertices for each axis of a group."""

    least: Array  # (n, N) min x
    bound: Array  # (n, N) the axis' contribution to D̃, see ``normals``
    total: Array  # (n, N) Σ w r^p
    moments: tuple[Array, ...]  # by order of derivatives: Σ pull ψ (m, n, N) and Σ sharp ψψᵀ (m, m, n, N)


class Shaped(NamedTuple):
    """g = Phi(u) of a Hölder minimum u, and the factors of its derivatives.

    du = scale_pull Σ pull dx;  d²g = outer du² + scale_sharp Σ sharp dx² + slope du(d²x)
    """

    value: Array
    slope: Array  # dg/du
    outer: Array
    scale_pull: Array
    scale_sharp: Array


class Factors(NamedTuple):
    """The weights of all axes, shapes (axes, N): dU = Σ slope du, U = ⊞ g; d²D has terms outer du² and sharp dx²."""

    slope: Array
    outer: Array
    sharp: Array


def _all_axes(pair: Pair, places: Places, witnesses: Array) -> tuple[list[Axes], list[Axes], tuple[Frame, Frame]]:
    """Return the groups differentiated by B's twist, those by A's, and the frames of B in A and of A in B."""
    rotation = dot(places.turn_a[:, :, None], places.turn_b[:, None])
    b_in_a = rotation, dot(places.turn_a, places.offset[:, None])
    a_in_b = rotation.swapaxes(0, 1), -dot(places.turn_b, places.offset[:, None])
    by_b = [own_axes(pair.in_a, *b_in_a, pair.radii, pair.vertices_b)]
    by_b += [moving_axes(axes, *b_in_a, pair.radii) for axes in pair.moving]
    by_a = [own_axes(pair.in_b, *a_in_b, pair.radii, pair.vertices_a)]
    if len(witnesses):
        normals = jnp.concatenate([witnesses, -witnesses]).swapaxes(0, 1)  # (3, n, N)
        levels = dot(pair.vertices_b.swapaxes(0, 1)[:, :, None], normals[:, None])
        ones = jnp.ones_like(levels[..., :1])
        by_a.append(own_axes(OwnAxes(normals, levels, ones, ones[0]), *a_in_b, pair.radii, pair.vertices_a))
    return by_b, by_a, (b_in_a, a_in_b)


def pair_distance(
    pair: Pair, length: Array, places: Places, witnesses: Array, *, gamma: int, order: int
) -> tuple[Array, ...]:
    """Return D and D̃ (N,) [m]; from order 1 on the gradient (12, N), for order 2 the Hessian (12, 12, N).

    Here the poses come last in places and witnesses, too: (3, 3, N), (3, N) and (W, 3, N).
    """
    by_b, by_a, (b_in_a, a_in_b) = _all_axes(pair, places, witnesses)
    sums = [_sums(axes, gamma, order) for axes in by_b + by_a]
    least = jnp.concatenate([s.least for s in sums])
    inner = _shaped(_not_zero(least), jnp.concatenate([s.total for s in sums]), gamma, length)
    # the maximum is minus the minimum of the negatives
    m = _not_zero(-jnp.max(inner.value, axis=0))
    counts = jnp.concatenate([axes.counts for axes in by_b + by_a])
    total, pull, sharp = _weights(-inner.value, counts, m, gamma)
    outer = _shaped(m, sum_halves(total, 0), gamma, length)
    results = [-outer.value, jnp.max(jnp.concatenate([s.bound for s in sums]), axis=0)]
    if order == 0:
        return tuple(results)

    share = pull * outer.scale_pull  # dU/dg of each axis, U the maximum
    factors = Factors(
        share * inner.slope,
        outer.slope * share * inner.outer - sharp * outer.scale_sharp * inner.slope * inner.slope,
        outer.slope * share * inner.scale_sharp,
    )
    wrenches, hessians, start = [], [], 0
    for axes, s in zip(by_b + by_a, sums, strict=True):
        rows = slice(start, start := start + len(axes.counts))
        mine = Factors(*(part[rows] for part in factors))
        pulls = s.moments[0] * inner.scale_pull[rows]
        wrenches.append(sum_halves(axes.slopes((pulls * mine.slope)[:, None])[:, 0], 1))
        if order == 2:
            squares = mine.sharp * s.moments[1] + mine.outer * pulls[:, None] * pulls
            twice = axes.slopes(axes.slopes(squares).swapaxes(0, 1))
            hessians.append(sum_halves(twice, 2) + axes.bend(pulls * (outer.slope * mine.slope)))
    # all by B's twist: a twist of A moves B, seen from A, by its opposite
    to_a, to_b = partial(_moved, *b_in_a), partial(_moved, *a_in_b)
    wrench = reduce(add, wrenches[: len(by_b)]) - to_b(reduce(add, wrenches[len(by_b) :])[:, None])[:, 0]
    gradient = outer.slope * wrench
    results.append(jnp.concatenate([-to_a(gradient[:, None])[:, 0], gradient]))
    if order == 2:
        turned = to_b(to_b(reduce(add, hessians[len(by_b) :])).swapaxes(0, 1))
        hessian = reduce(add, hessians[: len(by_b)]) + turned - outer.outer * wrench[:, None] * wrench
        # A exp(ξ_a) and B exp(ξ_b) move relatively by exp(ξ_b - X ξ_a - ½[X ξ_a, ξ_b] + …), X the adjoint to B's frame
        force, torque = skew(gradient[:3]), skew(gradient[3:])
        mixed = to_a(0.5 * blocks(jnp.zeros_like(force), force, force, torque) - hessian)
        results.append(blocks(to_a(to_a(hessian).swapaxes(0, 1)), mixed, mixed.swapaxes(0, 1), hessian))
    return tuple(results)


def pair_separation(pair: Pair, places: Places, witnesses: Array) -> Array:
    """Return D̃ (N,) alone; places and witnesses as in ``pair_distance``."""
    by_b, by_a, _ = _all_axes(pair, places, witnesses)
    return jnp.max(jnp.concatenate([_along(axes).bound for axes in by_b + by_a]), axis=0)


def moved(places: Places, twists: Array) -> Places:
    """Return the places (poses last) after twists (12,) of both bodies, to the first order."""
    (v_a, turn_a), (v_b, turn_b) = ((twist[:3], skew(twist[3:])[..., None]) for twist in (twists[:6], twists[6:]))
    return Places(
        places.turn_a + _turned(places.turn_a, turn_a),
        places.turn_b + _turned(places.turn_b, turn_b),
        places.offset + _turned(places.turn_b, v_b[:, None, None])[:, 0]
        - _turned(places.turn_a, v_a[:, None, None])[:, 0],
    )  # fmt: skip


class Along(NamedTuple):
    """The projections of the other body's points on a group of axes."""

    along: Array  # (V, n, N) [m] x = level - along
    least: Array  # (n, N) [m] min x
    bound: Array  # (n, N) [m] the axis' contribution to D̃, see ``normals``


def _along(axes: Axes) -> Along:
    """Return the projections of the other body's points, in a loop over them."""

    def find(highest: Array, point: Array) -> tuple[Array, Array]:
        along = dot(axes.directions, point) + axes.base
        return jnp.maximum(highest, along), along

    highest, along = lax.scan(find, jnp.full_like(axes.base, -jnp.inf), axes.points)
    lowest = jnp.min(axes.levels, axis=0)
    along, least = along + axes.drop, lowest - (highest + axes.drop)
    bound = least
    if axes.squares is not None:
        overlap = jnp.minimum(lowest - highest, 0) / jnp.maximum(axes.squares, np.finfo(least.dtype).tiny)
        bound = jnp.where(axes.squares > 0, jnp.where(overlap < 0, overlap - axes.drop, least), -jnp.inf)
    return Along(along, least, bound)


def _sums(axes: Axes, gamma: int, order: int) -> Sums:
    """Return the sums over all pairs of vertices, in a second loop over the other body's points.

    Loops stay loops: they compile quickly, and their data stay in the processor's cache.
    """
    along, least, bound = _along(axes)
    m = _not_zero(least)

    psi, products = _powers(axes.points, 1)
    moving = axes.level_points is not None
    level_psi = level_products = jnp.ones((1, 1, 1, 1), m.dtype)
    if axes.level_points is not None:
        level_psi, level_products = _powers(axes.level_points, 0)

    def add(sums: list[Array], vertex: tuple[Array, ...]) -> tuple[list[Array], None]:
        along, count, psi, products = vertex
        total, pull, sharp = _weights(axes.levels - along, axes.level_counts * count, m, gamma)
        terms = [sum_halves(total, 0)]
        if order >= 1:
            pulls = sum_halves(pull * level_psi, 1)
            terms += [pulls[0] * psi, pulls[1:]]
        if order == 2:
            sharps = sum_halves(sharp * level_products, 1)
            terms += [sharps[0] * products, sharps[1:4, None] * psi, sharps[4:]]
        return [so_far + term for so_far, term in zip(sums, terms, strict=True)], None

    inputs = along, axes.point_counts, psi, products
    shapes = [(), (4,), (3 * moving,), (10,), (3 * moving, 4), (6 * moving,)]
    start = [jnp.zeros((*shape, *m.shape), m.dtype) for shape in shapes[: (1, 3, 6)[order]]]
    (total, *parts), _ = lax.scan(add, start, inputs)
    moments = []
    if order >= 1:
        moments.append(jnp.concatenate(parts[:2]))
    if order == 2:
        of_points, mixed, of_levels = parts[2:]
        square = _symmetric(of_points, ((0, 1, 2, 3), (1, 4, 5, 6), (2, 5, 7, 8), (3, 6, 8, 9)))
        if moving:
            of_levels = _symmetric(of_levels, ((0, 1, 2), (1, 3, 4), (2, 4, 5)))
            square = blocks(square, mixed.swapaxes(0, 1), mixed, of_levels)
        moments.append(square)
    return Sums(least, bound, total, tuple(moments))


def _powers(points: Array, axis: int) -> tuple[Array, Array]:
    """Return ψ = (1, point) and the ten distinct products of its components, along the points' axis."""
    one, x, y, z = jnp.ones_like(jnp.take(points, 0, axis)), *(jnp.take(points, k, axis) for k in range(3))
    psi = one, x, y, z
    products = [psi[i] * psi[j] for i in range(4) for j in range(i, 4)]
    return jnp.stack(psi, axis), jnp.stack(products, axis)


def _symmetric(entries: Array, rows: tuple[tuple[int, ...], ...]) -> Array:
    """Return a symmetric matrix from its distinct entries, along the first axis."""
    return jnp.stack([jnp.stack([entries[k] for k in row]) for row in rows])


def _not_zero(least: Array) -> Array:
    """Return the minimum m; one too small to divide by is replaced by the largest number below 0, where Phi is 0."""
    smallest = np.finfo(least.dtype).tiny
    return jnp.where(jnp.abs(least) <= smallest, -smallest, least)


def _weights(x: Array, counts: Array, m: Array, gamma: int) -> tuple[Array, Array, Array]:
    """Return the terms of S = Σ w r^p, of du (pull) and of d²u (sharp) for x_i, counted w_i times, whose minimum is m.

    With p = gamma + 1 (paper: Lemma A.1), every ratio r_i in [0, 1]:

        m > 0:  r_i = m/x_i,          u = m S^(-1/p),  du/dx_i = w_i (r_i u/m)^(p+1),  sharp_i = w_i r_i^(p+2)
        m < 0:  r_i = min(x_i, 0)/m,  u = m S^(1/p),   du/dx_i = w_i (r_i m/u)^(p-1),  sharp_i = w_i r_i^(p-2)
    """
    above = m > 0
    x = jnp.maximum(x, m)  # a compiler may compute x again with other rounding
    r = jnp.minimum(x, jnp.where(above, m, 0)) / jnp.where(above, x, m)
    low = counts * (power(r, gamma - 1) if gamma > 1 else (r > 0).astype(x.dtype))
    more = jnp.where(above, r * r, 1)
    return low * r * r, low * r * more, low * more * more


def _shaped(m: Array, total: Array, gamma: int, length: Array) -> Shaped:
    """Return Phi(u) = u s, s = t^gamma/(1 + t^gamma), t = |u|/delta (eq. (1)), for the minimum m and S of
    ``_weights``, with its factors. s/u is bounded, by 1/delta, also where u is too small for a division.
    """
    p = gamma + 1
    above = m > 0
    inverse = jnp.exp(jnp.log(jnp.maximum(total, 1)) / -p)  # the least x alone contributes 1
    square = inverse * inverse
    u = m * jnp.where(above, inverse, 1 / inverse)
    size = jnp.abs(u)
    near = size < length
    ratio = jnp.minimum(size, length) / jnp.maximum(size, length)
    lower = power(ratio, gamma - 1)
    steepness = lower * ratio
    s, rest = jnp.where(near, steepness, 1) / (1 + steepness), jnp.where(near, 1, steepness) / (1 + steepness)
    s_by_u = jnp.sign(m) * jnp.where(near, lower, 1) / (jnp.maximum(size, length) * (1 + steepness))
    steep = 1 + gamma * rest
    bend = s_by_u * steep * jnp.where(above, p + 1, 1 - p)
    scale_sharp = power(inverse, p - 2)
    return Shaped(
        value=u * s,
        slope=s * steep,
        outer=s_by_u * gamma * rest * (1 + gamma * (rest - s)) + bend,
        scale_pull=scale_sharp * inverse * jnp.where(above, square, 1),
        scale_sharp=-bend * scale_sharp * jnp.where(above, square * square, 1),
    )


def _turned(rotation: Array, columns: Array) -> Array:
    """Return the products of matrices (3, 3, N) and (3, k, N)."""
    return dot(rotation.swapaxes(0, 1)[:, :, None], columns[:, None])


def _moved(rotation: Array, position: Array, wrench: Array) -> Array:
    """Return wrenches (6, K, N) in a frame of that rotation and position, about its origin, in the outer frame."""
    rows = rotation.swapaxes(0, 1)[:, :, None]
    force, torque = dot(rows, wrench[:3, None]), dot(rows, wrench[3:, None])
    return jnp.concatenate([force, torque + cross(position[:, None], force)])


def power(base: Array, exponent: int) -> Array:
    """Return base^exponent by squaring, exponent >= 0."""
    if exponent == 0:
        return jnp.ones_like(base)
    half = power(base, exponent // 2)
    return half * half * base if exponent % 2 else half * half
