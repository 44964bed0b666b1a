"""Laws of first guesses: the straight line first where there is room, exact ends, kept limits, the same by seed."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hdplan import Box, Obstacle, Pose, Problem, RobotSpec, Scene, build, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.search.escape import escapes
from hdplan.planner.search.roadmap import Roadmap, seeds
from hdplan.planner.solvers.solution import DETOUR_WEIGHT, is_narrow
from hdplan.scenes.array_types import Array
from hdplan.scenes.targets import JointTarget

from ..urdf import joint_text, link_text, write_robot

EXACT = 1e-12  # [rad]
COUNT = 9  # examined guesses: every kind of draw comes up


@pytest.fixture(scope="module", params=["planar_arm", "panda_cage"])
def problem(request: pytest.FixtureRequest) -> Problem:
    return build(load_scene(request.param))


def first(problem: Problem, seed: int, count: int = COUNT) -> list[Array]:
    return list(itertools.islice(seeds(problem, seed), count))


def test_the_straight_line_comes_first_or_what_is_cheaper_at_a_narrow_end(problem: Problem) -> None:
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    for seed in (0, 1):
        one, other = first(problem, seed, 2)
        if is_narrow(problem):
            straight = min((one, other), key=lambda guess: np.abs(guess - line).max())
            costs = [problem.evaluate(guess, DETOUR_WEIGHT).cost for guess in (one, other)]
            assert costs[0] <= costs[1]
        else:
            straight = one
        np.testing.assert_allclose(straight, line, rtol=0, atol=EXACT)


def test_guesses_have_the_ends_and_keep_the_limits(problem: Problem) -> None:
    for guess in first(problem, 3):
        assert guess.shape == (problem.waypoints, problem.robot.n)
        np.testing.assert_array_equal(guess[[0, -1]], [problem.start, problem.goal])
        assert np.all((guess >= problem.robot.lower) & (guess <= problem.robot.upper))


def test_the_same_seed_gives_the_same_guesses(problem: Problem) -> None:
    for one, other in zip(first(problem, 5), first(problem, 5), strict=True):
        assert one.tobytes() == other.tobytes()


def test_guesses_differ_from_each_other_and_between_seeds(problem: Problem) -> None:
    """But for the straight line, and the one by the ways back from narrow ends."""
    several = [guess.tobytes() for seed in (1, 2) for guess in first(problem, seed)[2:]]
    assert len(set(several)) == len(several)


def test_through_is_the_polyline_at_equal_steps(problem: Problem) -> None:
    """Every waypoint lies on the polyline, and the way along it from one to the next is the same everywhere."""
    via = [problem.start + 0.1, problem.goal - 0.3]
    corners = np.array([problem.start, *via, problem.goal])
    lengths = np.append(0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    expected = []
    for way in np.linspace(0, lengths[-1], problem.waypoints):
        k = min(int(np.searchsorted(lengths, way, side="right")) - 1, len(corners) - 2)
        share = (way - lengths[k]) / (lengths[k + 1] - lengths[k])
        expected.append((1 - share) * corners[k] + share * corners[k + 1])
    np.testing.assert_allclose(problem.polyline(via), expected, rtol=0, atol=EXACT)


def test_random_guesses_are_chosen_by_their_penalty(
    problem: Problem, penalties: Callable[[Problem, Array], Array]
) -> None:
    """They touch less on the whole than lines through any random configuration."""
    low, high = np.maximum(problem.robot.lower, -np.pi), np.minimum(problem.robot.upper, np.pi)
    drawn = np.random.default_rng(4).uniform(low, high, (COUNT, problem.robot.n))
    blind = [penalties(problem, problem.polyline([via])).mean() for via in drawn]
    chosen = [penalties(problem, guess).mean() for guess in first(problem, 4)[1:]]
    assert np.mean(chosen) < np.mean(blind)


def test_start_and_goal_may_be_one() -> None:
    scene = load_scene("planar_arm")
    same = dataclasses.replace(scene, goal=JointTarget("goal", state="right"))
    problem = build(same)
    for guess in first(problem, 0):
        np.testing.assert_array_equal(guess[[0, -1]], [problem.start] * 2)
        assert np.isfinite(guess).all()
    assert np.ptp(first(problem, 0, 1)[0], axis=0).max() == 0


ROUND = (
    link_text("base"),
    link_text("arm", box="0.4 0.05 0.05", at="0.5 0 0"),
    link_text("tip", box="0.3 0.05 0.05", at="0.3 0 0"),
    joint_text("turn", "base", "arm", kind="continuous"),
    joint_text("bend", "arm", "tip", "0 1 0", kind="continuous", at="0.7 0 0"),
)


def test_guesses_for_joints_without_limits_are_the_same_whole_turns_away(tmp_path: Path) -> None:
    """A start after seven turns is the same place: no guess is pulled back to where the joints are at 0."""
    spec, ends = RobotSpec(urdf=write_robot(tmp_path / "round.urdf", *ROUND)), np.array([[0.3, 0.1], [1.6, -0.2]])
    post = Obstacle("post", Box((0.3, 0.3, 1.6)), Pose((0.6, 0.8, 0.3)))
    at_zero, away = (
        build(Scene(robot=spec, obstacles=[post], start=turned[0].tolist(), goal=turned[1].tolist()))
        for turned in (ends, ends + 14 * np.pi)
    )
    for one, other in zip(first(at_zero, 0), first(away, 0), strict=True):
        np.testing.assert_allclose(other - 14 * np.pi, one, rtol=0, atol=1e-9)


def test_ways_back_lead_to_where_nothing_is_near() -> None:
    """A way leads from beside an obstacle in short steps within the limits; none where there is room."""
    problem = build(load_scene("panda_cage"))
    back, _ = escapes(problem)
    way = np.vstack([problem.start, back])
    assert len(back)
    assert np.all((way >= problem.robot.lower) & (way <= problem.robot.upper))
    certifier = Certifier(problem.setup)
    places = [certifier.nearest(q, 1.0)[0] for q in (way[0], way[-1])]
    distances = [place.distance for place in places if place is not None]
    assert distances[1] > 3 * distances[0]
    scene = load_scene("empty")
    assert [len(way) for way in escapes(build(scene))] == [0, 0]


def test_a_roadmap_grows_where_no_configuration_is_outside_all_margins() -> None:
    """A floor just below the base is always within the shoulder's margin."""
    scene = load_scene("ur5_table")
    floor = Obstacle("floor", Box((2.0, 2.0, 0.1)), Pose((0.0, 0.0, scene.robot.base.position[2] - 0.06)))
    problem = build(dataclasses.replace(scene, obstacles=(floor,)))
    drawn = problem.robot.draw(np.random.default_rng(0), 100)
    assert (problem.depth(drawn) > 0.0).all()
    grown = Roadmap(problem, np.random.default_rng(0))
    grown.grow()
    assert len(grown.nodes) > 2
