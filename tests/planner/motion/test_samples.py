"""Laws of a motion that is read at times: it is the curve, at rows to the bit, and no step is larger than what a proof
of its rates allows."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import BPoly

import hdplan
from hdplan import InputError, Trajectory

NAMES = tuple(f"panda_joint{i}" for i in range(1, 8))
FINGERS = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}


def motion(seed: int, held: int = 3, begins: float = 0.0) -> Trajectory:
    rng = np.random.default_rng(seed)
    times = begins + np.cumsum(rng.uniform(0.01, 0.5, 9))
    rates = (rng.normal(size=(9, 7)) for _ in range(held - 1))
    return Trajectory(NAMES, rng.uniform(-0.5, 0.5, (9, 7)), FINGERS, times, *rates)


@pytest.mark.parametrize("held", [1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_the_curve_equals_that_of_another_library(seed: int, held: int) -> None:
    given = motion(seed, held, begins=seed - 1.0)
    assert given.times is not None
    rows = [each for each in (given.positions, given.velocities, given.accelerations) if each is not None]
    other = BPoly.from_derivatives(given.times, np.stack(rows, axis=1))
    when = np.random.default_rng(seed).uniform(given.times[0], given.times[-1], (50, 3))
    found = given.at_time(when)
    for order, values in enumerate((found.positions, found.velocities, found.accelerations)):
        wanted = (other.derivative(order) if order else other)(when)
        assert values.shape == (50, 3, 7)
        np.testing.assert_allclose(values, wanted, rtol=0, atol=1e-11 * max(1.0, np.abs(wanted).max()))
    one = given.at_time(float(when[0, 0]))
    assert np.array_equal(one.positions, found.positions[0, 0])


@pytest.mark.parametrize("begins", [0.0, -3.0, 1e6 / 3])
def test_rows_come_back_to_the_bit(begins: float) -> None:
    given = motion(4, begins=begins)
    found = given.at_time(given.times)
    assert np.array_equal(found.positions, given.positions)
    np.testing.assert_allclose(found.velocities, given.velocities, rtol=0, atol=1e-12)


@pytest.mark.parametrize("rate", [1000.0, 97.3, 0.1, 1e-3])
def test_samples_lie_at_whole_steps_and_at_the_end(rate: float) -> None:
    given = motion(5, begins=2.0)
    assert given.times is not None
    assert given.duration is not None
    found = given.sampled(rate)
    assert np.array_equal(found.times[:-1], given.times[0] + np.arange(len(found) - 1) / rate)
    assert found.times[-1] == given.times[-1]
    assert 0.0 < found.times[-1] - found.times[-2] <= (1.0 + 1e-9) / rate
    assert np.array_equal(found.positions[[0, -1]], given.positions[[0, -1]])


def test_no_step_is_larger_than_the_proven_rates_allow() -> None:
    given = motion(6)
    found = given.sampled(1000.0)
    for order, values in enumerate((found.positions, found.velocities)):
        most = given.curve.over_time(order + 1).largest()
        assert (np.abs(np.diff(values, axis=0)) <= most * np.diff(found.times)[:, None] + 1e-12).all()


def test_poses_are_those_of_the_robot() -> None:
    robot = hdplan.load_robot(hdplan.RobotSpec(name="panda", base=hdplan.Pose([0.1, 0.2, 0.3]), locked=FINGERS))
    given = motion(7)
    found = given.sampled(20.0)
    poses = found.poses(robot, "panda_hand")
    data = robot.model.createData()
    for q, pose in zip(found.positions, poses, strict=True):
        pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
        wanted = data.oMf[robot.model.getFrameId("panda_hand")].homogeneous
        np.testing.assert_allclose(pose, wanted, rtol=0, atol=1e-12)
    assert given.at_time(given.times[0]).poses(robot).shape == (4, 4)  # type: ignore[index]


def test_a_link_is_not_placed_by_joints_that_move_elsewhere() -> None:
    """Fingers that move along are no matter for the hand, but the robot cannot say where the fingers are."""
    robot = hdplan.load_robot(hdplan.RobotSpec(name="panda", locked=FINGERS))
    given = motion(8)
    rows = np.column_stack([given.positions, np.linspace(0.0, 0.02, 9)])
    both = Trajectory((*NAMES, "panda_finger_joint1"), rows, {"panda_finger_joint2": 0.02}, given.times)
    assert both.sampled(10.0).poses(robot, "panda_hand").shape[1:] == (4, 4)
    with pytest.raises(InputError, match=r"panda_finger_joint1.*held at 0\.02"):
        both.sampled(10.0).poses(robot, "panda_leftfinger")


def test_times_rates_and_links_without_an_answer_are_refused() -> None:
    given = motion(9)
    assert given.times is not None
    for wrong in (given.times[0] - 1e-6, given.times[-1] + 1e-6, np.nan, np.inf, "soon", [0.0, None]):
        with pytest.raises(InputError, match="time"):
            given.at_time(wrong)
    for rate in (0.0, -1.0, np.nan, "fast", 1e6 * 1e6):
        with pytest.raises(InputError, match="rate"):
            given.sampled(rate)
    path = Trajectory(NAMES, given.positions)
    for read in (lambda: path.at_time(0.0), lambda: path.sampled(10.0)):
        with pytest.raises(InputError, match="without times"):
            read()
    robot = hdplan.load_robot("ur5")
    with pytest.raises(InputError, match="robot: the motion has no joint 'shoulder_pan_joint'"):
        given.sampled(10.0).poses(robot)
