"""Laws of the path_speed: between the time of the slowest joint and a little more, convex, and exact in its
derivatives."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from hdplan.planner.problem.path_speed import P, PathSpeed
from hdplan.scenes.array_types import Array
from tests.planner.problem.whole_graph import whole_matrix


def a_motion(seed: int) -> tuple[PathSpeed, Array]:
    rng = np.random.default_rng(seed)
    n, count = int(rng.integers(1, 9)), int(rng.integers(3, 12))
    limits = np.exp(rng.normal(size=n))
    if n > 1 and seed % 3 == 0:
        limits[rng.integers(n)] = np.inf
    return PathSpeed(limits), np.cumsum(rng.normal(size=(count, n)), axis=0)


def whole_hessian(path_speed: PathSpeed, motion: Array) -> Array:
    found = path_speed.value(motion)
    return whole_matrix(found.diagonal, found.coupling)


@pytest.mark.parametrize("huge", [1e7, 1e160, 1e308, np.inf])
def test_a_limit_that_no_scene_may_give_is_none(huge: float) -> None:
    """A URDF may hold any number; the squares of such limits would overflow."""
    limits, motion = np.array([2.0, huge, 0.5]), np.cumsum(np.ones((5, 3)), axis=0)
    found, alone = PathSpeed(limits).value(motion), PathSpeed(limits[::2]).value(motion[:, ::2])
    assert found.cost == pytest.approx(alone.cost, rel=1e-12)
    assert np.allclose(found.gradient[:, ::2], alone.gradient, rtol=1e-12, atol=1e-12)
    assert not found.gradient[:, 1].any()


@pytest.mark.parametrize("seed", range(12))
def test_path_speed_lies_a_little_above_the_slowest_joints_time(seed: int) -> None:
    path_speed, motion = a_motion(seed)
    steps = np.diff(motion, axis=0)
    slowest = (np.abs(steps) * path_speed.shares).max(axis=1)
    least = 0.5 * len(steps) * np.sum(slowest**2)
    cost = path_speed.value(motion).cost
    assert least * (1 - 1e-12) <= cost <= least * motion.shape[1] ** (2 / P) * (1 + 1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_gradient_and_hessian_three_ways(seed: int) -> None:
    path_speed, motion = a_motion(seed)
    found = path_speed.value(motion)
    steps = ca.MX.sym("steps", motion.shape[1], len(motion) - 1)
    expression = path_speed.expression(steps)
    x = ca.MX.sym("x", motion.size)
    rows = ca.reshape(x, motion.shape[1], len(motion))
    whole = ca.substitute(expression, steps, rows[:, 1:] - rows[:, :-1])
    hessian, gradient = ca.hessian(whole, x)
    symbolic = ca.Function("path_speed", [x], [whole, gradient, hessian])
    cost, slope, second_order = (each.full() for each in symbolic(motion.ravel()))
    assert found.cost == pytest.approx(cost.item(), rel=1e-9)
    np.testing.assert_allclose(found.gradient.ravel(), slope.ravel(), atol=1e-8 * np.abs(slope).max())
    np.testing.assert_allclose(whole_hessian(path_speed, motion), second_order, atol=1e-7 * np.abs(second_order).max())
    rng = np.random.default_rng(seed)
    way = rng.normal(size=motion.shape)
    ahead, behind = (path_speed.value(motion + sign * 1e-6 * way) for sign in (1, -1))
    assert (ahead.cost - behind.cost) / 2e-6 == pytest.approx(np.sum(found.gradient * way), rel=1e-5)
    change = (ahead.gradient - behind.gradient).ravel() / 2e-6
    np.testing.assert_allclose(
        change, whole_hessian(path_speed, motion) @ way.ravel(), atol=1e-3 * np.abs(change).max()
    )


@pytest.mark.parametrize("seed", range(12))
def test_path_speed_is_convex(seed: int) -> None:
    path_speed, motion = a_motion(seed)
    values = np.linalg.eigvalsh(whole_hessian(path_speed, motion))
    assert values[0] >= -1e-9 * values[-1]


def test_a_motion_that_stands_costs_nothing_and_breaks_nothing() -> None:
    found = PathSpeed(np.array([1.0, 2.0])).value(np.zeros((4, 2)))
    assert found.cost == 0.0
    assert not found.gradient.any()
    assert np.isfinite(found.diagonal).all()
