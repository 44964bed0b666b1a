"""Laws of tasks: lists are added by weight, lower ranks disturb no higher one, tool axes alone leave the rest free, and
the default gains arrive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hdplan import InputError, Pose, PoseTarget, Robot
from hdplan.control import Controller, simulate
from hdplan.planner.control.tasks import Damping, PoseTask, Ranked, standing, together
from hdplan.planner.kinematics.inverse import LinkPose

from .rooms import READY, scene_of

DOWN = PoseTarget("panda_hand", Pose((0.45, 0.2, 0.5), (1.0, 0.0, 0.0, 0.0)))


def test_weights_add_and_one_task_is_itself(robot: Robot) -> None:
    pose, posture = PoseTask(robot, DOWN), standing(READY + 0.1)
    assert together(pose) is pose
    assert together([pose]) is pose
    hessian, linear = together([pose, Ranked(posture, 0.3), Ranked(Damping(7), 0.2)]).objective(READY, 0.0)
    parts = [each.objective(READY, 0.0) for each in (pose, posture)]
    np.testing.assert_allclose(hessian, parts[0][0] + 0.3 * parts[1][0] + 0.2 * np.eye(7), atol=1e-12)
    np.testing.assert_allclose(linear, parts[0][1] + 0.3 * parts[1][1], atol=1e-12)


def test_a_lower_rank_disturbs_no_higher_one_and_uses_what_is_free(robot: Robot) -> None:
    rng, pose = np.random.default_rng(0), PoseTask(robot, DOWN, regularization=1e-4)
    for q in READY + rng.uniform(-0.3, 0.3, (10, 7)):
        posture = standing(robot.draw(rng, 1)[0])
        alone, both = (together(each).objective(q, 0.0) for each in (pose, [pose, Ranked(posture, 5.0, 1)]))
        first, second = (-np.linalg.solve(hessian, linear) for hessian, linear in (alone, both))
        jacobian = LinkPose.of(robot, DOWN).linearized(q[None])[1][0]
        np.testing.assert_allclose(jacobian @ second, jacobian @ first, atol=0.05 * np.abs(jacobian @ first).max())
        wanted = -posture.objective(q, 0.0)[1]
        assert np.linalg.norm(second - wanted) < np.linalg.norm(first - wanted)


def test_default_gains_arrive_within_the_target_and_a_posture_does_not_keep_them_off(robot: Robot) -> None:
    controller = Controller.of(scene_of(), robot=robot)
    axis = PoseTarget("panda_hand", DOWN.pose, free_rotation="z")
    for task in (PoseTask(robot, DOWN), [PoseTask(robot, axis), Ranked(standing(READY), 1.0, 1)]):
        run = simulate(controller, READY, task, 4.0)
        assert run.met is not None


def test_invalid_tasks_are_refused(robot: Robot) -> None:
    wrong: list[tuple[Any, str]] = [([], "task"), ("pose", "task"), ([READY], r"task\[0\]"), (3, r"task")]
    for tasks, words in wrong:
        with pytest.raises(InputError, match=words) as refused:
            together(tasks)
        assert "\n" not in str(refused.value)
    with pytest.raises(InputError, match="weight"):
        Ranked(Damping(7), 0.0)
    with pytest.raises(InputError, match="rank"):
        Ranked(Damping(7), 1.0, -1)
