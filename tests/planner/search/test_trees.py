"""Laws of the trees: what they find is free by the certificate and by the oracle at dense samples, the same seed finds
the same, and what cannot be free is never reported as free."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from hdplan import Problem, Trajectory, build, load_scene
from hdplan.distance.compiled.loops import Record
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.problem.assemble import exactly
from hdplan.planner.search.corners import shortened, through
from hdplan.planner.search.end_clearance import reachable_clearance
from hdplan.planner.search.escape import escapes, ways_back
from hdplan.planner.search.free_space import free_part, free_space, is_free
from hdplan.planner.search.tree_ways import tree_ways
from hdplan.planner.search.trees import Trees
from tests.loops import needs_loops

pytestmark = needs_loops

SCENES = ("panda_cage", "panda_carry", "tiago_shelf")  # among bars, with a held object, with a joint that slides


def exact(name: str) -> Problem:
    return exactly(build(load_scene(name)))


def space_of(problem: Problem, required: float = 0.0) -> Record:
    found = free_space(problem, required)
    assert found is not None
    return found


@pytest.mark.parametrize("name", SCENES)
def test_ways_of_trees_are_certified_unchanged(name: str) -> None:
    problem = exact(name)
    way = next(found for found in tree_ways(problem, 0.0, 3) if found is not None)
    np.testing.assert_array_equal(way[[0, -1]], [problem.start, problem.goal])
    assert way.shape == (problem.waypoints, problem.robot.n)
    motion = Trajectory(problem.robot.joint_names, way, problem.robot.locked)
    assert Certifier(problem.setup).certify(motion, required=0.0).certified


@pytest.mark.parametrize("name", SCENES)
def test_no_line_that_counts_as_free_touches_anything(name: str) -> None:
    """Dense samples of random lines, by the certificate's own oracle; and some are free, and some are not."""
    problem, rng = exact(name), np.random.default_rng(5)
    space, certifier = space_of(problem), Certifier(problem.setup)
    answers = []
    for _ in range(60):
        first, last = problem.robot.draw(rng, 2)
        last = first + rng.uniform(0.05, 1.0) * (last - first)
        answers.append(is_free(space, first, last))
        if answers[-1]:
            for t in np.linspace(0.0, 1.0, 12):
                assert not certifier.contacts(first + t * (last - first), 0.0)
    assert 0 < sum(answers) < len(answers)


def test_a_line_back_is_as_free_and_a_point_is_a_line() -> None:
    problem, rng = exact("panda_cage"), np.random.default_rng(6)
    space, certifier = space_of(problem), Certifier(problem.setup)
    for _ in range(40):
        first, last = problem.robot.draw(rng, 2)
        last = first + 0.2 * (last - first)
        assert is_free(space, first, last) == is_free(space, last, first)
        if is_free(space, first, first):
            assert not certifier.contacts(first, 0.0)


def test_the_same_seed_finds_the_same_and_another_one_another() -> None:
    problem = exact("panda_cage")
    ways = [next(found for found in tree_ways(problem, 0.0, seed) if found is not None) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(ways[0], ways[1])
    assert np.abs(ways[0] - ways[2]).max() > 0.0


def test_shortcuts_keep_the_ends_stay_free_and_are_never_longer() -> None:
    problem, rng = exact("panda_cage"), np.random.default_rng(0)
    space = space_of(problem)
    trees, way = Trees(problem, space, rng), None
    while way is None:
        way = trees.grow(64)
    short = shortened(space, way, rng)
    np.testing.assert_array_equal(short[[0, -1]], way[[0, -1]])
    assert all(is_free(space, *line) for line in itertools.pairwise(short))
    length, before = (np.linalg.norm(np.diff(each, axis=0), axis=1).sum() for each in (short, way))
    assert length <= before + 1e-9


def test_corners_are_among_the_waypoints_as_long_as_they_fit() -> None:
    problem, rng = exact("panda_cage"), np.random.default_rng(1)
    for corners in (2, 3, problem.waypoints, problem.waypoints + 5):
        way = np.clip(problem.robot.draw(rng, corners), *problem.robot.inner)
        way[0], way[-1] = problem.start, problem.goal
        found = through(problem, way)
        assert found.shape == (problem.waypoints, problem.robot.n)
        if corners <= problem.waypoints:
            assert all(np.abs(found - corner).max(axis=1).min() < 1e-12 for corner in way)


def test_the_clearance_is_kept_that_the_ends_allow() -> None:
    scene = load_scene("panda_corridor")
    scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, clearance=0.02))
    problem = exactly(build(scene))
    certifier = Certifier(problem.setup)
    required, _ = reachable_clearance(problem.setup, certifier)
    assert required > 0.0
    way = next(found for found in tree_ways(problem, required, 0) if found is not None)
    motion = Trajectory(problem.robot.joint_names, way, problem.robot.locked)
    assert certifier.certify(motion, required=required).certified


