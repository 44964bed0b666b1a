"""Laws of the reach in C: as in NumPy but for rounding, and what is not a number stays so."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan import RobotSpec, load_robot
from hdplan.planner.motion import motion_bounds
from hdplan.planner.motion.motion_bounds import Chain
from tests.loops import in_numpy, needs_loops

COUNT, INTERVALS = 40, 12  # bodies, intervals

pytestmark = needs_loops


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["panda", "tiago", "baxter", "ur5"])
def test_the_loop_equals_numpy(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    chain, rng = Chain.of(load_robot(RobotSpec(name)).model), np.random.default_rng(2)
    n = len(chain.axes)
    joints = rng.integers(0, n + 1, COUNT)
    cylinders = np.sort(rng.normal(size=(COUNT, 3)), axis=1) + np.array([2.0, 0.0, 0.0])
    travel = np.sort(rng.normal(size=(n, 2)), axis=1)
    centers, radii = rng.normal(size=(INTERVALS, COUNT, 3)), rng.uniform(size=COUNT)
    axes = rng.normal(size=(INTERVALS, n, 3))
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    at = (centers, radii, axes, rng.normal(size=(INTERVALS, n, 3)), rng.uniform(size=(INTERVALS, n)))
    rho = chain.reach_around(joints, cylinders, travel)
    local = chain.local_reach(rho, joints, *at)
    assert (local < rho).any()
    in_numpy(monkeypatch, motion_bounds)
    np.testing.assert_allclose(rho, chain.reach_around(joints, cylinders, travel), rtol=1e-13)
    np.testing.assert_allclose(local, chain.local_reach(rho, joints, *at), rtol=1e-13, atol=1e-15)


def test_nan_proves_nothing() -> None:
    chain = Chain.of(load_robot("panda").model)
    n, joints = len(chain.axes), np.array([len(chain.axes)])
    rho = chain.reach_around(joints, np.array([[0.1, -0.1, 0.1]]), np.zeros((n, 2)))
    at = np.full((1, 1, 3), np.nan), np.ones(1), np.ones((1, n, 3)), np.zeros((1, n, 3)), np.ones((1, n))
    assert np.isnan(chain.local_reach(rho, joints, *at)).any()
