"""Laws of first guesses where obstacles move: time never goes back, costs are those of the places at their times, the
same backwards in time; and scenes whose only way is to wait, to hurry or to step aside."""

from __future__ import annotations

import dataclasses
import itertools
import sys
from pathlib import Path

import numpy as np
import pytest

from hdplan import Attached, Box, Cylinder, Mesh, Pose, Problem, Scene, Sphere, Timing, Trajectory, build, plan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.escape import escapes
from hdplan.planner.search.roadmap import DOUBLING_DEPTH, seeds
from hdplan.planner.search.space_time import EDGE_STEPS, PENALTY_WEIGHT, TIME_STEPS, TimedRoadmap
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

import traffic

ACROSS = (0.5**0.5, 0.0, 0.0, 0.5**0.5)  # the quaternion of a quarter turn about x


def backwards(scene: Scene) -> Scene:
    """The same scene, mirrored in time."""
    obstacles, end = [], scene.end_time
    for each in scene.obstacles:
        if each.motion is not None:
            assert isinstance(each.motion, TimedPoses)
            times, poses = [end - time for time in each.motion.times[::-1]], each.motion.poses[::-1]
            each = Obstacle(each.name, each.shape, motion=TimedPoses(times, poses))
        obstacles.append(each)
    start, goal = scene.goal.positions, scene.start.positions
    return dataclasses.replace(scene, obstacles=tuple(obstacles), start=start, goal=goal)


@pytest.fixture(scope="module")
def gate() -> Scene:
    return load_scene("panda_gate")


@pytest.fixture(scope="module")
def problem(gate: Scene) -> Problem:
    return build(gate)


def roadmap(problem: Problem, seed: int = 0) -> TimedRoadmap:
    first, last = escapes(problem)
    return TimedRoadmap(problem, np.random.default_rng(seed), first, last[::-1])


def guesses(problem: Problem, seed: int, count: int = 6) -> list[Array]:
    return list(itertools.islice(seeds(problem, seed), count))


def sides(problem: Problem, trajectory: Trajectory) -> tuple[Array, Array]:
    """The times of a motion [s], and on which side of the gate the hand is."""
    assert trajectory.times is not None
    placements = kinematics_of(problem.robot).evaluate(trajectory.positions)
    return trajectory.times, placements.translations[:, -1, 1]


# --- guesses --------------------------------------------------------------------------------------------------------


def test_the_straight_line_comes_first(problem: Problem) -> None:
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    np.testing.assert_allclose(guesses(problem, 3, 1)[0], line, rtol=0, atol=1e-12)


def test_guesses_have_the_ends_and_keep_the_limits(problem: Problem) -> None:
    for guess in guesses(problem, 3):
        assert guess.shape == (problem.waypoints, problem.robot.n)
        np.testing.assert_array_equal(guess[[0, -1]], [problem.start, problem.goal])
        assert np.all((guess >= problem.robot.lower) & (guess <= problem.robot.upper))


def test_the_same_seed_gives_the_same_guesses_and_no_two_are_alike(problem: Problem) -> None:
    found = guesses(problem, 5)
    assert [guess.tobytes() for guess in found] == [guess.tobytes() for guess in guesses(problem, 5)]
    assert len({guess.tobytes() for guess in found}) == len(found)


def test_time_never_goes_back_along_a_way(problem: Problem) -> None:
    """Moves follow one another without a gap, from the start at the first step to the goal at the last one."""
    found = roadmap(problem, 2)
    for _ in range(4):
        found._extend()
        node, step = 0, 0
        for move in found._cheapest(found._edge_costs(np.arange(len(found.edges)))):
            assert move.first == step
            assert move.last > step
            if move.edge is None:
                assert (move.node, move.last) == (node, step + 1)
            else:
                assert set(found.edges[move.edge]) == {node, move.node}
                assert move.last - move.first in EDGE_STEPS
            node, step = move.node, move.last
        assert (node, step) == (1, TIME_STEPS)
        found.timed_way()
        found.grow()


