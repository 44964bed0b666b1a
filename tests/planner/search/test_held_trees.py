"""Laws of the trees on path constraints: what they find is certified as it is, none of their lines leaves a constraint
or touches anything, and the search takes it where no solver gets there."""

from __future__ import annotations

import functools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from hdplan import Problem, Trajectory, build, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.problem.assemble import exactly
from hdplan.planner.search.free_space import free_space, is_free
from hdplan.planner.search.guesses import Guess
from hdplan.planner.search.held_trees import LONGEST_STRETCH, HeldTrees, held_ways
from hdplan.planner.search.search import Search
from hdplan.planner.solvers.solution import Budget, Solution, Solver, SolverStatus
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array
from tests.loops import needs_loops

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

from constrained import request

pytestmark = needs_loops

REQUESTS = (("upright", 0), ("upright", 1), ("position", 9), ("position", 5))  # Panda, UR5; paths, and timed


@functools.cache
def exact(kind: str, number: int) -> Problem:
    return exactly(build(request(kind, number)))


@functools.cache
def way_of(kind: str, number: int) -> Array:
    return next(found for found in held_ways(exact(kind, number), 0.0, 3) if found is not None)


def most_used(problem: Problem, q: Array) -> float:
    """The greatest share of a bound that is used up at configurations (B, n)."""
    placed = problem.placed(q)
    measures = [term.measure for term in problem.terms.path]
    return max(float((np.linalg.norm(each.value(placed), axis=2) / each.bound).max()) for each in measures)


@pytest.mark.parametrize(("kind", "number"), REQUESTS)
def test_a_way_of_held_trees_joins_the_ends_and_is_certified(kind: str, number: int) -> None:
    problem, way = exact(kind, number), way_of(kind, number)
    np.testing.assert_array_equal(way[[0, -1]], [problem.start, problem.goal])
    motion = Trajectory(problem.robot.joint_names, way, problem.robot.locked)
    timed = Retimer(problem.setup)(motion).trajectory if problem.scene.timed else motion
    assert Certifier(problem.setup).certify(timed, required=0.0).certified


@pytest.mark.parametrize(("kind", "number"), REQUESTS)
def test_no_line_leaves_a_constraint_or_touches_anything(kind: str, number: int) -> None:
    """Whole trees at dense samples, nodes within the limits; and the trees are trees."""
    problem = exact(kind, number)
    space = free_space(problem, 0.0)
    assert space is not None
    trees = HeldTrees(problem, space, np.random.default_rng(5))
    trees.grow(32)
    lower, upper = problem.robot.inner
    for nodes, parents in zip(trees.nodes, trees.parents, strict=True):
        assert (parents[1:] < np.arange(1, len(nodes))).all()
        assert ((nodes >= lower) & (nodes <= upper)).all()
        for first, last in zip(nodes[1:60], nodes[parents[1:60]], strict=True):
            assert np.linalg.norm(last - first) <= LONGEST_STRETCH * trees.step + 1e-12
            assert most_used(problem, first + np.linspace(0.0, 1.0, 17)[:, None] * (last - first)) <= 1.0
            assert is_free(space, first, last)
    assert max(map(len, trees.nodes)) > 9


def test_the_same_seed_finds_the_same_and_another_one_another() -> None:
    problem = exact("upright", 1)
    again, other = (next(way for way in held_ways(problem, 0.0, seed) if way is not None) for seed in (3, 4))
    np.testing.assert_array_equal(again, way_of("upright", 1))
    assert other.shape != again.shape or np.abs(other - again).max() > 0.0


def test_there_are_none_for_links_that_keep_a_relative_pose_and_once_it_is_over() -> None:
    held_together = exactly(build(load_scene("baxter_bimanual_carry")))
    assert next(held_ways(held_together, 0.0, 0), None) is None
    ways = held_ways(exact("upright", 0), 0.0, 0, lambda: True)
    assert [next(ways) for _ in range(3)] == [None] * 3


@pytest.mark.parametrize("number", [9, 5])  # a path, and timed
def test_a_search_takes_the_way_itself_where_its_waypoints_lead_nowhere(number: int) -> None:
    """But none that its certificate refuses."""
    problem, way = exact("position", number), way_of("position", number)

    def stall(problem: Problem, guess: Array, budget: Budget) -> Solution:
        motion = Trajectory(problem.robot.joint_names, guess, problem.robot.locked)
        return Solution(motion, SolverStatus.STALLED, 1.0, (), 0.0)

    retimer = Retimer(problem.setup) if problem.scene.timed else None
    given = problem, Certifier(problem.setup), retimer, Solver(stall), 0.0, math.inf
    search = Search(*given, lambda event: None, lambda: False)
    assert not search.attempt(Guess(problem.polyline(), way=way[[0, -1]]))
    assert not search.certified
    assert search.attempt(Guess(problem.polyline(), way=way))
    assert search.certified
    assert search.best is not None
    assert search.best.path.shape == (problem.waypoints, problem.robot.n)
    if retimer is None:
        np.testing.assert_array_equal(search.best.trajectory.positions, way)
