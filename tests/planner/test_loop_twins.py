"""Loops of C against their twins, at odd sizes and odd numbers: empty, one row, not a power of two; subnormal, huge,
not a number."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hdplan.planner.kinematics import forward
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.motion import motion_bounds
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.problem import path_speed, samples
from hdplan.planner.problem.path_speed import PathSpeed
from hdplan.planner.problem.samples import Samples
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.solvers import newton_step
from hdplan.scenes.array_types import Array
from hdplan.scenes.robot_spec import RobotSpec
from tests.loops import in_numpy, needs_loops

ODD = (5e-324, -5e-324, 1e-310, 0.0, -0.0, 1e150, -1e150)
NOT_FINITE = (np.nan, np.inf, -np.inf)

pytestmark = needs_loops


def odd(rng: np.random.Generator, shape: tuple[int, ...], among: tuple[float, ...], share: float = 0.3) -> Array:
    return np.where(rng.random(shape) < share, rng.choice(among, shape), rng.normal(size=shape))


@pytest.fixture(scope="module")
def pr2() -> Robot:
    return load_robot(RobotSpec("pr2"))


@pytest.mark.parametrize("batch", [0, 1, 3, 7, 17])
def test_forward(batch: int, pr2: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    kinematics, rng = Kinematics(pr2.model), np.random.default_rng(batch)
    q = odd(rng, (batch, kinematics.n), (5e-324, -1e-310, 0.0, 40.0, -3e3))
    found = kinematics.evaluate(q)
    beyond = kinematics.evaluate(odd(rng, q.shape, NOT_FINITE))
    assert found.placements.shape == beyond.placements.shape == (batch, kinematics.nj, 12)
    if batch == 0:
        return
    in_numpy(monkeypatch, forward)
    twin = kinematics.evaluate(q)
    scale = max(np.abs(twin.placements).max(), 1.0)
    np.testing.assert_allclose(found.placements, twin.placements, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(found.columns, twin.columns, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("counts", [(1,), (3, 1, 2), (1, 1, 1, 1, 7)])
@pytest.mark.parametrize("n", [1, 3, 6])
def test_to_waypoints(counts: tuple[int, ...], n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng, of = np.random.default_rng(n), Samples(counts)
    given = odd(rng, (sum(counts), n), ODD), odd(rng, (sum(counts), n, n), ODD)
    found = of.to_waypoints(*given)
    in_numpy(monkeypatch, samples)
    for one, twin in zip(found, of.to_waypoints(*given), strict=True):
        np.testing.assert_allclose(one, twin, rtol=1e-12, atol=1e-12 * np.abs(twin).max())


@pytest.mark.parametrize("waypoints", [1, 2, 3, 6])
@pytest.mark.parametrize("n", [1, 2, 7])
def test_newton_step(waypoints: int, n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(10 * waypoints + n)
    root = rng.normal(size=(waypoints, n, n)) * 10.0 ** rng.uniform(-3, 3, (waypoints, 1, 1))
    state: Any = SimpleNamespace(
        gradient=odd(rng, (waypoints, n), (5e-324, 0.0, -0.0)),
        diagonal=root @ root.transpose(0, 2, 1),
        coupling=1e-6 * rng.normal(size=(waypoints - 1, n, n)),
    )
    smooth = np.zeros((3, waypoints))
    smooth[0], smooth[1, : waypoints - 1], smooth[2, : max(waypoints - 2, 0)] = 6.0, -1.5, 0.5
    limits = np.full(n, -0.3), np.full(n, 0.3)
    problem: Any = SimpleNamespace(robot=SimpleNamespace(inner=limits), smoothness=SimpleNamespace(diagonals=smooth))
    positions = rng.choice([-0.3, 0.0, 0.1, 0.3], (waypoints + 2, n))
    found = newton_step.newton_step(problem, positions, state, 1e-3)
    in_numpy(monkeypatch, newton_step)
    twin = newton_step.newton_step(problem, positions, state, 1e-3)
    np.testing.assert_allclose(found, twin, rtol=1e-7, atol=1e-9 * np.abs(twin).max())


@pytest.mark.parametrize("waypoints", [1, 2, 6])
@pytest.mark.parametrize("n", [1, 3, 7])
def test_path_speed(waypoints: int, n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Joints without a limit, steps that stand, and steps of any size."""
    rng = np.random.default_rng(waypoints + 10 * n)
    cost = PathSpeed(rng.choice([0.1, 2.0, np.inf], n, p=[0.4, 0.4, 0.2]) if n > 1 else np.ones(1))
    for size in (1e-12, 1.0, 1e6):
        positions = np.cumsum(size * rng.normal(size=(waypoints, n)) * rng.choice([0.0, 1.0], (waypoints, 1)), axis=0)
        loop = cost.value(positions)
        with monkeypatch.context() as patch:
            in_numpy(patch, path_speed)
            twin = cost.value(positions)
        for found, expected in zip(vars(loop).values(), vars(twin).values(), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max(initial=0.0))


@pytest.mark.parametrize("count", [0, 1, 5])
def test_reach(count: int, pr2: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    chain, rng = Chain.of(pr2.model), np.random.default_rng(count)
    n, among, intervals = len(chain.axes), (*ODD[:5], *NOT_FINITE), 3
    joints = rng.integers(0, n + 1, count)
    cylinders, travel = odd(rng, (count, 3), among, 0.1), odd(rng, (n, 2), ODD[:5])
    at = [odd(rng, shape, among, 0.05) for shape in ((intervals, count, 3), (count,), *((intervals, n, 3),) * 2)]
    at.append(odd(rng, (intervals, n), ODD[:5]))  # 0 times what is not a number is not one: only the twin multiplies
    rho = chain.reach_around(joints, cylinders, travel)
    local = chain.local_reach(rho, joints, *at)
    in_numpy(monkeypatch, motion_bounds)
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(local, chain.local_reach(rho, joints, *at), rtol=1e-13, atol=1e-15)
