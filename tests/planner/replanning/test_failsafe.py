"""Failsafe motions begin as they are to, keep the limits of rates, and end at standstill, along the nominal way."""

from __future__ import annotations

import numpy as np
import pytest

import hdplan
from hdplan.planner.motion.curve import Curve
from hdplan.planner.replanning.failsafe import FailsafeMotions
from hdplan.planner.replanning.nominal import Nominal
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.robot.setup import Setup
from tests.planner.replanning.driving import limited

H, LEAD = 0.02, 3


@pytest.mark.core
@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(4))
def test_failsafe_motions_keep_the_limits_from_any_state(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = limited("planar_arm")
    limits = Setup.of(scene).limits
    found = hdplan.plan(scene.with_goal([rng.uniform(-1.2, -0.5), 0.4]), seed=seed)
    nominal, motions = Nominal(found.trajectory, 0.0, 0.0), FailsafeMotions(limits, H, LEAD)
    progress, drove = np.array([nominal.begins, 0.0, 0.0]), 0
    for _ in range(60):
        tried = list(motions.of(nominal, progress))
        if not tried:
            break  # what is held brakes
        motion = tried[rng.integers(len(tried))]
        positions, velocities, accelerations = motion.rows
        assert not velocities[-1].any()
        assert not accelerations[-1].any()
        if not motion.moves:
            break
        drove += 1
        curve = Curve.through(positions, H * np.arange(len(positions)), velocities, accelerations)
        for name, most in limits.items():
            assert (curve.over_time(DERIVATIVES[name]).largest() <= most).all(), name
        for mine, whole in zip(nominal.driven(progress[None]), motion.rows, strict=True):
            if nominal.begins < progress[0]:
                np.testing.assert_allclose(whole[0], mine[0], atol=1e-9)
        progress = motion.law[min(2, len(motion.law) - 1)]
    assert drove > 8


def test_another_rest_goes_on_without_a_jump() -> None:
    scene = limited("planar_arm")
    one = Nominal(hdplan.plan(scene).trajectory, 0.0, 0.0)
    row = len(one.motion) // 2
    first = (getattr(one.motion, name)[row].tolist() for name in ("positions", "velocities", "accelerations"))
    other = Nominal(hdplan.plan(scene.with_start(hdplan.State(*first)).with_goal([0.6, 0.2])).trajectory, 0.0, 0.0)
    joined = one.continued(0.1, row, other)
    assert joined.motion.times is not None
    at = one.begins + np.array([0.15, 0.3]) * (one.ends - one.begins)
    s = float(one.motion.times[row])  # type: ignore[index]
    law = np.stack([[*at, s - 1e-9, s, s + 1e-9], np.full(5, 0.7), np.full(5, -0.3)], axis=1)
    for mine, whole in zip(one.driven(law[:3]), joined.driven(law[:3]), strict=True):
        np.testing.assert_allclose(whole, mine, atol=1e-9)
    for rows, most in zip(joined.driven(law), (1e-7, 1e-6, 1e-5), strict=True):
        assert np.abs(np.diff(rows[2:], axis=0)).max() < most
    np.testing.assert_allclose(joined.motion.positions[-1], [0.6, 0.2])
