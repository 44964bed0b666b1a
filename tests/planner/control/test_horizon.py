"""Laws of the horizon: no nearer pair is overlooked, nothing beyond it matters, and clouds are avoided."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hdplan import Attached, Box, Cloud, InputError, Pose, Robot, RobotSpec, Sphere
from hdplan.control import BarrierSettings, Controller, ControlSettings, Mode, scene_barriers, simulate, standing
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.collision.collision_model import collision_model_of
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.obstacles import Obstacle, SteadyMotion

from ..links import place_of
from .rooms import READY, certificate, scene_of

HANGING = RobotSpec("panda", base=Pose((0.0, 0.0, 1.2), (1.0, 0.0, 0.0, 0.0)))


def clutter(rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """A cloud that is turned, boxes, and a ball that comes."""
    cloud = Cloud(rng.uniform(-0.5, 0.5, size=(1000, 3)), 0.005)
    boxes = [Obstacle(f"box{k}", Box((0.1, 0.2, 0.05)), Pose(tuple(rng.uniform(-0.8, 0.8, 3)))) for k in range(4)]
    ball = Obstacle("ball", Sphere(0.05), Pose((0.9, 0.0, 0.5)), motion=SteadyMotion((-0.1, 0.0, 0.0)))
    return Obstacle("view", cloud, Pose((0.6, 0.1, 0.4), (0.1, 0.3, -0.3, 0.9)), 0.01), *boxes, ball


@pytest.mark.sampled(5)
@pytest.mark.parametrize("distance", ["hdsdf", "euclidean"])
@pytest.mark.parametrize("spec", ["panda", HANGING, "ur5"], ids=["panda", "hanging", "ur5"])
def test_no_pair_nearer_than_the_horizon_is_overlooked(distance: str, spec: str | RobotSpec) -> None:
    rng = np.random.default_rng(0)
    obstacles = clutter(rng) if distance == "hdsdf" else clutter(rng)[1:]
    start = READY[: 6 if spec == "ur5" else 7]
    scene = scene_of(*obstacles, robot=spec, start=start, goal=start)
    robot = load_scene_robot(scene)
    barriers = scene_barriers(scene, robot, BarrierSettings(distance))
    left = 0
    for q in robot.draw(rng, 10):
        time, horizon = rng.uniform(0.0, 2.0), float(rng.choice([0.01, 0.1, 0.25, 0.5]))
        seen = barriers.at(q[None], np.array([time])).within(horizon)
        separation = barriers.evaluate(q, time).separation
        beyond = np.setdiff1d(np.arange(len(barriers.names)), seen)
        assert (separation[beyond] >= horizon - 1e-9).all()
        assert barriers.standing[beyond].all()
        np.testing.assert_array_equal(seen, np.unique(seen))
        left += len(beyond)
    assert left
    assert len(barriers.at(robot.draw(rng, 1), np.zeros(1)).within(np.inf)) == len(barriers.names)


def test_obstacles_beyond_the_horizon_change_no_command(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    boxes = [Obstacle(f"box{k}", Box((0.1, 0.1, 0.1)), Pose(tuple(rng.uniform(-0.9, 0.9, 3)))) for k in range(30)]
    controller, compared = Controller.of(scene_of(*boxes), robot=robot), 0
    for q, goal in zip(robot.draw(rng, 20), robot.draw(rng, 20), strict=True):
        step = controller.step(q, standing(goal))
        near = {controller.barriers.names[pair][1] for pair in step.pairs.tolist()}
        some = Controller.of(scene_of(*(box for box in boxes if box.name in near)), robot=robot)
        other = some.step(q, standing(goal))
        np.testing.assert_allclose(other.velocity, step.velocity, atol=1e-9)
        assert (other.mode, other.slack) == (step.mode, step.slack)
        compared += len(near) < len(boxes)
    assert compared > 10


def test_the_rate_grows_toward_the_horizon(robot: Robot) -> None:
    """An arm that is driven straight at a wall is braked as the module's equation says, and from the horizon on not."""
    goal = READY + [0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.0]
    for away, free in ((0.55, False), (0.9, True)):
        wall = scene_of(Obstacle("wall", Box((0.02, 2.0, 2.0)), Pose((away, 0.0, 0.5))))
        settings = ControlSettings(look_ahead=False, horizon=0.3, rise=0.0)
        controller = Controller.of(wall, settings, robot)
        step = controller.step(READY, standing(goal, gain=50.0))
        outer = step.pairs < controller.barriers.obstacle_pairs
        assert outer.any() != free
        rows, slack = step.rows, step.rows.value - np.where(outer, settings.margin, settings.self_margin)
        rate = settings.rate / np.where(outer, 1.0 - (rows.separation / 0.3) ** 2, 1.0)
        binding = rows.gradient @ step.velocity + rate * slack
        assert binding.min() > -1e-6
        assert (binding[outer].min(initial=np.inf) < 1e-6) != free
        linear = Controller.of(wall, replace(settings, as_published=True), robot).step(READY, standing(goal))
        assert len(linear.pairs) == len(controller.barriers.names)


