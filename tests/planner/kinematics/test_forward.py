"""Kinematics agree with Pinocchio's own numbers, one by one and in batches."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_files.library import robot_names
from hdplan.scenes.robot_spec import RobotSpec

from ..urdf import joint_text, link_text, write_robot

ARMS = ["panda", "ur3_gripper", "ur5", "ur5_gripper", "ur10", "xarm7", "kinova", "z1"]
EXACT = 1e-12  # [m, 1] agreement with Pinocchio: rounding of a dozen products of matrices
BASE = Pose((0.3, -0.2, 0.9), (0.0, 0.6, 0.0, 0.8))


def _load(name: str) -> Robot:
    try:
        return load_robot(RobotSpec(name=name, base=BASE))
    except InputError as error:
        pytest.skip(str(error))


def _compare(robot: Robot, count: int) -> None:
    kinematics = Kinematics(robot.model)
    q = np.random.default_rng(1).uniform(-3, 3, (count, robot.n))
    batch = kinematics.evaluate(q)
    data = robot.model.createData()
    for row, configuration in enumerate(robot.pin_q(q)):
        pin.computeJointJacobians(robot.model, data, configuration)
        jacobian = np.concatenate([batch.linear[row].T, batch.angular[row].T])
        np.testing.assert_allclose(jacobian, data.J, atol=EXACT, rtol=0)
        for joint in range(robot.model.njoints):
            np.testing.assert_allclose(batch.rotations[row, joint], data.oMi[joint].rotation, atol=EXACT, rtol=0)
            np.testing.assert_allclose(batch.translations[row, joint], data.oMi[joint].translation, atol=EXACT, rtol=0)
            moved = jacobian * kinematics.supports[joint]
            world = pin.getJointJacobian(robot.model, data, joint, pin.ReferenceFrame.WORLD)
            np.testing.assert_allclose(moved, world, atol=EXACT, rtol=0)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ARMS)
def test_arms_agree_with_pinocchio(name: str) -> None:
    _compare(_load(name), 20)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in robot_names() if name not in ARMS])
def test_every_listed_robot_agrees_with_pinocchio(name: str) -> None:
    _compare(_load(name), 3)


@pytest.mark.core
@pytest.mark.parametrize("name", ["panda", "double_pendulum_continuous", "finger_edu", "anymal_c_simple"])
def test_all_kinds_of_joints_agree_with_pinocchio(name: str) -> None:
    _compare(_load(name), 5)


def test_prismatic_joints_agree_with_pinocchio(tmp_path) -> None:
    axes = ["1 0 0", "0 1 0", "0 0 1", "0.6 0 0.8"]
    links = (link_text(f"l{i}") for i in range(2 * len(axes) + 1))
    kinds = [(kind, axis) for kind in ("prismatic", "continuous") for axis in axes]
    place: dict[str, Any] = {"at": "0.1 0.2 0.3", "limits": (-3, 3)}
    joints = (
        joint_text(f"j{i}", f"l{i}", f"l{i + 1}", axis, kind=kind, rpy=f"0.3 0.2 {0.1 * i}", **place)
        for i, (kind, axis) in enumerate(kinds)
    )
    path = write_robot(tmp_path / "mixed.urdf", *links, *joints)
    _compare(load_robot(RobotSpec(urdf=path, base=BASE)), 5)


def test_batches_of_any_size_equal_the_loop() -> None:
    kinematics = Kinematics(_load("panda").model)
    q = np.random.default_rng(2).uniform(-2, 2, (13, 7))
    for count in (1, 2, 3, 8, 13):
        batch = kinematics.evaluate(q[:count])
        assert batch.rotations.shape == (count, kinematics.nj, 3, 3)
        for row in range(count):
            single = kinematics.evaluate(q[row])
            for name in ("rotations", "translations", "linear", "angular"):
                np.testing.assert_array_equal(getattr(single, name)[0], getattr(batch, name)[row])


def test_an_empty_batch_is_empty() -> None:
    kinematics = Kinematics(_load("panda").model)
    assert kinematics.evaluate(np.empty((0, 7))).linear.shape == (0, 7, 3)


def test_results_are_not_overwritten_by_the_next_call() -> None:
    kinematics = Kinematics(_load("ur5").model)
    first = kinematics.evaluate(np.zeros((2, 6)))
    kept = first.translations.copy()
    kinematics.evaluate(np.ones((2, 6)))
    np.testing.assert_array_equal(first.translations, kept)


def test_the_function_serves_in_casadi_graphs() -> None:
    kinematics = Kinematics(_load("panda").model)
    q = np.random.default_rng(3).uniform(-2, 2, 7)
    symbol = ca.MX.sym("q", 7)
    rotations, translations = kinematics.function(symbol)
    values = ca.Function("values", [symbol], [rotations, translations, ca.jacobian(translations[:, -1], symbol)])(q)
    batch = kinematics.evaluate(q)
    np.testing.assert_array_equal(np.array(values[0]).T.reshape(-1, 3, 3).transpose(0, 2, 1), batch.rotations[0])
    np.testing.assert_array_equal(np.array(values[1]).T, batch.translations[0])
    velocity = batch.linear[0] + np.cross(batch.angular[0], batch.translations[0, -1])
    np.testing.assert_allclose(np.array(values[2]).T, velocity, atol=EXACT)
