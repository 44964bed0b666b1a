"""Limits of rates: growth in steps as small as rounding counts in the sum."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate.limit_checks import ROUNDING_JUMP
from hdplan.planner.certificate.rate_check import RateCheck, slope_of_steps
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array

EXACT = 1e-6  # relative

ARM = hdplan.load_scene("planar_arm")


def least_slope(steps: Array, times: Array) -> float:
    """The definition: over all windows."""
    total = np.concatenate([[0.0], np.cumsum(steps)])
    windows = [(i, j) for j in range(len(steps)) for i in range(j)]
    return max([0.0, *((abs(total[j + 1] - total[i]) - ROUNDING_JUMP) / (times[j] - times[i]) for i, j in windows)])


def test_the_slope_of_steps_is_the_least_that_all_windows_keep() -> None:
    drawn = np.random.default_rng(31)
    found = []
    for _ in range(80):
        count = int(drawn.integers(2, 30))
        times = np.cumsum(drawn.uniform(1e-4, 1e-2, count))
        steps = drawn.uniform(-1.0, 1.0, (count, 2)) + drawn.choice([-0.5, 0.0, 0.9])
        steps = ROUNDING_JUMP * np.clip(steps, -1.0, 1.0)
        expected = [least_slope(column, times) for column in steps.T]
        np.testing.assert_allclose(slope_of_steps(steps, times), expected, rtol=EXACT)
        found += expected
    assert 0.0 in found, "steps that cancel cost nothing"
    assert max(found) > 1e-3


def stair(rise: float, rows: int = 2000, width: float = 1e-3) -> Curve:
    """A motion from rest whose acceleration is constant between rows and grows by `rise` at each, then falls so: the
    jerk between them is zero."""
    up = np.arange(1, rows // 2 + 1) * rise
    half = np.concatenate([up, up[::-1]])
    accelerations = np.concatenate([half, [0.0], -half])
    velocities = np.concatenate([[0.0], np.cumsum(accelerations * width)])
    positions = np.concatenate([[0.0], np.cumsum(0.5 * (velocities[1:] + velocities[:-1]) * width)])
    times = np.arange(len(positions)) * width
    both = np.stack([positions, np.zeros_like(positions)], axis=1)
    return Curve.through(both, times, np.stack([velocities, np.zeros_like(velocities)], axis=1))


@pytest.mark.parametrize("rise", [9e-7, 3e-7])
def test_a_jerk_that_is_spread_over_steps_is_counted(rise: float) -> None:
    """9e-7 rad/s² a row of 1 ms are 9e-4 rad/s³."""
    curve, jerk = stair(rise), rise / 1e-3
    assert curve.over_time(2).jumps().max() < ROUNDING_JUMP
    for limit, within in ((1.05 * jerk, True), (0.9 * jerk, False)):
        scene = dataclasses.replace(ARM, limits=hdplan.Limits(jerk=limit))
        finding = RateCheck(Setup.of(scene)).check(curve)
        use = next(use for use in finding.uses if use.quantity == "jerk")
        assert (use.within, use.joint) == (within, "shoulder")
        assert use.share == pytest.approx(jerk / limit, rel=0.02)
        assert [status for status, _ in finding.complaints] == ([] if within else [Status.TOO_FAST])


def test_an_acceleration_that_is_spread_over_steps_is_counted() -> None:
    """Straight pieces with times: all of their acceleration is in the steps of the velocity."""
    rise, width = 5e-7, 1e-3
    velocities = np.concatenate([np.arange(1, 1001), np.arange(1000, -1, -1)]) * rise
    positions = np.concatenate([[0.0], np.cumsum(velocities * width)])
    times = np.arange(len(positions)) * width
    curve = Curve.through(np.stack([positions, 0.0 * positions], axis=1), times)
    scene = dataclasses.replace(ARM, limits=hdplan.Limits(acceleration=0.9 * rise / width))
    use = next(use for use in RateCheck(Setup.of(scene)).check(curve).uses if use.quantity == "acceleration")
    assert 1.0 < use.share < 1.2
