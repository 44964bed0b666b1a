"""Laws of arms that only meet each other: which joints are one arm's, and whose pairs count for it alone."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import numpy as np

from hdplan import PathConstraints, Problem, Trajectory, build, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.problem.assemble import exactly
from hdplan.planner.search.arms import Arms, arms_of
from hdplan.planner.search.escape import ways_back
from hdplan.planner.search.free_space import free_part, free_space, is_free, with_these_alone
from hdplan.planner.search.tree_ways import tree_ways
from hdplan.scenes.targets import JointTarget
from tests.loops import needs_loops

pytestmark = needs_loops


@functools.cache
def two_arms() -> Problem:
    """Baxter at a table, with nothing in its hands, which turn away from each other."""
    scene = load_scene("baxter_bimanual_carry")
    start = scene.start.positions
    assert start is not None
    goal = np.array(start) + 0.4 * np.repeat([1.0, -1.0], 7) * np.tile(np.arange(7) == 0, 2)
    aim = JointTarget("goal", tuple(goal.tolist()))
    return exactly(build(dataclasses.replace(scene, attached=(), path=PathConstraints(), goal=aim)))


def test_joints_that_move_one_body_are_of_one_arm() -> None:
    left, right = arms_of(two_arms())
    np.testing.assert_array_equal(left, np.arange(14) < 7)
    np.testing.assert_array_equal(right, ~left)
    for name in ("panda_cage", "tiago_shelf"):  # the latter with a joint that slides below its arm
        assert arms_of(build(load_scene(name))) == ()


def test_a_configuration_free_for_all_is_free_for_each_alone_and_the_others_do_not_count() -> None:
    problem, rng = two_arms(), np.random.default_rng(4)
    space = free_space(problem, 0.0)
    assert space is not None
    arms, nothing = arms_of(problem), np.zeros(14, np.bool_)
    alone = [with_these_alone(space, arm) for arm in arms]
    answers = []
    for _ in range(40):
        first, last = problem.robot.draw(rng, 2)
        last = first + 0.3 * (last - first)
        lines = [(first, np.where(arm, last, first)) for arm in arms]
        for one, arm, line in zip(alone, arms, lines, strict=True):
            answers.append((is_free(space, *line), is_free(one, *line)))
            elsewhere = np.where(arm, line, problem.robot.draw(rng, 1))  # of the other arm
            assert is_free(one, *elsewhere) == answers[-1][1]
        assert is_free(with_these_alone(space, nothing), first, last)
        assert is_free(with_these_alone(space, ~nothing), *lines[0]) == answers[-2][0]
    assert all(own for both, own in answers if both)
    assert {(True, True), (False, True), (False, False)} <= set(answers)


def test_each_arms_way_moves_it_alone_and_targets_are_on_the_ways_or_anywhere() -> None:
    problem = two_arms()
    space = free_space(problem, 0.0)
    assert space is not None
    roots = [free_part(space, way) for way in ways_back(problem)]
    arms = Arms(problem, space, np.random.default_rng(7), roots)
    arms.grow(256, lambda: False)
    on_ways = np.ones(64, np.bool_)
    drawn = arms.draw(64)
    for arm, way in zip(arms.arms, arms.ways, strict=True):
        assert way is not None
        np.testing.assert_array_equal(way[[0, -1]], np.where(arm, [problem.start, problem.goal], problem.start))
        assert all(is_free(with_these_alone(space, arm), *line) for line in itertools.pairwise(way))
        assert np.all(way[:, ~arm] == problem.start[~arm])
        from_first = drawn[:, None, arm] - way[None, :-1, arm]
        along = np.diff(way[:, arm], axis=0)[None]
        share = np.clip((from_first * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
        on_ways &= np.linalg.norm(from_first - share[..., None] * along, axis=-1).min(axis=1) < 1e-9
    assert 0.5 < on_ways.mean() < 0.95
    arms.ways = [None, None]
    assert np.all((arms.draw(64) >= problem.robot.lower) & (arms.draw(64) <= problem.robot.upper))


def test_ways_found_by_trees_of_two_arms_are_certified_and_the_same_by_the_same_seed() -> None:
    problem = two_arms()
    first, again = (next(way for way in tree_ways(problem, 0.0, 1) if way is not None) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[[0, -1]], [problem.start, problem.goal])
    motion = Trajectory(problem.robot.joint_names, first, problem.robot.locked)
    assert Certifier(problem.setup).certify(motion, required=0.0).certified