def test_trees_begin_with_the_ways_back_as_far_as_they_are_free() -> None:
    """A way is cut before its first line that is not free, and every node but the first hangs on the one before it."""
    problem, rng = exact("panda_grasp"), np.random.default_rng(2)
    space, ways = space_of(problem), ways_back(problem)
    assert max(map(len, ways)) > 3
    for way, end, corners in zip(ways, (problem.start, problem.goal), escapes(problem), strict=True):
        np.testing.assert_array_equal(way[0], end)
        assert all((way == corner).all(axis=1).any() for corner in corners)
    drawn = np.array([problem.start, *problem.robot.draw(rng, 20)])
    for way in (*ways, drawn):
        part = free_part(space, way)
        np.testing.assert_array_equal(part, way[: len(part)])
        assert all(is_free(space, *line) for line in itertools.pairwise(part))
        assert len(part) == len(way) or not is_free(space, *way[len(part) - 1 : len(part) + 1])
    assert len(free_part(space, drawn)) < len(drawn)
    trees = Trees(problem, space, rng, [free_part(space, way) for way in ways])
    for nodes, parents in zip(trees.nodes, trees.parents, strict=True):
        np.testing.assert_array_equal(parents, np.arange(len(nodes)) - 1)


def test_trees_stay_within_the_limits() -> None:
    """Also where surfaces are slid along."""
    problem = exact("tiago_shelf")
    trees = Trees(problem, space_of(problem), np.random.default_rng((3, 0)))
    trees.grow(96)
    lower, upper = problem.robot.inner
    for nodes in trees.nodes:
        assert len(nodes) > 9
        assert np.all((nodes >= lower) & (nodes <= upper))


def test_there_are_none_where_more_counts_than_what_is_free() -> None:
    """Moving obstacles, and path constraints, on which other trees grow; nor where distances are not exact."""
    for name in ("panda_conveyor", "panda_cup"):
        assert next(tree_ways(exact(name), 0.0, 0), None) is None
    assert free_space(exact("panda_conveyor"), 0.0) is None
    assert free_space(build(load_scene("panda_cage")), 0.0) is None


def test_the_contact_of_a_line_is_known_even_where_its_proofs_disagree() -> None:
    """A pair that is too near in the middle of an interval, of which the half before is proven to be free: here since
    things move farther than the bounds say. It is what was met, and is slid along."""
    problem = exact("panda_cage")
    *joints, kept = space_of(problem).fields
    assert isinstance(kept, tuple)

    def nearer(pairs: Record) -> Record:
        bound = pairs.fields[4]
        assert isinstance(bound, float | np.ndarray)
        return Record(pairs.kind, *pairs.fields[:4], 0.05 * bound, *pairs.fields[5:])

    small = tuple(map(nearer, kept))
    trees = Trees(problem, Record("space", *joints, small), np.random.default_rng(0))
    assert trees.grow(32) is not None or min(map(len, trees.nodes)) > 9
    for nodes in trees.nodes:
        assert np.isfinite(nodes).all()


def test_they_stop_when_it_is_over_and_grow_the_same_until_then() -> None:
    problem = exact("tiago_shelf")
    space = space_of(problem)
    calls = itertools.count()
    stopped, whole = (Trees(problem, space, np.random.default_rng((3, 0))) for _ in range(2))
    whole.grow(96)
    assert stopped.grow(96, lambda: next(calls) >= 1) is None
    for part, nodes in zip(stopped.nodes, whole.nodes, strict=True):
        assert 1 < len(part) < len(nodes)
        np.testing.assert_array_equal(part, nodes[: len(part)])
    ways = tree_ways(problem, 0.0, 0, lambda: True)
    assert [next(ways) for _ in range(3)] == [None] * 3
