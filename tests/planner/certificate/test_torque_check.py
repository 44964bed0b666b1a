"""The torques of an executed curve: what is proven holds at every moment, and what is exceeded is found and named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from hdplan import InputError, Limits, Pose, Robot, RobotSpec, Scene, Trajectory, certify, load_robot
from hdplan.planner.certificate.torque_bounds import torque_curvature
from hdplan.planner.certificate.torque_check import check_torques
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.scenes.array_types import Array

from ..urdf import joint_text, link_text, write_robot

SCENES = Path(__file__).resolve().parents[3] / "scenes" / "shipped"
UPRIGHT = Pose((0, 0, 1), (0.7071067811865476, 0, 0, 0.7071067811865476))  # the planar arm in a vertical plane
BODY = (
    '<inertial><origin xyz="0.1 -0.05 0.2"/><mass value="2"/>'
    '<inertia ixx="0.3" ixy="0.01" ixz="-0.02" iyy="0.4" iyz="0.03" izz="0.5"/></inertial>'
)
SLIDING = (
    link_text("l0"),
    *(link_text(f"l{i}", inertial=BODY) for i in (1, 2, 3)),
    joint_text("turn", "l0", "l1", "0 1 0", limits=(-2, 2)),
    joint_text("slide", "l1", "l2", "0.6 0 0.8", kind="prismatic", at="0.2 0.1 0", limits=(-2, 2)),
    joint_text("twist", "l2", "l3", kind="continuous", at="0.3 0 0.1"),
)


def _robot(name: str, folder: Path) -> Robot:
    if name == "planar":
        return load_robot(RobotSpec(urdf=SCENES / "planar_arm.urdf", base=UPRIGHT))
    if name == "sliding":
        return load_robot(RobotSpec(urdf=write_robot(folder / "sliding.urdf", *SLIDING)))
    return load_robot(RobotSpec(name=name))


def _wild(robot: Robot, seed: int) -> Curve:
    """A quintic through a few rows with random rates, as jerky as no time law makes them."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.1, 0.3, 12))
    q = robot.draw(rng, 1) + np.cumsum(rng.normal(0, 0.1, (12, robot.n)), axis=0)
    return Curve.through(q, times, rng.normal(0, 1, q.shape), rng.normal(0, 5, q.shape))


def _torques(robot: Robot, curve: Curve, interval: NDArray[np.int64], fraction: Array) -> Array:
    model = robot.model
    q, v, a = (curve.over_time(order).at(interval, fraction) for order in range(3))
    return np.array([pin.rnea(model, model.createData(), *state) for state in zip(robot.pin_q(q), v, a, strict=True)])


@pytest.mark.parametrize("name", ["panda", "kinova", "planar", "sliding"])
def test_no_torque_changes_faster_than_its_bound(name: str, tmp_path: Path) -> None:
    """Second differences are means of τ̈ over the two intervals."""
    robot, rng = _robot(name, tmp_path), np.random.default_rng(1)
    robot.model.armature = np.linspace(0.1, 0.5, robot.n)
    for seed in range(3):
        curve = _wild(robot, seed)
        orders = [curve.over_time(order) for order in range(5)]
        interval = np.repeat(np.arange(len(curve) - 1), 20)
        start = rng.uniform(0, 0.9, len(interval))
        end = start + rng.uniform(0.01, 0.1, len(interval))
        rates = np.stack([order.largest_on(interval, start, end) for order in orders])
        bound = torque_curvature(robot.model, Chain.of(robot.model), rates)
        first, middle, last = (_torques(robot, curve, interval, at) for at in (start, 0.5 * (start + end), end))
        step = (0.5 * (end - start) * curve.widths[interval])[:, None]
        found = np.abs(first - 2 * middle + last) / step**2
        rounding = 1e-11 / step**2
        assert (found <= bound + rounding).all()
        assert (found.max(axis=0) > 1e-4 * bound.max(axis=0)).all()  # and it is of some use


@pytest.mark.parametrize("name", ["panda", "kinova", "planar", "sliding"])
def test_a_proven_torque_holds_at_every_moment(name: str, tmp_path: Path) -> None:
    robot, rng = _robot(name, tmp_path), np.random.default_rng(2)
    curve = _wild(robot, 7)
    interval = rng.integers(0, len(curve) - 1, 2000)
    torques = np.abs(_torques(robot, curve, interval, rng.uniform(0, 1, 2000)))
    generous = check_torques(robot.model, robot, curve, np.full(robot.n, 1e6))
    assert generous.within
    assert not generous.exceeded
    assert (torques <= generous.proven).all()
    assert (torques.max(axis=0) <= generous.found * 1.01).all()
    assert (generous.found <= generous.proven).all()
    tight = check_torques(robot.model, robot, curve, generous.found * 1.01 + 1e-6)
    assert tight.within  # halving proves what is close
    assert (torques <= tight.proven).all()
    for joint in range(robot.n):
        limits = np.full(robot.n, 1e6)
        limits[joint] = generous.found[joint] * 0.999
        lower = check_torques(robot.model, robot, curve, limits)
        assert lower.exceeded
        assert not lower.within
        assert lower.worst == joint
        assert f"'{robot.joint_names[joint]}'" in lower.text


