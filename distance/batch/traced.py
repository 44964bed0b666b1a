"""The JAX batch inside JAX's own transformations: grad, hessian, jit, vmap and scan, in any order.

Derivatives are the kernel's closed forms, handed to JAX order by order (``custom_jvp``): automatic ones would be wrong
where vertices or axes tie. They are along rigid motions: of a change in a pose's entries only the twist in it counts.
Under ``vmap`` the poses are stacked and go through the kernel at once.
"""

from __future__ import annotations

from functools import cache, partial
from math import prod
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from hdplan.distance.batch.kernel import Places
from hdplan.distance.batch.tables import FARTHEST_POSITION
from hdplan.distance.batch.unions import Pairs, evaluate, separation_gradient
from hdplan.distance.normals import check_witness_count
from hdplan.distance.poses import FARTHEST_POSE, RIGID_ERROR
from hdplan.scenes.errors import InputError

Array = jax.Array

ORDERS = 2  # of derivatives in closed form


class Settings(NamedTuple):
    """The settings of a traced function."""

    gamma: int
    dtype: str  # in which the kernel computes
    lanes: int
    order: int  # of the derivatives that are returned; -1: the gradient of D̃ alone


def traced(
    pairs: Pairs, length: float, pose_a: Any, pose_b: Any, witnesses: Any, witness_count: int, settings: Settings
) -> list[Array]:
    """Return D, D̃ (...,) and the derivatives of D by twists up to the order, for traced poses (..., 4, 4).

    In the precision of the poses; NaN where a pose is not rigid. Raises InputError for other shapes.
    """
    poses = [_pose(name, pose) for name, pose in (("pose_a", pose_a), ("pose_b", pose_b))]
    dtype = jnp.result_type(*poses)
    units = jnp.zeros((0, 3), dtype) if witnesses is None else jnp.asarray(witnesses, dtype)
    if units.ndim < 2 or units.shape[-1] != 3:
        raise InputError(f"witnesses: found an array of shape {units.shape}, allowed are nonzero vectors (..., W, 3)")
    check_witness_count(units.shape, witness_count)
    units = lax.stop_gradient(units / jnp.linalg.norm(units, axis=-1, keepdims=True))
    parts = [*(pose.astype(dtype) for pose in poses), units]
    shape = np.broadcast_shapes(*(part.shape[:-2] for part in parts))
    rows = [jnp.broadcast_to(x, shape + x.shape[-2:]).reshape(prod(shape), *x.shape[-2:]) for x in parts]
    found = _distance(settings, pairs, jnp.asarray(length, dtype), *rows)
    return [part.reshape(shape + part.shape[1:]) for part in found]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _distance(
    settings: Settings, pairs: Pairs, length: Array, a: Array, b: Array, witnesses: Array
) -> tuple[Array, ...]:
    found: tuple[Array, ...] = _many(settings)(pairs, length, a, b, witnesses)
    return found


