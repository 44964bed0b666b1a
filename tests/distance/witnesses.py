"""The distance's witnesses behind one interface: NumPy, CasADi (interpreted, compiled, in a graph) and JAX (batch)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from hdplan.distance.normals import check_witnesses
from hdplan.distance.numpy_reference.hdsdf import hdsdf_derivatives, separation
from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled, twist_function
from hdplan.distance.symbolic.graph_distance import hdsdf_function
from hdplan.scenes.array_types import Array

ROUNDING = 32 * float(np.finfo(float).eps)


class Evaluation(NamedTuple):
    """D, D-tilde, and D's derivatives by twists of both bodies."""

    value: Array
    separation: Array
    gradient: Array
    hessian: Array


Evaluate = Callable[..., Evaluation]  # (pose_a, pose_b[, witnesses])


@cache
def evaluator(
    name: str,
    body_a,
    body_b,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    normals: str = "paper",
    witness_count: int = 0,
    dtype: str = "float64",
) -> Evaluate:
    """Return the distance of a pair by a witness, built once for each pair and settings.

    ``name``: numpy, casadi, compiled (casadi's as C, which takes seconds a pair) or jax (seconds for each new shape);
    graph and grad: what CasADi and JAX themselves make of ``hdsdf_function`` and of the batch's value, differentiated.
    """
    if name == "numpy":
        return _numpy(body_a, body_b, gamma, shaping_length, normals)
    if name == "casadi":
        function = twist_function(body_a, body_b, gamma, normals, witness_count, 2)
        return _interpreted(function, shaping_length)
    if name == "graph":
        return _in_a_graph(body_a, body_b, gamma, shaping_length, normals)
    settings = {"gamma": gamma, "shaping_length": shaping_length, "normals": normals, "witness_count": witness_count}
    if name == "compiled":
        return _at_once(hdsdf_compiled(body_a, body_b, **settings))
    pytest.importorskip("jax")
    from hdplan.distance.batch.distance import hdsdf_batch

    distance = hdsdf_batch(body_a, body_b, dtype=dtype, **settings)
    return _differentiated_by_jax(distance) if name == "grad" else _at_once(distance)


def _numpy(body_a, body_b, gamma: int, shaping_length: float, normals: str) -> Evaluate:
    def evaluate(pose_a, pose_b, witnesses=None) -> Evaluation:
        more = {"normals": normals, "witnesses": witnesses}
        found = hdsdf_derivatives(body_a, pose_a, body_b, pose_b, gamma=gamma, shaping_length=shaping_length, **more)
        least = separation(body_a, pose_a, body_b, pose_b, **more)
        return Evaluation(found.value, least, found.gradient, found.hessian)

    return evaluate


def _interpreted(function, shaping_length: float) -> Evaluate:
    def evaluate(pose_a, pose_b, witnesses=None) -> Evaluation:
        arrays = np.asarray(pose_a), np.asarray(pose_b), check_witnesses(witnesses)
        shape = np.broadcast_shapes(*(array.shape[:-2] for array in arrays))
        rows = [np.broadcast_to(array, shape + array.shape[-2:]) for array in arrays]
        found = [
            function(rows[0][i].ravel(), rows[1][i].ravel(), shaping_length, rows[2][i].ravel())
            for i in np.ndindex(shape)
        ]
        results = (np.array([np.array(result[k]) for result in found]) for k in range(4))
        return Evaluation(*(r.reshape(shape + s) for r, s in zip(results, ((), (), (12,), (12, 12)), strict=True)))

    return evaluate


def _in_a_graph(body_a, body_b, gamma: int, shaping_length: float, normals: str) -> Evaluate:
    """``ca.hessian`` by twists of both poses; D̃ is not there, and the reference's is taken."""
    settings = {"gamma": gamma, "shaping_length": shaping_length, "normals": normals}
    distance = hdsdf_function(body_a, body_b, **settings)
    pose_a, pose_b, twist = ca.MX.sym("a", 4, 4), ca.MX.sym("b", 4, 4), ca.MX.sym("twist", 12)
    value = distance(_moved_in_casadi(pose_a, twist[:6]), _moved_in_casadi(pose_b, twist[6:]))
    hessian, gradient = ca.hessian(value, twist)
    function = ca.Function("graph", [pose_a, pose_b, twist], [value, gradient, hessian])

    def evaluate(pose_a, pose_b) -> Evaluation:
        rows = np.broadcast_arrays(pose_a, pose_b)
        found = [function(rows[0][i], rows[1][i], np.zeros(12)) for i in np.ndindex(rows[0].shape[:-2])]
        parts = [np.array([np.array(row[k]) for row in found]) for k in range(3)]
        shapes = ((), (12,), (12, 12))
        parts = [part.reshape(rows[0].shape[:-2] + shape) for part, shape in zip(parts, shapes, strict=True)]
        least = separation(body_a, pose_a, body_b, pose_b, normals=normals)
        return Evaluation(parts[0], least, parts[1], parts[2])

    return evaluate