@pytest.mark.core
def test_a_torque_exactly_at_its_limit_is_not_called_proven() -> None:
    robot = _robot("panda", Path())
    q = robot.draw(np.random.default_rng(3), 1).repeat(2, axis=0)
    still = Curve.through(q, np.array([0.0, 1.0]), np.zeros_like(q), np.zeros_like(q))
    free = check_torques(robot.model, robot, still, np.full(7, 1e3))
    np.testing.assert_array_equal(free.proven, free.found)  # nothing moves: no slack
    assert check_torques(robot.model, robot, still, free.found + 1e-9).within
    moving = Curve.through(q + [[0.0], [0.1]], np.array([0.0, 1.0]), np.zeros_like(q), np.zeros_like(q))
    limits = check_torques(robot.model, robot, moving, np.full(7, 1e3)).found
    verdict = check_torques(robot.model, robot, moving, limits)
    assert not verdict.within
    assert "to tell" in verdict.text or verdict.exceeded


def test_gravity_that_no_speed_helps_against_is_a_cause_of_its_own() -> None:
    """The stretched arm in a vertical plane is too heavy for its shoulder where it lies level."""
    robot = _robot("planar", Path())
    limits = np.array([15.0, 10.0])
    level = 9.81 * (2 * 0.25 + 1.2 * 0.75)  # [Nm] at the shoulder
    hanging, raised = np.array([-np.pi / 2, 0]), np.array([np.pi / 2, 0])
    ends, zero = np.array([hanging, raised]), np.zeros((2, 2))
    slow = check_torques(robot.model, robot, Curve.through(ends, np.array([0.0, 100.0]), zero, zero), limits)
    assert slow.within
    assert slow.proven[0] == pytest.approx(level, rel=0.01)
    slow = check_torques(robot.model, robot, Curve.through(ends, np.array([0.0, 100.0]), zero, zero), limits * 0.8)
    assert slow.overload.joint == "shoulder"
    assert slow.overload.time == pytest.approx(50, abs=0.1)
    assert slow.overload.torque == pytest.approx(level, rel=1e-4)
    assert "to hold still against gravity" in slow.text
    fast = check_torques(robot.model, robot, Curve.through(ends, np.array([0.0, 0.5]), zero, zero), limits)
    assert fast.exceeded
    assert fast.overload is None
    assert "needs a torque of" in fast.text


def test_a_path_without_velocities_has_no_torques() -> None:
    robot = _robot("planar", Path())
    rows = np.zeros((3, 2))
    for curve in (Curve.through(rows), Curve.through(rows, np.arange(3.0))):
        with pytest.raises(InputError, match="has no velocities"):
            check_torques(robot.model, robot, curve, np.ones(2))


def test_cubic_rows_may_jump_in_acceleration() -> None:
    """The torque on either side counts where two cubics meet."""
    robot = _robot("planar", Path())
    rows, rates = np.array([[0.0, 0], [0.1, 0.1], [0.0, 0]]), np.zeros((3, 2))
    curve = Curve.through(rows, np.array([0.0, 0.2, 0.3]), rates)
    check = check_torques(robot.model, robot, curve, np.full(2, 1e3))
    both = [_torques(robot, curve, np.array([i]), np.array([f]))[0] for i, f in ((0, 1.0), (1, 0.0))]
    assert np.abs(both[0] - both[1]).max() > 1
    assert (check.found >= np.abs(both).max(axis=0)).all()


def test_loads_count() -> None:
    robot = _robot("panda", Path())
    curve = _wild(robot, 5)
    heavy = robot.model.copy()
    heavy.appendBodyToJoint(7, pin.Inertia.FromSphere(3.0, 0.1), pin.SE3.Identity())
    limits = check_torques(robot.model, robot, curve, np.full(7, 1e6)).proven * 1.01
    assert check_torques(robot.model, robot, curve, limits).within
    assert check_torques(heavy, robot, curve, limits).exceeded


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_motion_that_begins_or_ends_at_speed_needs_an_infinite_torque(end: str) -> None:
    """No limit allows it, and a motion that rests at both ends needs none. The jump counts as in the rates."""
    start, goal = ([turn, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785] for turn in (0.0, 0.3))
    scene = Scene(robot="panda", start=start, goal=goal, limits=Limits(torque=1e6))
    for speed, abrupt in ((0.0, False), (1e-3, True), (0.5, True)):
        velocities = np.zeros((2, 7))
        velocities[0 if end == "start" else 1, 0] = speed
        names = load_robot(scene.robot).joint_names
        motion = Trajectory(names, np.array([start, goal]), {}, np.array([0.0, 1.0]), velocities, np.zeros((2, 7)))
        verdict = certify(scene, motion)
        assert verdict.certified is not abrupt
        if abrupt:
            assert verdict.status is Status.OVERLOADED
            assert "panda_joint1" in verdict.text
            assert f"{0.0 if end == 'start' else 1.0:.3f} s" in verdict.text
            assert np.isinf(verdict.uses[-1].share)
