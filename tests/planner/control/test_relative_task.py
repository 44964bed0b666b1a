"""Laws of tasks in a link's frame: as in the world where that link stands, and met wherever it goes; Pinocchio says
where the links are."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan import InputError, Pose, PoseTarget, Robot
from hdplan.planner.control.tasks import PoseTask
from hdplan.planner.kinematics.relative import RelativePose
from hdplan.planner.robot.link_frame import frames_of, link_poses
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.scenes.array_types import Array

LEFT, RIGHT = "left_gripper", "right_gripper"


@pytest.fixture(scope="module")
def baxter() -> Robot:
    return load_scene_robot(hdplan.load_scene("baxter_bimanual_carry"))


def between(robot: Robot, q: Array, link: str, to: str) -> Array:
    """The pose (4, 4) of a link in another one's frame."""
    own, other = (link_poses(robot, q[None], frames_of(robot)[name])[0] for name in (link, to))
    return np.asarray(np.linalg.inv(other) @ own)


def pose_of(matrix: Array) -> Pose:
    return Pose(tuple(matrix[:3, 3].tolist()), tuple(pin.Quaternion(matrix[:3, :3]).coeffs().tolist()))


@pytest.mark.core
@pytest.mark.parametrize("free", ["none", "x", "z", "all"])
def test_its_jacobian_is_the_derivative_of_the_relative_pose(baxter: Robot, free: str) -> None:
    rng, h = np.random.default_rng(0), 1e-6
    for q in baxter.draw(rng, 3):
        keep = None if free == "all" else pose_of(between(baxter, q, RIGHT, LEFT))
        at = keep or Pose(tuple(between(baxter, q, RIGHT, LEFT)[:3, 3].tolist()))
        relative = RelativePose.of(baxter, PoseTarget(RIGHT, at, free_rotation=free), LEFT)
        error, jacobian = relative.linearized(q[None])
        np.testing.assert_allclose(error, 0.0, atol=1e-7)
        for u in rng.normal(size=(3, baxter.n)):
            change = (relative.linearized((q + h * u)[None])[0][0] - relative.linearized((q - h * u)[None])[0][0]) / (
                2 * h
            )
            np.testing.assert_allclose(change, -jacobian[0] @ u, atol=1e-6)


def test_in_the_frame_of_what_stands_it_is_the_task_in_the_world(baxter: Robot) -> None:
    rng = np.random.default_rng(1)
    world = load_scene_robot(hdplan.load_scene("baxter_bimanual_carry"))
    for q in baxter.draw(rng, 3):
        there = Pose((0.6, -0.2, 0.3), (1.0, 0.0, 0.0, 0.0))
        frame = link_poses(world, q[None], frames_of(world)["base"])[0]
        placed = pose_of(frame @ there.matrix)
        for free in ("none", "y"):
            mine = PoseTask(baxter, PoseTarget(RIGHT, there, free_rotation=free), to="base")
            theirs = PoseTask(baxter, PoseTarget(RIGHT, placed, free_rotation=free))
            for one, other in zip(mine.objective(q, 0.0), theirs.objective(q, 0.0), strict=True):
                np.testing.assert_allclose(one, other, atol=1e-9)


def test_a_relative_task_is_met_while_the_other_arm_moves(baxter: Robot) -> None:
    rng, dt = np.random.default_rng(2), 0.02
    start = baxter.configuration(hdplan.load_scene("baxter_bimanual_carry").start)
    wanted = between(baxter, start + rng.uniform(-0.2, 0.2, baxter.n), RIGHT, LEFT)
    task = PoseTask(baxter, PoseTarget(RIGHT, pose_of(wanted)), gain=4.0, regularization=1e-5, to=LEFT)
    left = np.array(["left" in name for name in baxter.joint_names])
    q = start.copy()
    assert np.linalg.norm(between(baxter, q, RIGHT, LEFT)[:3, 3] - wanted[:3, 3]) > 0.02
    for k in range(200):
        hessian, linear = task.objective(q, 0.0)
        u = np.where(left, 0.1 * np.cos(k * dt + np.arange(baxter.n)), 0.0)  # the other arm goes its own way
        free = ~left
        u[free] = -np.linalg.solve(hessian[np.ix_(free, free)], linear[free] + hessian[np.ix_(free, left)] @ u[left])
        q = q + dt * u
    assert np.linalg.norm(between(baxter, q, RIGHT, LEFT)[:3, 3] - wanted[:3, 3]) < 1e-3
    assert task.met(q, 0.0)
    assert not task.met(start, 0.0)


def test_links_that_do_not_move_apart_are_refused_in_one_line(baxter: Robot) -> None:
    target = PoseTarget(RIGHT, Pose((0.0, 0.0, 0.1)))
    for to, message in (
        ("right_grippr", "to: unknown link 'right_grippr'.*right_gripper"),
        (RIGHT, f"'{RIGHT}' and '{RIGHT}' do not move relative to each other"),
        (3, "to: must be"),
        ("", "to"),
    ):
        with pytest.raises(InputError, match=message) as refused:
            PoseTask(baxter, target, to=to).objective(np.zeros(baxter.n), 0.0)
        assert "\n" not in str(refused.value)