def test_the_cost_of_a_move_counts_obstacles_at_its_own_times(problem: Problem) -> None:
    """The penalty of a move is that of the motion at its own configurations and times, but for interpolation."""
    found = roadmap(problem, 1)
    found.timed_way()
    found.grow()
    found._extend()
    edges = np.arange(0, len(found.edges), 7)
    penalties, rng, compared = found._penalties(edges), np.random.default_rng(0), []
    for row, edge in enumerate(edges.tolist()):
        way, take = int(rng.integers(2)), int(rng.integers(len(EDGE_STEPS)))
        step = int(rng.integers(TIME_STEPS - EDGE_STEPS[take] + 1))
        first, last = found.nodes[found.edges[edge][:: 1 - 2 * way]]
        along = (np.arange(200) + 0.5) / 200
        depth = problem.depth(first + along[:, None] * (last - first), (step + along * EDGE_STEPS[take]) / TIME_STEPS)
        compared.append((float(np.mean(depth**2)), float(penalties[row, way, step, take]) * DOUBLING_DEPTH**2))
    exact, estimated = np.array(compared).T
    assert np.count_nonzero(exact > 1e-4) > 5  # the gate is met at all
    np.testing.assert_allclose(np.sqrt(estimated), np.sqrt(exact), rtol=0.2, atol=DOUBLING_DEPTH)


def test_a_guess_knows_the_movers(problem: Problem) -> None:
    """The straight line goes deep through the gate, further guesses hardly touch it, and no joint is too fast."""
    velocity = problem.terms.velocity
    assert velocity is not None

    def depth(guess: Array) -> float:
        samples = problem.resampled(guess).samples
        return float(problem.depth(samples.configurations(guess), samples.parameter).max())

    line, *others = guesses(problem, 0)
    assert depth(line) > 0.05
    assert max(depth(guess) for guess in others) < 0.03
    assert max(velocity.over_motion(guess, problem.kinematics).depth.max() for guess in others) < DOUBLING_DEPTH


def test_the_first_way_costs_the_same_backwards_in_time(gate: Scene, problem: Problem) -> None:
    costs = []
    for each in (problem, build(backwards(gate))):
        found = roadmap(each)
        found._extend()
        edges = np.arange(len(found.edges))
        found.penalties = found._penalties(edges)
        edge_costs, cost = found._edge_costs(edges), 0.0
        stay = PENALTY_WEIGHT / TIME_STEPS * (found.waits[:, 1:] + found.waits[:, :-1]) / 2
        for move in found._cheapest(edge_costs):
            if move.edge is None:
                cost += stay[move.node, move.first]
            else:
                back = int(found.edges[move.edge, 0] == move.node)
                cost += edge_costs[move.edge, back, move.first, list(EDGE_STEPS).index(move.last - move.first)]
        costs.append(cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-3)  # time at the steps is interpolated, from either end


# --- plans ----------------------------------------------------------------------------------------------------------


@pytest.mark.core
def test_the_motion_waits_if_that_is_the_only_way(gate: Scene, problem: Problem) -> None:
    line = Retimer(problem.setup)(Trajectory(problem.robot.joint_names, problem.polyline(), problem.robot.locked))
    assert not Certifier(problem.setup).certify(line.trajectory).certified
    result = plan(gate)
    assert result.certified, result.certificate.text
    times, side = sides(problem, result.trajectory)
    assert np.all(side[times < 3.0] < 0.0)  # until the gate begins to open
    assert side[-1] > 0.0


def test_the_motion_hurries_if_that_is_the_only_way(gate: Scene) -> None:
    scene = backwards(gate)
    result = plan(scene)
    assert result.certified, result.certificate.text
    times, side = sides(build(scene), result.trajectory)
    assert np.all(side[times > 3.0] < 0.0)  # from when the gate is shut


