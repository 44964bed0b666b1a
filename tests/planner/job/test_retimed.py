"""Laws of motions that overlap, with a new time law: their path stays, their ends rest, and limits hold all along."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate.end_check import SAME_END
from hdplan.planner.job.blending import LEAST_ROW_GAP, _with_row
from hdplan.planner.job.overlap import overlapped
from hdplan.planner.job.retimed import COUNTS, retimed_path
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.retiming import Retimer


@pytest.mark.parametrize("seed", range(4))
def test_a_retimed_path_stays_and_keeps_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    limits = hdplan.Limits(acceleration=7.5, jerk=500.0)
    setup = Setup.of(hdplan.Scene(robot="panda", start="default", goal="default", limits=limits))
    retimer, robot = Retimer(setup), setup.robot
    ends = [robot.configuration(setup.scene.start)]
    ends += [ends[0] + rng.uniform(-0.3, 0.3, robot.n) * share for share in (1.0, 2.0)]
    one, other = (
        retimer(Trajectory(robot.joint_names, np.linspace(*pair, 8), robot.locked)).trajectory
        for pair in itertools.pairwise(ends)
    )
    assert one.times is not None
    assert other.times is not None
    overlap = 0.4 * min(one.times[-1], other.times[-1])
    whole = overlapped(one, other, float(overlap))
    middle = float(one.times[-1] - 0.5 * overlap)
    found = retimed_path(setup, [(whole, [0.0, middle])], np.ones(2))
    assert len(found) == len(COUNTS)
    assert found == sorted(found, key=lambda each: each[0].duration or 0.0)
    at = whole.curve.at_parameter(np.linspace(0.0, 1.0, 4000))
    for motion, (first, there) in found:
        assert max(limit.stretch(motion.curve) for limit in retimer.limits) <= 1.0 + 1e-9
        assert first == 0.0 < there < (motion.duration or 0.0)
        assert motion.velocities is not None
        assert motion.accelerations is not None
        assert max(np.abs(rows[[0, -1]]).max() for rows in (motion.velocities, motion.accelerations)) < 1e-12
        np.testing.assert_allclose(motion.positions[[0, -1]], whole.positions[[0, -1]], rtol=0.0, atol=1e-12)
        away = np.linalg.norm(motion.positions[:, None] - at, axis=2).min(axis=1)
        assert away.max() < 0.04 * np.linalg.norm(ends[2] - ends[0])
        gone = [np.linalg.norm(np.diff(rows, axis=0), axis=1).sum() for rows in _up_to(motion, there, whole, middle)]
        assert abs(gone[0] - gone[1]) < 0.1 * np.linalg.norm(ends[2] - ends[0])


def test_rows_too_far_apart_for_a_retimed_path_leave_a_stop() -> None:
    """The move at its own pace is within the radius for less than a row; slower, both take longer than with a stop."""
    there = hdplan.Pose.from_rpy([0.45, 0.2, 0.5], [np.pi, 0.0, 0.0])
    move = hdplan.Move(hdplan.PoseTarget("panda_hand_tcp", there, free_rotation="z"), blend=0.01)
    job = hdplan.Job([move, hdplan.Line(by=[0.0, 0.0, -0.1], speed=0.3)])
    limits, timing = hdplan.Limits(acceleration=7.5, jerk=500.0), hdplan.Timing(rate=15.0)
    result = hdplan.plan_job(hdplan.Scene(robot="panda", start="default", limits=limits, timing=timing, job=job))
    assert result.certified, result.text
    assert any("not blended into 'line 1': it would take" in note for note in result.notes)


@pytest.mark.parametrize("seed", range(2))
def test_no_mark_is_so_close_to_a_row_that_accelerations_there_are_rounding(seed: int) -> None:
    """Both sides of a mark have the accelerations of its row, as far as a certificate distinguishes them."""
    rng = np.random.default_rng(seed)
    limits = hdplan.Limits(acceleration=3.0, jerk=60.0)
    setup = Setup.of(hdplan.Scene(robot="panda", start="default", goal="default", limits=limits))
    start = setup.robot.configuration(setup.scene.start)
    path = np.linspace(start, start + rng.uniform(-0.5, 0.5, setup.robot.n), 8)
    motion = Retimer(setup)(Trajectory(setup.robot.joint_names, path, setup.robot.locked)).trajectory
    assert motion.times is not None
    for away in np.outer(np.logspace(-7.0, -3.0, 30), (1.0, -1.0)).ravel():
        time = float(motion.times[rng.integers(2, len(motion) - 2)] + away)
        whole, row = _with_row(motion, time)
        assert whole.times is not None
        assert whole.accelerations is not None
        assert abs(whole.times[row] - time) <= LEAST_ROW_GAP
        for part, end in ((whole.between(0, row), -1), (whole.between(row, len(whole) - 1), 0)):
            there = part.curve.over_time(2).rows[end]
            np.testing.assert_allclose(there, whole.accelerations[row], rtol=0.0, atol=SAME_END)


def _up_to(motion: Trajectory, there: float, whole: Trajectory, middle: float) -> list[np.ndarray]:
    """Configurations of both up to the mark."""
    pairs = ((motion, there), (whole, middle))
    return [each.at_time(np.linspace(0.0, until, 400)).positions for each, until in pairs]


def test_a_stage_that_would_be_over_before_the_next_row_is_not_retimed() -> None:
    """Three moves straight on, of which the second one is 5 mm long: it was refused as a motion of one row."""
    start = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    way = np.array([0.8, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    moves = [hdplan.Move((start + share * way).tolist(), blend=5e-4) for share in (1.0, 1.008, 2.0)]
    job = hdplan.Job([*moves[:2], replace(moves[2], blend=0.0)])
    limits = hdplan.Limits(acceleration=7.5)
    result = hdplan.plan_job(hdplan.Scene(robot="panda", start=start.tolist(), limits=limits, job=job))
    assert result.certified, result.text
    assert len({mark.row for mark in result.trajectory.stages}) == 3
