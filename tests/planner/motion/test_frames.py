"""The frames of all joints at many configurations: Pinocchio's, one by one, and the caller's own."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hdplan import RobotSpec, load_robot
from hdplan.planner.motion.motion_bounds import Chain


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["panda", "ur5", "tiago", "kinova"])
def test_many_at_once_are_pinocchios_one_by_one(name: str) -> None:
    robot = load_robot(RobotSpec(name=name))
    chain, rng = Chain.of(robot.model), np.random.default_rng(1)
    configurations = robot.pin_q(robot.draw(rng, 20))
    rotations, origins = chain.frames(configurations)
    kept = rotations.copy(), origins.copy()
    for row, configuration in enumerate(configurations):
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, configuration)
        for joint in range(robot.model.njoints):
            np.testing.assert_array_equal(rotations[row, joint], data.oMi[joint].rotation)
            np.testing.assert_array_equal(origins[row, joint], data.oMi[joint].translation)
    chain.frames(robot.pin_q(robot.draw(rng, 3)))  # writes nothing into what was returned before
    np.testing.assert_array_equal(rotations, kept[0])
    np.testing.assert_array_equal(origins, kept[1])
    assert [len(each) for each in chain.frames(configurations[:0])] == [0, 0]