@_distance.defjvp
def _change(
    settings: Settings, primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Return the results and their changes: each order's derivative is the next order."""
    if settings.order == ORDERS:
        raise InputError("hdsdf_batch: a third derivative is not available; allowed: first and second ones")
    pairs, length, a, b, witnesses = primals
    twists = jnp.concatenate([_twist(a, tangents[2]), _twist(b, tangents[3])], axis=-1)
    found = _distance(settings._replace(order=settings.order + 1), *primals)
    (of_separation,) = _many(settings._replace(order=-1))(pairs, length, *map(lax.stop_gradient, (a, b, witnesses)))
    changes = [jnp.sum(slopes * twists, axis=-1) for slopes in (found[2], of_separation)]
    if settings.order == 1:
        changes.append(jnp.einsum("nij,nj->ni", found[3], twists) + _bracket(found[2], twists))
    return found[: settings.order + 2], tuple(changes)


@cache
def _many(settings: Settings) -> Any:
    """Return the kernel as a function of rows that stacks the axes of ``vmap``."""

    @jax.custom_batching.custom_vmap
    def run(pairs: Pairs, length: Array, a: Array, b: Array, witnesses: Array) -> tuple[Array, ...]:
        return _run(settings, pairs, length, a, b, witnesses)

    @run.def_vmap
    def _side_by_side(
        size: int, batched: Any, pairs: Pairs, length: Array, *rows: Array
    ) -> tuple[tuple[Array, ...], tuple[bool, ...]]:
        every = [x if own else jnp.broadcast_to(x, (size, *x.shape)) for x, own in zip(rows, batched[2:], strict=True)]
        found = run(pairs, length, *(x.reshape(size * x.shape[1], *x.shape[2:]) for x in every))
        return tuple(x.reshape(size, len(x) // size, *x.shape[1:]) for x in found), (True,) * len(found)

    return run


def _run(settings: Settings, pairs: Pairs, length: Array, a: Array, b: Array, witnesses: Array) -> tuple[Array, ...]:
    """Return the kernel's results for rows of poses, padded to whole blocks of lanes."""
    given, count = a.dtype, len(a)
    lanes = max(1, min(settings.lanes, count))
    mark = jnp.where(_rigid(a) & _rigid(b), 0.0, jnp.nan).astype(given)
    missing = -count % lanes
    with jax.enable_x64(settings.dtype == "float64" or given == np.float64):
        a, b = (lax.convert_element_type(x, jnp.promote_types(given, settings.dtype)) for x in (a, b))
        rows = [a[:, :3, :3], b[:, :3, :3], b[:, :3, 3] - a[:, :3, 3], witnesses]  # rounded to fewer digits afterwards
        rows = [jnp.concatenate([x, jnp.broadcast_to(x[:1], (missing, *x.shape[1:]))]) if missing else x for x in rows]
        mark += jnp.where(
            jnp.all(jnp.abs(rows[2][:count]) <= FARTHEST_POSITION[settings.dtype], -1), 0, jnp.nan
        ).astype(given)
        *places, units = (lax.convert_element_type(x, settings.dtype) for x in rows)
        found: tuple[Array, ...]
        if settings.order < 0:
            found = (separation_gradient(pairs, Places(*places), units, lanes=lanes),)
        else:
            delta = lax.convert_element_type(length, settings.dtype)
            found = evaluate(
                pairs, delta, Places(*places), units, gamma=settings.gamma, order=settings.order, lanes=lanes
            )
        found = tuple(lax.convert_element_type(part, given)[:count] for part in found)
    return tuple(part + mark.reshape(-1, *(1,) * (part.ndim - 1)) for part in found)


@jax.jit
def all_rigid(poses: Array) -> Array:
    """Return whether all poses (..., 4, 4) are rigid and finite."""
    return jnp.all(_rigid(poses))


def _rigid(poses: Array) -> Array:
    """Return whether each pose (..., 4, 4) is rigid, to ``poses.RIGID``, and finite."""
    x, y, z, last = (poses[..., row, :] for row in range(4))
    x, y, z, far = x[..., :3], y[..., :3], z[..., :3], poses[..., :3, 3]
    amiss = jnp.maximum(jnp.abs(jnp.sum(x * x, -1) - 1), jnp.abs(jnp.sum(y * y, -1) - 1))
    amiss = jnp.maximum(amiss, jnp.abs(jnp.sum(x * y, -1)))
    amiss = jnp.maximum(amiss, jnp.max(jnp.abs(jnp.cross(x, y) - z), -1))
    amiss = jnp.maximum(amiss, jnp.max(jnp.abs(last - jnp.array([0, 0, 0, 1], poses.dtype)), -1))
    within = jnp.isfinite(far)
    if poses.dtype == np.float64:  # other types cannot hold anything that far away
        within &= jnp.abs(far) <= FARTHEST_POSE
    return (amiss <= RIGID_ERROR) & jnp.all(within, -1)


def _pose(name: str, pose: Any) -> Array:
    try:
        array = jnp.asarray(pose)
    except (TypeError, ValueError):
        raise InputError(f"{name}: not an array of numbers, allowed is an array (..., 4, 4)") from None
    if array.shape[-2:] != (4, 4) or array.dtype.kind == "c":
        found = f"{array.dtype} array of shape {array.shape}"
        raise InputError(f"{name}: found a {found}, allowed is an array of real numbers (..., 4, 4)")
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(float)


def _twist(pose: Array, change: Array) -> Array:
    """Return the twist (N, 6) in the body's own frame of a change of poses' entries (N, 4, 4)."""
    back = pose[:, :3, :3].swapaxes(1, 2)
    turn = back @ change[:, :3, :3]
    turn = (turn - turn.swapaxes(1, 2)) / 2
    velocity = (back @ change[:, :3, 3:])[..., 0]
    return jnp.concatenate([velocity, jnp.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=-1)], axis=-1)


def _bracket(gradient: Array, twists: Array) -> Array:
    """Return the change of the gradient (N, 12) beside the Hessian's, as twists do not commute: ½ g·[η, ·]."""
    parts = []
    for k in (0, 6):
        force, torque = gradient[:, k : k + 3], gradient[:, k + 3 : k + 6]
        v, omega = twists[:, k : k + 3], twists[:, k + 3 : k + 6]
        parts += [jnp.cross(force, omega), jnp.cross(force, v) + jnp.cross(torque, omega)]
    return jnp.concatenate(parts, axis=-1) / 2
