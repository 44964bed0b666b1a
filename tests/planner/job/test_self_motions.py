"""Laws of configurations along self-motions: each reaches its pose, and all of a self-motion are near one."""

from __future__ import annotations

import numpy as np
import pytest

import hdplan
from hdplan.planner.job.redundancy import LARGEST_STEP
from hdplan.planner.job.self_motions import close_branches
from hdplan.planner.kinematics.closed_form import closed_form
from hdplan.scenes.targets import PoseTarget
from tests.loops import needs_loops

from ..links import places_of, pose_of

TOOL = "panda_hand_tcp"
NEAR_SINGULAR = ((1, 0.05), (1, -0.08), (5, 0.1))  # where joints 1 and 3, or 5 and 7, turn about one axis

pytestmark = needs_loops


def target_of(robot: hdplan.Robot, q: np.ndarray, free_rotation: str = "none") -> PoseTarget:
    return PoseTarget(TOOL, pose_of(robot, TOOL, q), free_rotation=free_rotation)


def off(robot: hdplan.Robot, target: PoseTarget, rows: np.ndarray) -> float:
    wanted = target.pose.matrix
    return max(float(np.abs(place.homogeneous - wanted).max()) for place in places_of(robot, TOOL, rows))


def farthest(rows: np.ndarray, others: np.ndarray) -> float:
    """How far the one of some rows is from the nearest of others that is farthest from it."""
    return max(float(np.abs(others - row).max(axis=1).min()) for row in rows)


@pytest.mark.parametrize(("joint", "value"), NEAR_SINGULAR)
def test_no_configuration_is_far_from_all(joint: int, value: float) -> None:
    robot, rng = hdplan.load_robot("panda"), np.random.default_rng(joint)
    q = rng.uniform(robot.lower, robot.upper)
    q[joint] = value
    target, middle = target_of(robot, q), 0.5 * (robot.lower + robot.upper)
    form = closed_form(robot, target)
    assert form is not None
    plain, close = form.branches(robot, target, middle, 96), close_branches(form, robot, target, middle, 96)
    everywhere = form.branches(robot, target, middle, 4000)[::6]
    assert off(robot, target, close) < 1e-6
    assert farthest(plain, close) == 0.0
    assert farthest(everywhere, plain) > farthest(everywhere, close)
    assert farthest(everywhere, close) < LARGEST_STEP
    assert len(close) < 3 * len(plain)


def test_several_held_joints_and_poses_out_of_reach_get_no_further_configurations() -> None:
    robot = hdplan.load_robot("panda")
    middle = 0.5 * (robot.lower + robot.upper)
    two = target_of(robot, middle, "z")  # holds two joints
    far = PoseTarget(TOOL, hdplan.Pose([3.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]))
    for target in (two, far):
        form = closed_form(robot, target)
        assert form is not None
        found = close_branches(form, robot, target, middle, 50)
        np.testing.assert_array_equal(found, form.branches(robot, target, middle, 50))
    assert not len(found)
