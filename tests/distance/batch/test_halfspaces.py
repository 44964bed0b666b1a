"""The planner's distance in JAX, of arrays of pairs, is its definition, and so are its derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hdplan.distance.holder import holder_maximum, holder_minimum, shaping
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import LazyModule
from tests.extras import jax, needs, quick_jit

halfspaces: Any = LazyModule("hdplan.distance.batch.halfspaces")
pytestmark = needs("jax")

LENGTH = 1e-3
PLACES = (1.5, 0.3, 0.05, 1e-4, 0.0)  # [m] of the body beside, in and deep in the planes


def bodies(seed: int) -> tuple[Array, ...]:
    """Points (5, 3) at each place, with one slot that repeats another, and seven planes."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.1, 0.1, (5, 3)) + np.array(PLACES)[:, None, None] * [1.0, 0.2, -0.3]
    points[:, 4] = points[:, 0]
    normals = rng.normal(size=(3, 7))
    normals /= np.linalg.norm(normals, axis=0)
    return points, np.array([1.0, 1.0, 2.0, 1.0, 0.0]), np.array(0.02), np.vstack([normals, np.full(7, 0.2)])


def defined(points: Array, drawn: list[tuple[Array, ...]], gamma: int) -> Array:
    """The distances of bodies drawn, at all of their places."""

    def one(points: Array, weights: Array, radius: Array, planes: Array) -> Array:
        along = planes[:3].T @ points.T - radius - planes[3][:, None]
        inner = shaping(holder_minimum(along, gamma, weights), gamma, LENGTH)
        return shaping(holder_maximum(inner, gamma), gamma, LENGTH)

    return np.array([[one(each, *rest) for each in row] for row, (_, *rest) in zip(points, drawn, strict=True)])


@pytest.mark.parametrize(("gamma", "x64"), [(1, True), (2, True), (32, False)])
def test_value_and_slope_are_the_definitions_however_many_at_once(gamma: int, x64: bool) -> None:
    """Single precision too, where powers of a distance would overflow."""
    drawn = [bodies(seed) for seed in range(20)]
    points, weights, radius, planes = (np.stack(each) for each in zip(*drawn, strict=True))
    pairs = tuple(part[:, None] for part in (weights, radius, planes))  # each at five places

    def total(points: Any, *pairs: Any) -> tuple[Any, Any]:
        values = halfspaces.halfspace_distance(points, *pairs, gamma, LENGTH)
        return values.sum(), values

    with jax.enable_x64(x64):
        slope, found = map(np.array, quick_jit(jax.grad(total, has_aux=True))(points, *pairs))
    expected = defined(points, drawn, gamma)
    np.testing.assert_allclose(found, expected, rtol=1e-12 if x64 else 1e-4, atol=0 if x64 else 1e-6)
    assert ((found > 0) == (expected > 0)).all()
    assert (expected < -0.01).any()
    assert (expected > 0.1).any()
    assert np.isfinite(slope).all()
    assert (slope[:, :, 4] == 0).all()  # of the slot that does not count
    step = 1e-6 * np.random.default_rng(0).normal(size=points.shape)
    step[:, :, 4] = 0.0
    ahead, behind = (defined(moved, drawn, gamma) for moved in (points + step, points - step))
    change = np.einsum("spvi,spvi->sp", slope, 2 * step)
    np.testing.assert_allclose(ahead - behind, change, rtol=1e-4 if x64 else 1e-2, atol=1e-11 if x64 else 1e-8)


def test_second_derivatives_are_the_slopes_of_the_first_where_vertices_tie_too() -> None:
    """Derivatives by points, radius and planes, outside and in contact."""
    several, weights, *rest = bodies(3)

    def of(points: Any, radius: Any, planes: Any) -> Any:
        return halfspaces.halfspace_distance(points, weights, radius, planes, 2, LENGTH)

    rng = np.random.default_rng(1)
    with jax.enable_x64(True):
        slopes = jax.grad(of, argnums=(0, 1, 2))
        both = quick_jit(lambda at, way: jax.jvp(slopes, at, way))
        for points in several[[0, 2]]:
            points[1] = points[2]
            at = points, *rest
            way = tuple(rng.normal(size=np.shape(part)) for part in at)
            ahead, behind = (
                both(tuple(x + h * v for x, v in zip(at, way, strict=True)), way)[0] for h in (1e-6, -1e-6)
            )
            for one, other, bend in zip(ahead, behind, both(at, way)[1], strict=True):
                change = (np.array(one) - np.array(other)) / 2e-6
                np.testing.assert_allclose(bend, change, rtol=1e-5, atol=1e-5 * np.abs(change).max())