def test_obstacles_in_no_pair_stay_beyond_the_proven_distance(robot: Robot) -> None:
    """Balls and points are about as far as the arm reaches, whatever the margin."""
    rng, model, left = np.random.default_rng(5), collision_model_of(robot, "fitted", "box"), 0
    ways = rng.normal(size=(60, 3))
    places = [0.0, 0.0, 0.333] + ways / np.linalg.norm(ways, axis=1)[:, None] * rng.uniform(0.3, 1.9, (60, 1))
    balls = [Obstacle(f"ball{k}", Sphere(0.02), Pose(tuple(place))) for k, place in enumerate(places[:30])]
    clouds = [Obstacle(f"view{k}", Cloud(place[None], 0.02)) for k, place in enumerate(places[30:])]
    for distance in ("hdsdf", "euclidean"):
        seen = balls + clouds if distance == "hdsdf" else balls
        barriers = scene_barriers(scene_of(*seen), robot, BarrierSettings(distance))
        named = set(barriers.names)
        proven = [barriers.clearance(margin) for margin in (0.014, 0.1, 0.5)]
        for body, reach in zip(model.bodies, model.reach, strict=True):
            gaps = np.linalg.norm(places - reach.centre, axis=1) - reach.radius - 0.02
            for obstacle, gap in zip(seen, gaps.tolist(), strict=False):
                if body.joint > 0 and (body.link, obstacle.name) not in named:
                    assert all(each is not None and gap >= each for each in proven)
                    left += 1
    assert left > 100


def test_an_arm_goes_about_its_way_clear_of_a_cloud(robot: Robot) -> None:
    """Through a gap in a wall of points, each step from what is near alone; what was executed is certified."""
    rng = np.random.default_rng(2)
    wall = rng.uniform([0.25, -0.01, 0.0], [0.9, 0.01, 1.0], size=(12_000, 3))
    wall = wall[~((np.abs(wall[:, 0] - 0.5) < 0.25) & (wall[:, 2] > 0.35))]
    scene = scene_of(Obstacle("view", Cloud(wall, 0.005)))
    begin, end = READY + [-0.6, 0, 0, 0, 0, 0, 0], READY + [0.6, 0, 0, 0, 0, 0, 0]
    controller = Controller.of(scene, robot=robot)
    step = controller.step(begin, standing(end))
    assert len(step.pairs) < 0.5 * len(controller.barriers.names)
    run = simulate(controller, begin, standing(end, gain=2.0), 3.0, until_met=False)
    assert Mode.STOPPED not in run.counted
    verdict = certificate(scene, robot, run)
    assert verdict.certified
    assert verdict.clearance is not None
    assert verdict.clearance > 0.0


def test_a_horizon_nearer_than_the_margin_is_refused(robot: Robot) -> None:
    scene = scene_of(Obstacle("box", Box((0.1, 0.1, 0.1)), Pose((0.6, 0.0, 0.4))))
    with pytest.raises(InputError, match=r"control\.horizon: 0\.02 m is too near for a margin of 0\.014 m, more than"):
        Controller.of(scene, ControlSettings(horizon=0.02), robot)
    with pytest.raises(InputError, match=r"horizon"):
        ControlSettings(horizon=0.0)


def test_an_updated_world_equals_a_new_one(robot: Robot) -> None:
    """Obstacles, clouds and what is held are exchanged while the arm moves on from its last command."""
    rng = np.random.default_rng(4)
    first = Controller.of(scene_of(*clutter(rng)), robot=robot)
    goal, q = robot.draw(rng, 1)[0], READY
    step = first.step(q, standing(goal))
    for _ in range(3):
        seen = clutter(rng)
        step, known = (
            each.step(q + 0.005 * step.velocity, standing(goal), 0.1, step.command)
            for each in (first.update(seen), Controller.of(scene_of(*seen), robot=robot))
        )
        np.testing.assert_array_equal(step.velocity, known.velocity)
        assert (step.mode, step.slack, step.proven) == (known.mode, known.slack, known.proven)
    held = Attached("bar", "panda_hand", Box((0.3, 0.05, 0.05)), Pose((0.0, 0.0, 0.13)))
    assert any(a == "bar" for a, _ in first.update(attached=[held]).barriers.names)
    assert first.update(()).barriers.obstacle_pairs == 0
    with pytest.raises(InputError, match="not made of a scene"):
        Controller(robot, first.barriers, first.settings).update(())


def test_a_cloud_leaves_out_points_around_the_robot_where_it_is(robot: Robot) -> None:
    """Not around the scene's start, where something else may be by now."""
    goal = READY + 0.6
    hand = place_of(robot, "panda_hand", READY).translation
    seen = [Obstacle("camera", Cloud([hand, hand + [2.0, 0.0, 0.0]], 0.01, ignore_robot=0.05))]
    controller = Controller.of(scene_of(), robot=robot)
    with pytest.raises(InputError, match=r"^q: is needed: cloud 'camera'"):
        controller.update(seen)
    away, around = controller.update(seen, q=goal), controller.update(seen, q=READY)
    assert away.barriers.obstacle_pairs > 0
    assert around.barriers.obstacle_pairs == 0
    assert away.update(attached=[]).barriers.obstacle_pairs == away.barriers.obstacle_pairs  # nothing more is left out
    with pytest.raises(InputError, match=r"^obstacles: must be a list of obstacles"):
        controller.update(seen[0])


def test_beside_a_moving_obstacle_a_clearance_is_proven(robot: Robot) -> None:
    """While all pairs keep their margins: less than the true clearance to where the ball then is."""
    motion = SteadyMotion((-0.2, 0.0, 0.0), (0.0, 1.0, 0.0))
    ball = Obstacle("ball", Sphere(0.08), Pose((0.9, 0.3, 0.5)), motion=motion)
    scene = scene_of(ball)
    controller, certifier = Controller.of(scene, robot=robot), Certifier(Setup.of(scene, robot))
    run = simulate(controller, READY, standing(READY + 0.2), 0.5, until_met=False)
    assert run.proven is not None
    assert run.proven > 0.0
    true = [certifier.nearest(q, np.inf, time=t)[0] for t, q in zip(run.times[::10], run.positions[::10], strict=True)]
    assert min(place.distance for place in true if place is not None) >= run.proven
