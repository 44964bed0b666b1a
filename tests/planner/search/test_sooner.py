"""Laws of goals that are reached sooner: the pose is kept, the slowest joint never takes longer, and where an arm has a
joint to spare it most often takes less."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan import PoseTarget, load_scene
from hdplan.planner.certificate.pose_goals import miss_of
from hdplan.planner.kinematics.inverse import Aim
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.search.inverse_kinematics import reaching
from hdplan.planner.search.sooner import sooner
from hdplan.planner.timing.least_time import least_times

from ..links import pose_of


@pytest.mark.parametrize(
    ("name", "free", "given"),
    [
        ("panda_cage", "none", ("velocity", "acceleration", "jerk")),
        ("panda_cage", "z", ("acceleration",)),
        ("ur5_table", "z", ("velocity", "acceleration")),
        ("ur5_table", "none", ("velocity", "acceleration")),
    ],
)
def test_a_goal_that_is_reached_sooner_is_a_goal(name: str, free: str, given: tuple[str, ...]) -> None:
    robot, rng, gained = load_scene_robot(load_scene(name)), np.random.default_rng(3), 0
    link, values = robot.links[-1], {"velocity": 2.0, "acceleration": 8.0, "jerk": 500.0}
    limits = {kind: rng.uniform(0.5, 1.0, robot.n) * values[kind] for kind in given}
    for start, wanted in zip(robot.draw(rng, 4), robot.draw(rng, 4), strict=True):
        target = PoseTarget(link, pose_of(robot, link, wanted), free_rotation=free)
        reached, _ = reaching(robot, target, start, np.random.default_rng(0))
        if not len(reached):
            continue
        found = sooner(Aim.at(robot, target), reached, start, limits)
        before, after = (least_times(q - start, limits).max(axis=1) for q in (reached, found))
        assert np.all(after <= before)
        assert np.all((found >= robot.lower) & (found <= robot.upper))
        assert all(miss_of(robot, target, q).within(target) for q in found)
        assert sooner(Aim.at(robot, target), reached, start, limits).tobytes() == found.tobytes()
        gained += int(np.sum(after < 0.99 * before))
    assert gained or (free == "none" and robot.n == 6)
