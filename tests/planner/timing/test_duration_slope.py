"""Laws of how the fastest law's duration changes with its path: difference quotients agree, but at kinks, and the
duration is that of the law; with torques, too; gravity that is too much alone is reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from hdplan import HdplanError, Payload, load_scene
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.duration_slope import SlopedLimit, duration_slope
from hdplan.planner.timing.limits import RateLimit
from hdplan.planner.timing.path_spline import smooth
from hdplan.planner.timing.time_optimal import OnGrid, time_optimal
from hdplan.planner.timing.torque_limit import TorqueLimit
from hdplan.scenes.array_types import Array

STEP = 1e-6  # [rad]
SMOOTH = 1e-3  # relative difference of the quotients ahead and behind, above which there is a kink


def carrying(payload: float) -> tuple[Setup, TorqueLimit]:
    """The Panda with a mass [kg] in its hand, and its torques as limits."""
    scene = load_scene("panda_heavy")
    setup = Setup.of(replace(scene, attached=(), payload=Payload("panda_hand", payload, (0.0, 0.0, 0.1))))
    return setup, TorqueLimit(setup)


def compared(path: Array, limits: Sequence[SlopedLimit], rng: np.random.Generator) -> bool:
    """Compare the slope with difference quotients in a random direction; False at a kink, where there is none."""
    duration, slope = duration_slope(path, limits)
    rows = [limit.rows(OnGrid.of(smooth(path))) for limit in limits]
    assert duration == pytest.approx(time_optimal([each for each in rows if each is not None]).duration, rel=1e-9)
    way = rng.normal(size=path.shape)
    ahead, behind = (
        sign * (duration_slope(path + sign * STEP * way, limits)[0] - duration) / STEP for sign in (1.0, -1.0)
    )
    if abs(ahead - behind) > SMOOTH * max(abs(ahead), abs(behind)):
        return False
    assert np.sum(slope * way) == pytest.approx(0.5 * (ahead + behind), rel=2 * SMOOTH)
    return True


def test_the_slope_is_the_difference_quotient_but_at_kinks() -> None:
    rng, smooth_ones = np.random.default_rng(4), 0
    for _ in range(20):
        n, count = int(rng.integers(1, 8)), int(rng.integers(6, 33))
        path = rng.normal(size=n) + np.cumsum(np.cumsum(rng.normal(size=(count, n)), axis=0), axis=0) / count
        limits = [RateLimit(1, rng.uniform(0.5, 3.0, n)), RateLimit(2, rng.uniform(1.0, 15.0, n))]
        smooth_ones += compared(path, limits, rng)
    assert smooth_ones >= 12


def test_the_slope_with_torques_is_the_difference_quotient_but_at_kinks() -> None:
    rng, (setup, torques) = np.random.default_rng(2), carrying(3.0)
    limits = [RateLimit(1, np.full(7, 2.0)), RateLimit(2, np.full(7, 15.0)), torques]
    middle, bound, smooth_ones = 0.5 * (setup.robot.lower + setup.robot.upper), 0, 0
    for _ in range(10):
        shape = np.sin(np.linspace(0.0, 3.0, 32)[:, None] + rng.uniform(0.0, 3.0, 7)) * rng.uniform(0.2, 0.6, 7)
        path = middle + shape
        smooth_ones += compared(path, limits, rng)
        bound += duration_slope(path, limits)[0] > 1.001 * duration_slope(path, limits[:2])[0]
    assert smooth_ones >= 5
    assert bound >= 5  # else the law says nothing of torques


def test_gravity_alone_that_is_too_much_is_reported() -> None:
    setup, torques = carrying(20.0)
    outstretched = np.linspace([0.0, 1.5, 0.0, -0.1, 0.0, 1.6, 0.0], [0.5, 1.5, 0.0, -0.1, 0.0, 1.6, 0.5], 16)
    with pytest.raises(HdplanError, match="gravity alone"):
        duration_slope(outstretched, [RateLimit(2, np.full(setup.robot.n, 15.0)), torques])
