"""Laws of sliding: the end stays in the goal set, free and within the limits, the cost falls along the way, and where
there is no choice, nothing moves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hdplan import Budget, Limits, PathConstraints, Scene, load_scene, plan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.pose_goals import miss_of
from hdplan.planner.problem.assemble import assemble
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goal_slide import sliding
from hdplan.planner.search.goals import goal_choice, may_end
from hdplan.planner.solvers import solver_named
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget

RATES = Limits(velocity="urdf", acceleration=15.0, jerk=500.0)


def with_poses(name: str) -> Scene:
    return dataclasses.replace(load_scene(name), limits=RATES)


@pytest.mark.parametrize("name", ["panda_grasp", "pr2_shelf"])
def test_the_end_slides_within_the_goal_set_and_the_cost_falls(name: str) -> None:
    scene = with_poses(name)
    setup = Setup.of(scene)
    certifier, slid = Certifier(setup), 0
    assert isinstance(scene.goal, Goals)
    for goal in goal_choice(certifier).goals:
        slide = sliding(certifier, goal, 0.0)
        aim = setup.aiming_at(goal)
        problem = assemble(aim, aim.query)
        solution = solver_named("gauss_newton").solve(problem, problem.polyline(), Budget())
        push = problem.evaluate(solution.trajectory.positions, solution.weight).at_goal
        end = None if slide is None else slide(problem, solution, 0.05)
        if end is None:
            continue
        slid += 1
        target = next(target for target in scene.goal.targets if target.field == goal.field)
        assert isinstance(target, PoseTarget)
        assert miss_of(setup.robot, target, end).within(target)
        assert may_end(certifier, end)
        assert np.all((end >= setup.robot.lower) & (end <= setup.robot.upper))
        assert push @ (end - problem.goal) < 0.0
    assert slid


def test_the_derivative_at_the_goal_is_that_of_the_cost() -> None:
    scene = load_scene("panda_cage")
    setup = Setup.of(scene)
    problem = assemble(setup, setup.query)
    motion = problem.polyline()
    found = problem.evaluate(motion, 1e5).at_goal
    for joint in range(setup.robot.n):
        ends = []
        for step in (1e-6, -1e-6):
            moved = motion.copy()
            moved[-1, joint] += step
            ends.append(problem.evaluate(moved, 1e5).cost)
        assert found[joint] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4, abs=1e-4)


def test_a_goal_without_a_choice_does_not_slide() -> None:
    certifier = Certifier(Setup.of(load_scene("panda_cage")))
    assert sliding(certifier, JointTarget("goal", (0.0,) * 7), 0.0) is None
    cup = load_scene("panda_cup")
    assert cup.path != PathConstraints()
    grasp = with_poses("panda_grasp")
    kept = dataclasses.replace(grasp, path=dataclasses.replace(cup.path))
    certifier = Certifier(Setup.of(kept))
    assert sliding(certifier, JointTarget("goal", (0.0,) * 7), 0.0) is None


def test_a_plan_says_where_it_ends() -> None:
    scene = with_poses("panda_grasp")
    result = plan(scene)
    assert result.certified
    assert result.goal is not None
    assert result.goal.positions == tuple(result.trajectory.positions[-1].tolist())
    assert any(f"{result.goal.positions[0]:.4g}" in note for note in result.notes if "goal chosen" in note)
