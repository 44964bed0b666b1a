"""The cost of motions of one problem, from its tables: pure functions that JAX maps over problems and guesses.

Kinematics by walking the tree of joints, the HD-SDF of all pairs at all samples, squared hinges, smoothness.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from hdplan.distance.batch.halfspaces import halfspace_distance
from hdplan.planner.traced.tables import NO_PLACE, PairTable, Structure, Tables

Array = jax.Array


def parts(structure: Structure, tables: Tables, positions: Array) -> tuple[Array, Array]:
    """Return smoothness and penalty of motions (..., N, n) -> (...), (...)."""
    smooth = 0.5 * jnp.einsum("...ki,kl,...li->...", positions, jnp.asarray(tables.smoothness), positions)
    of = _measured(structure, tables)
    depths = [jnp.minimum(of(*each), 0.0) for each in _seen(structure, tables, _samples(tables, positions))]
    share = jnp.asarray(tables.share)
    return smooth, 0.5 * sum(
        (jnp.einsum("s,...sp->...", share, depth * depth) for depth in depths), jnp.zeros_like(smooth)
    )


def distances(structure: Structure, tables: Tables, positions: Array) -> Array:
    """Return D of all pairs, in the order of the problem's terms, at the samples of motions (..., N, n) ->
    (..., B, P) [m]; inf for what only fills the tables."""
    q, of = _samples(tables, positions), _measured(structure, tables)
    found = [of(*each) for each in _seen(structure, tables, q)]
    every = jnp.concatenate([jnp.zeros((*q.shape[:-1], 0)), *found], axis=-1)
    places = jnp.concatenate([jnp.zeros(0, int), *(jnp.asarray(table.place) for table in tables.pairs)])
    real = jnp.asarray(tables.share)[:, None] > 0.0
    return jnp.where(real, every, jnp.inf)[..., jnp.argsort(places)]


def curvature(structure: Structure, tables: Tables, positions: Array) -> tuple[Array, Array]:
    """Return the Hessian of the smoothness, and the Gauss-Newton Hessian of the penalty, of a motion (N, n) by its
    waypoints between the ends, one after another: (M n, M n) both."""
    q, of, (count, n) = _samples(tables, positions), _measured(structure, tables), positions.shape
    blocks = jnp.zeros((len(q), n, n))  # by the samples
    points, moved = _seen(structure, tables, q), jax.jacfwd(lambda by: _points(structure, tables, q + by))(jnp.zeros(n))
    for (table, at), along in zip(points, moved, strict=True):
        distance, back = jax.vjp(lambda x, table=table: of(table, x), at)  # each of its own pair's points alone
        slope = jnp.einsum("spvi,spvij->spj", *back(jnp.ones_like(distance)), along)
        share = jnp.asarray(tables.share)[:, None] * (distance < 0)
        blocks += jnp.einsum("sp,spi,spj->sij", share, slope, slope)
    interval, fraction = jnp.asarray(tables.interval), jnp.asarray(tables.fraction)[:, None]
    before, after = (jax.nn.one_hot(at, count, dtype=blocks.dtype) for at in (interval, interval + 1))
    spread = ((1 - fraction) * before + fraction * after)[:, 1:-1]  # from waypoints to samples
    bent = jnp.einsum("sk,sl,sij->kilj", spread, spread, blocks).reshape((count - 2) * n, -1)
    return jnp.kron(jnp.asarray(tables.smoothness)[1:-1, 1:-1], jnp.eye(n)), bent


def _samples(tables: Tables, positions: Array) -> Array:
    """Return the sampled configurations (..., B, n) of motions (..., N, n)."""
    interval, fraction = jnp.asarray(tables.interval), jnp.asarray(tables.fraction)[:, None]
    return (1 - fraction) * positions[..., interval, :] + fraction * positions[..., interval + 1, :]


def _measured(structure: Structure, tables: Tables) -> Callable[[PairTable, Array], Array]:
    """Return the function of pairs, and of their vertices as the planes' frames see them, that gives D (..., P) [m];
    inf for what only fills the table."""

    def of(table: PairTable, points: Array) -> Array:
        bodies = jnp.asarray(table.weights), jnp.asarray(table.radius), jnp.asarray(table.planes)
        found = halfspace_distance(points, *bodies, structure.gamma, jnp.asarray(tables.shaping_length))
        return jnp.where(jnp.asarray(table.place) < NO_PLACE, found, jnp.inf)

    return of


def _seen(structure: Structure, tables: Tables, q: Array) -> list[tuple[PairTable, Array]]:
    """Return the pairs, and with them their vertices at configurations (..., B, n) in the planes' frames
    (..., B, P, V, 3) [m]."""
    return list(zip(tables.pairs, _points(structure, tables, q), strict=True))


def _points(structure: Structure, tables: Tables, q: Array) -> list[Array]:
    turns, origins = _frames(structure, tables, q)
    found = []
    for table in tables.pairs:
        (of_a, of_b), vertices = jnp.moveaxis(jnp.asarray(table.frames), -1, 0), jnp.asarray(table.vertices)
        turned = turns[..., of_b, :, :].swapaxes(-1, -2)
        turn = turned @ turns[..., of_a, :, :]
        offset = jnp.einsum("...pij,...pj->...pi", turned, origins[..., of_a, :] - origins[..., of_b, :])
        found.append(jnp.einsum("...pij,pvj->...pvi", turn, vertices) + offset[..., None, :])
    return found


def _frames(structure: Structure, tables: Tables, q: Array) -> tuple[Array, Array]:
    """Return the frames of the world, of all joints and of moving obstacles at configurations (..., B, n): rotations
    (..., B, nj + f, 3, 3) and origins (..., B, nj + f, 3) [m]."""
    values = q[..., jnp.array(structure.leaders)] * tables.factor + tables.offset
    leading, one = q.shape[:-1], jnp.eye(3)
    turns, origins = [jnp.broadcast_to(one, (*leading, 3, 3))], [jnp.zeros((*leading, 3))]
    tree = zip(structure.parents, structure.coordinates, structure.turning, strict=True)
    for row, (parent, coordinate, turning) in enumerate(tree):
        placed, axis, value = jnp.asarray(tables.placed[row]), jnp.asarray(tables.axes[row]), values[..., coordinate]
        turn = turns[parent] @ placed[:9].reshape(3, 3)
        origin = origins[parent] + turns[parent] @ placed[9:]
        if turning:
            angle, outer = value[..., None, None], jnp.outer(axis, axis)
            turn = turn @ (outer + jnp.cos(angle) * (one - outer) + jnp.sin(angle) * jnp.cross(axis, one).T)
        else:
            origin = origin + (turn @ axis) * value[..., None]
        turns.append(turn)
        origins.append(origin)
    every = jnp.stack(turns, axis=-3), jnp.broadcast_to(tables.turns, (*leading, *tables.turns.shape[1:]))
    centres = jnp.stack(origins, axis=-2), jnp.broadcast_to(tables.origins, (*leading, *tables.origins.shape[1:]))
    return jnp.concatenate(every, axis=-3), jnp.concatenate(centres, axis=-2)
