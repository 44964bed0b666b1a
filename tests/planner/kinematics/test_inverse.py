"""Laws of linearized poses: the loop in C gives what NumPy gives, also at the edges, and the slopes are derivatives."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hdplan.planner.kinematics.inverse import Aim
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.targets import FREE_ROTATIONS, AllOf, PoseTarget
from tests.loops import needs_loops

ROBOTS = ("panda", "ur5", "z1", "double_pendulum_continuous")
BASE = Pose((0.3, -0.2, 0.9), (0.0, 0.6, 0.0, 0.8))
EXACT = 1e-11  # [m, rad] rounding of a dozen products of matrices
# [rad] of a turn by almost nothing or almost a half, where the arc tangent and the root of a sum lose digits
NEARLY = 1e-6


def target_at(robot: Robot, link: str, q: np.ndarray, turned: pin.SE3, free: str) -> PoseTarget:
    """A link's pose at q, turned in its own frame."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
    place = data.oMf[robot.model.getFrameId(link, pin.FrameType.BODY)] * turned
    quaternion = np.asarray(pin.Quaternion(place.rotation).normalized().coeffs())
    turn = Pose.quaternion_xyzw if free == "all" else tuple(quaternion.tolist())
    return PoseTarget(link, Pose(tuple(place.translation.tolist()), turn), free_rotation=free)


def both_ways(aim: Aim, q: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    assert aim.loops
    return aim.linearized(q), aim._replace(loops=None).linearized(q)


@pytest.mark.sampled(3)
@needs_loops
@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("free", FREE_ROTATIONS)
def test_the_loop_is_numpy(name: str, free: str) -> None:
    robot = load_robot(RobotSpec(name=name, base=BASE))
    rng = np.random.default_rng(3)
    q = rng.uniform(-3.0, 3.0, (50, robot.n))
    poses = [
        target_at(robot, link, q[0], pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)), free)
        for link in robot.links[-2:]
    ]
    targets: list[PoseTarget | AllOf] = [*poses, AllOf(poses)]
    for target in targets:
        (error, jacobian), (error_numpy, jacobian_numpy) = both_ways(Aim.at(robot, target), q)
        assert jacobian.shape == (50, 6 * len(target.poses), robot.n)
        np.testing.assert_allclose(error, error_numpy, atol=EXACT, rtol=0)
        np.testing.assert_allclose(jacobian, jacobian_numpy, atol=EXACT, rtol=0)


@needs_loops
@pytest.mark.parametrize("free", ["none", "x", "y", "z"])
def test_no_turn_and_a_half_turn_are_turns_to_the_target(free: str) -> None:
    robot = load_robot(RobotSpec(name="panda"))
    link = robot.links[-1]
    for seed, angle in ((1, 0.0), (2, 1e-12), (3, 1e-7), (4, np.pi), (5, np.pi - 1e-9), (6, np.pi + 1e-7)):
        q = np.random.default_rng(seed).uniform(-2.0, 2.0, robot.n)
        for axis in (*np.eye(3), np.array([0.6, 0.0, 0.8])):
            target = target_at(robot, link, q, pin.SE3(pin.exp3(angle * axis), np.zeros(3)), free)
            found, expected = (error[0] for error, _ in both_ways(Aim.at(robot, target), q[None]))
            np.testing.assert_allclose(found[:3], expected[:3], atol=EXACT, rtol=0)
            assert np.linalg.norm(found[3:]) == pytest.approx(np.linalg.norm(expected[3:]), abs=NEARLY)
            if free == "none":  # with opposite signs, half a turn is the same
                turns = [pin.exp3(each[3:]) for each in (found, expected)]
                np.testing.assert_allclose(*turns, atol=NEARLY)


@pytest.mark.core
@pytest.mark.parametrize("free", FREE_ROTATIONS)
def test_slopes_are_derivatives_of_the_error(free: str) -> None:
    robot = load_robot(RobotSpec(name="panda"))
    rng, step = np.random.default_rng(5), 1e-6
    for q in rng.uniform(-1.5, 1.5, (5, robot.n)):
        aim = Aim.at(robot, target_at(robot, robot.links[-1], q, pin.SE3.Identity(), free))
        for each in (aim, aim._replace(loops=None)):
            _, jacobian = each.linearized(q[None])
            for j in range(robot.n):
                moved = step * np.eye(robot.n)[j]
                ahead, behind = each.linearized(np.stack([q + moved, q - moved]))[0]
                np.testing.assert_allclose((behind - ahead) / (2 * step), jacobian[0, :, j], atol=1e-6)
