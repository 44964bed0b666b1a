"""Laws of braking: it begins at the given state, ends at rest, keeps its limits everywhere, and takes hardly longer
than a motion that may change its jerk at any time."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.timing.braking import Braking, brake

N, H = 5, 0.01


def drawn(seed: int) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Velocities, accelerations and limits; every third has no acceleration, every other no limit of jerk."""
    rng = np.random.default_rng(seed)
    limits = {"velocity": rng.uniform(1, 3, N), "acceleration": rng.uniform(1, 10, N)}
    if seed % 2:
        limits["jerk"] = rng.uniform(5, 200, N)
    velocity = rng.uniform(-1, 1, N) * limits["velocity"] * rng.choice([0.0, 0.3, 1.0])
    return velocity, rng.uniform(-1, 1, N) * limits["acceleration"] * (seed % 3 > 0), limits


def curve_of(braking: Braking) -> Curve:
    return Curve.through(braking.away, np.arange(len(braking) + 1) * H, braking.velocity, braking.acceleration)


@pytest.mark.core
@pytest.mark.parametrize("swing", [1.0, 3.0])
def test_braking_keeps_its_limits_from_the_state_to_standstill(swing: float) -> None:
    found = 0
    for seed in range(120):
        velocity, acceleration, limits = drawn(seed)
        braking = brake(velocity, acceleration, limits, H, swing)
        if isinstance(braking, int):  # its acceleration carries it beyond its velocity, however soon that changes
            v, a, most = velocity[braking], acceleration[braking], limits["velocity"][braking]
            jerk = swing * limits["jerk"][braking] if "jerk" in limits else np.inf
            assert v * np.sign(a) + a * a / (2 * jerk) + 2 * H * abs(a) > most
            continue
        found += len(braking) > 0
        assert (braking.velocity[0] == velocity).all()
        assert (braking.acceleration[0] == acceleration).all()
        assert not braking.velocity[-1].any()
        assert not braking.acceleration[-1].any()
        assert not braking.away[-1].any()
        if not len(braking):
            assert not velocity.any()
            continue
        curve = curve_of(braking)
        for name, most in limits.items():
            largest = curve.over_time(DERIVATIVES[name]).largest()
            assert (largest <= most * (swing if name == "jerk" else 1.0) * (1 + 1e-9)).all(), (seed, name)
        for order, state in ((1, velocity), (2, acceleration)):
            assert curve.over_time(order).jumps(state).max() < 1e-8
    assert found > 70


def test_braking_takes_hardly_longer_than_it_must() -> None:
    """A velocity alone takes, with limits a and j, v/a + a/j, or 2 √(v/j) if a is not reached."""
    for seed in range(0, 120, 3):
        velocity, acceleration, limits = drawn(seed)
        braking = brake(velocity, acceleration, limits, H)
        assert isinstance(braking, Braking)
        a, j = limits["acceleration"], limits.get("jerk", np.full(N, 1e12))
        v = np.abs(velocity)
        least = np.where(v >= a * a / j, v / a + a / j, 2 * np.sqrt(v / j)).max()
        assert least - 1e-9 <= len(braking) * H <= least + 3 * H


def test_backwards_is_the_way_to_a_velocity() -> None:
    velocity, acceleration, limits = drawn(7)
    forwards, mirrored = brake(velocity, acceleration, limits, H), brake(-velocity, -acceleration, limits, H)
    assert isinstance(forwards, Braking)
    assert isinstance(mirrored, Braking)
    np.testing.assert_array_equal(forwards.away, -mirrored.away)
    back = forwards.backwards
    assert (back.velocity[-1] == -velocity).all()
    assert (back.acceleration[-1] == acceleration).all()
    assert curve_of(back).over_time(1).jumps(0.0, -velocity).max() < 1e-9
    assert curve_of(back).over_time(2).jumps(0.0, acceleration).max() < 1e-8
