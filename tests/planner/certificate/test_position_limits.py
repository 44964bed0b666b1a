"""Laws of position limits: exact at the ends of a motion and everywhere between, whatever the time it takes."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BPoly

from hdplan import Limits, Scene, Trajectory, certify, load_robot
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.robot_curve import beyond_limits
from hdplan.planner.robot.scene_robot import load_scene_robot

PANDA = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571)


@pytest.mark.parametrize("held", [1, 2, 3])
def test_a_motion_is_beyond_where_a_dense_look_finds_it_beyond(held: int) -> None:
    """Judged by SciPy's polynomials; limits lie closely around what the motion does, or cut off its peak a little."""
    robot, rng = load_robot("panda"), np.random.default_rng(held)
    verdicts = {True: 0, False: 0}
    for trial in range(40):
        times = np.cumsum(rng.uniform(0.1, 2.0, 4))
        values = rng.normal(size=(3, 4, 7))
        curve = Curve.through(values[0], times, *values[1:held])
        other = BPoly.from_derivatives(times, np.stack(values[:held], axis=1))
        dense = other(np.concatenate([np.linspace(a, b, 4001) for a, b in itertools.pairwise(times)]))
        joint, room = int(rng.integers(7)), 10.0 ** rng.uniform(-6, -1)
        lower, upper = dense.min(axis=0) - 1e-5, dense.max(axis=0) + 1e-5
        fits = trial % 2 == 0
        if not fits and trial % 4 == 1:
            upper[joint] = dense[:, joint].max() - room
        elif not fits:
            lower[joint] = dense[:, joint].min() + room
        departures = beyond_limits(curve, replace(robot, lower=lower, upper=upper))
        assert (departures is None) is fits, departures
        if not fits:
            assert robot.joint_names[joint] in str(departures)
        stretch = 10.0 ** rng.uniform(-3, 3)
        slow = Curve.through(values[0], times * stretch, *(values[i] / stretch**i for i in range(1, held)))
        assert (beyond_limits(slow, replace(robot, lower=lower, upper=upper)) is None) is fits
        verdicts[fits] += 1
    assert min(verdicts.values()) > 15


def test_a_curve_that_ends_on_its_limit_or_touches_it_is_within() -> None:
    robot = load_robot("panda")
    low, high = robot.lower, robot.upper
    rest = np.zeros((2, 7))
    there = Curve.through(np.stack([low, high]), np.array([0.0, 2.0]), rest, rest)
    assert beyond_limits(there, robot) is None
    # q = high − t² on [−1, 1]: it touches the limit in the middle, between two rows
    times, rates = np.array([-1.0, 1.0]), np.stack([rest[0] + 2, rest[0] - 2])
    assert beyond_limits(Curve.through(np.stack([high - 1] * 2), times, rates), robot) is None
    over = Curve.through(np.stack([high - 1 + 1e-8] * 2), times, rates)
    assert "the curve after waypoint 0" in str(beyond_limits(over, robot))


@pytest.mark.parametrize("beyond", [2e-9, 1e-6, 9.9e-4])
@pytest.mark.parametrize("row", [0, 1, 2])
def test_no_end_of_a_scene_lies_beyond_a_limit(row: int, beyond: float) -> None:
    ends = np.array([[*PANDA, 0.2], [*PANDA, 0.1], [*PANDA, 0.3]])
    limits = Limits(position={"panda_joint7": (-0.5, float(ends[row, 6]) - beyond) if row == 2 else (-0.5, 0.3)})
    if row < 2:
        limits = Limits(position={"panda_joint7": (float(ends[row, 6]) + beyond, 0.5)})
    scene = Scene(robot="panda", start=ends[0], goal=ends[2], limits=limits)
    robot = load_scene_robot(scene)
    verdict = certify(scene, Trajectory(robot.joint_names, ends), robot, check_ends=False)
    assert verdict.status is Status.OUTSIDE_LIMITS
    kept = replace(scene, limits=Limits())
    assert certify(kept, Trajectory(robot.joint_names, ends)).certified


def test_the_limits_of_a_request_reach_to_its_own_ends_and_no_farther() -> None:
    """MoveIt's requests are rounded: a start 0.4 mrad beyond a limit is allowed, and nothing beyond it."""
    names = load_robot("panda").joint_names
    high = float(load_robot("panda").upper[6])
    named = [dict(zip(names, (*PANDA, value), strict=True)) for value in (high + 4e-4, high - 0.1)]
    scene = Scene(robot="panda", start=named[0], goal=named[1], from_request=True)
    robot = load_scene_robot(scene)
    assert robot.upper[6] == high + 4e-4
    assert any("panda_joint7" in note and "widened" in note for note in robot.notes)
    rows = np.array([[*PANDA, high + 4e-4], [*PANDA, high], [*PANDA, high - 0.1]])
    assert certify(scene, Trajectory(names, rows), robot).certified
    rows[1, 6] = high + 4.1e-4
    assert certify(scene, Trajectory(names, rows), robot).status is Status.OUTSIDE_LIMITS