def test_a_held_object_waits_with_the_robot(gate: Scene) -> None:
    held = Attached("rod", "panda_hand", Cylinder(0.02, 0.4), Pose((0.0, 0.0, 0.14), ACROSS))
    touching = dataclasses.replace(held, touch_links=("panda_leftfinger", "panda_rightfinger"))
    scene = dataclasses.replace(gate, attached=(touching,))
    result = plan(scene)
    assert result.certified, result.certificate.text
    times, side = sides(build(scene), result.trajectory)
    assert np.all(side[times < 3.0] < 0.0)


def test_a_mesh_that_is_not_convex_is_waited_for(gate: Scene) -> None:
    """A hook as large as the arm stands across until late, in place of the gate."""
    hook = Mesh(shipped_scenes()["empty"].with_name("hook.obj"), scale=(6.0, 3.0, 5.0))
    poses = [Pose((0.6, -0.1, 0.0)), Pose((0.6, -0.1, 2.0))]
    standing = Obstacle("hook", hook, motion=TimedPoses([3.0, 3.6], poses))
    scene = dataclasses.replace(gate, obstacles=(*gate.obstacles[:2], standing))
    result = plan(scene)
    assert result.certified, result.certificate.text


def test_a_robot_that_is_to_stay_steps_aside() -> None:
    """Start and goal are one, and a ball comes through that place meanwhile."""
    empty = load_scene("empty")
    problem = build(empty)
    place = kinematics_of(problem.robot).evaluate(problem.start[None]).translations[0, -1]
    ball = Obstacle("ball", Sphere(0.08), Pose(tuple(place - (0.0, 1.0, 0.0))), motion=SteadyMotion((0.0, 0.5, 0.0)))
    stay = dataclasses.replace(empty, obstacles=(ball,), timing=Timing(duration=4.0)).with_goal(problem.start.tolist())
    found = build(stay)
    for guess in guesses(found, 0, 4):
        assert np.isfinite(guess).all()
    result = plan(stay)
    assert result.certified, result.certificate.text
    assert np.ptp(result.trajectory.positions, axis=0).max() > 0.1


def test_few_waypoints_are_enough(gate: Scene) -> None:
    problem = build(dataclasses.replace(gate, planner=dataclasses.replace(gate.planner, waypoints=9)))
    for guess in guesses(problem, 0):
        assert guess.shape == (9, problem.robot.n)


def test_an_obstacle_beside_the_base_leaves_the_roadmap_its_nodes() -> None:
    """The floor under the robot is always inside its shoulder's margin; the roadmap grows all the same."""
    floor = Obstacle("floor", Box((3.0, 3.0, 0.1)), Pose((0.0, 0.0, -0.06)))
    ball = Obstacle("ball", Sphere(0.1), Pose((0.5, -1.0, 0.5)), motion=SteadyMotion((0.0, 0.5, 0.0)))
    scene = Scene(
        robot="ur5", obstacles=[floor, ball], timing=Timing(duration=4.0), start=[-1.0, -1.4, 1.7, -1.9, -1.57, 0.0],
        goal=[0.8, -1.2, 1.5, -1.9, -1.57, 0.0],
    )  # fmt: skip
    problem = build(scene)
    found = roadmap(problem)
    assert problem.depth(problem.start[None])[0] > 0.0
    count = len(found.nodes)
    found.grow()
    assert len(found.nodes) > count + 10


@pytest.mark.slow
@pytest.mark.parametrize("k", range(8))
def test_random_traffic_is_planned(k: int) -> None:
    """Scenes of the benchmark, of a seed of their own: what solves them, the plan finds, where the straight line is
    hit."""
    made = traffic.traffic(7, k)
    setup = Setup.of(made.scene)
    for positions, certified in ((made.built, True), (build(made.scene).polyline(), False)):
        path = Trajectory(setup.robot.joint_names, positions, setup.robot.locked)
        assert Certifier(setup).certify(Retimer(setup)(path).trajectory, required=0.0).certified is certified
    result = plan(made.scene)
    assert result.certified, result.certificate.text