def _moved_in_casadi(pose, twist):
    turn = ca.skew(twist[3:])
    step = ca.vertcat(ca.horzcat(turn, twist[:3]), ca.MX(1, 4))
    return pose @ (ca.MX.eye(4) + step + step @ step / 2)


def _differentiated_by_jax(distance) -> Evaluate:
    """``jax.grad`` and ``jax.hessian`` of the value, under ``vmap`` and ``jit``."""
    import jax
    import jax.numpy as jnp

    def moved(pose, twist):
        (x, y, z), (a, b, c) = twist[:3], twist[3:]
        step = jnp.array([[0.0, -c, b, x], [c, 0.0, -a, y], [-b, a, 0.0, z], [0.0, 0.0, 0.0, 0.0]])
        return pose @ (jnp.eye(4) + step + step @ step / 2)

    def value(twist, pose_a, pose_b):
        return distance.value(moved(pose_a, twist[:6]), moved(pose_b, twist[6:]))[0]

    def every(pose_a, pose_b):
        rest = jnp.zeros(12)
        found, least = distance.value(pose_a, pose_b)
        return found, least, jax.grad(value)(rest, pose_a, pose_b), jax.hessian(value)(rest, pose_a, pose_b)

    def evaluate(pose_a, pose_b) -> Evaluation:
        with jax.enable_x64(True):
            rows = np.broadcast_arrays(pose_a, pose_b)
            flat = [jnp.asarray(row.reshape(-1, 4, 4)) for row in rows]
            found = [np.asarray(part) for part in jax.jit(jax.vmap(every))(*flat)]
            return Evaluation(*(part.reshape(rows[0].shape[:-2] + part.shape[1:]) for part in found))

    return evaluate


def _at_once(distance) -> Evaluate:
    def evaluate(*poses_and_witnesses) -> Evaluation:
        return Evaluation(*(np.asarray(part, dtype=float) for part in distance.hessian(*poses_and_witnesses)))

    return evaluate


def agree(one: Evaluation, other: Evaluation, poses, bodies, gamma: int, smooth: bool = True) -> None:
    """Assert that two evaluations are equal pose by pose, to relative errors of ``ROUNDING`` p² size/|D-tilde|.

    D grows as the (p²)-th power of the gap near contact, so the rounding of coordinates of that size shows p² size/gap
    times in D, in its gradient and in its Hessian. ``smooth``: the Hessian has one value there for gamma = 1 too.
    """
    size = np.max([np.abs(pose[..., :3, 3]).max(-1) for pose in poses], axis=0) + sum(body.reach for body in bodies)
    noise = ROUNDING * size
    assert np.all(np.abs(one.separation - other.separation) <= noise)
    relative = (gamma + 1) ** 2 * noise / np.maximum(np.abs(one.separation), 1e-300)
    significant = relative < 0.5  # elsewhere the gap is nothing but rounding
    assert np.all(np.abs(other.value - one.value)[~significant] <= noise[~significant])
    if gamma == 1 and not smooth:
        one, other = (part._replace(hessian=part.hessian * 0.0) for part in (one, other))
    for x, y in zip(_rows(one, size), _rows(other, size), strict=True):
        worst, scale = np.abs(x - y).max(-1), np.abs(x).max(-1)
        assert np.all(np.isfinite(worst))
        assert np.all(worst[significant] <= relative[significant] * scale[significant] + 1e-280)


def _rows(found: Evaluation, size: Array) -> tuple[Array, Array, Array]:
    """Return value, gradient and Hessian as rows, by twists whose translations are of the size; each with the ones
    before, whose rounding it has."""
    lever = np.repeat(np.stack([size, np.ones_like(size)] * 2, -1), 3, axis=-1)
    value = found.value[..., None]
    slopes = np.concatenate([value, found.gradient * lever], -1)
    curvatures = found.hessian * lever[..., None] * lever[..., None, :]
    return value, slopes, np.concatenate([slopes, curvatures.reshape(*size.shape, -1)], -1)
