"""Laws of the bounds over intervals: none is above the exact distance anywhere on its interval, later ones are
tighter."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hdplan.planner.certificate import Certifier
from hdplan.planner.interval_bounds import Bounds, Items
from hdplan.planner.intervals import Intervals
from hdplan.planner.scene_robot import load_scene_robot
from hdplan.scenes.model import Box, Capsule, Cylinder, Obstacle, Pose, Sphere
from hdplan.scenes.reader import load_scene

LOOKS = 5  # places on an interval at which the exact distance is compared
SHAPES = (Box((0.2, 0.1, 0.3)), Sphere(0.1), Cylinder(0.08, 0.3), Capsule(0.05, 0.2))


@pytest.fixture(scope="module", params=["panda_cage", "planar_arm", "kinova_shelf"])
def laid_out(request: pytest.FixtureRequest) -> tuple[Certifier, Intervals, np.ndarray]:
    """A robot among its scene's obstacles and some more, on a random motion of 4 intervals."""
    scene = load_scene(request.param)
    rng = np.random.default_rng(7)
    more = tuple(
        Obstacle(f"more {k}", SHAPES[k % 4], Pose(tuple(rng.uniform(-1.5, 1.5, 3).tolist()))) for k in range(8)
    )
    robot = load_scene_robot(scene)
    certifier = Certifier(dataclasses.replace(scene, obstacles=(*scene.obstacles, *more)), robot)
    waypoints = robot.draw(rng, 1) + np.cumsum(rng.normal(scale=0.2, size=(5, robot.n)), axis=0)
    bodies = certifier.sweep.bodies
    intervals = Intervals.of(bodies, waypoints, bodies.reach(waypoints), np.arange(4), np.zeros(4), np.ones(4))
    return certifier, intervals, waypoints


def exact(certifier: Certifier, waypoints: np.ndarray) -> np.ndarray:
    """The signed distance of the pairs' hulls at LOOKS places on each interval: (intervals, LOOKS, pairs)."""
    sweep, values = certifier.sweep, []
    for k in range(len(waypoints) - 1):
        for share in np.linspace(0, 1, LOOKS):
            q = waypoints[k] + share * (waypoints[k + 1] - waypoints[k])
            here = Intervals.of(
                sweep.bodies,
                np.stack([q, q]),
                sweep.bodies.reach(waypoints),
                np.zeros(1, np.int64),
                np.zeros(1),
                np.zeros(1),
            )
            bounds = Bounds(sweep.bodies, sweep.pairs)
            items = bounds.with_motion(here, Items.all(1, np.arange(len(sweep.pairs.a))))
            values.append(bounds.by_best_plane(here, items)[0])
    return np.array(values).reshape(len(waypoints) - 1, LOOKS, -1)


def test_no_bound_is_above_the_distance(laid_out: tuple[Certifier, Intervals, np.ndarray]) -> None:
    certifier, intervals, waypoints = laid_out
    sweep = certifier.sweep
    bounds, count = Bounds(sweep.bodies, sweep.pairs), len(sweep.pairs.a)
    least = exact(certifier, waypoints).min(axis=1)  # (intervals, pairs)
    assert np.all(bounds.over_all(intervals) <= least.min(axis=0))
    items = bounds.with_motion(intervals, Items.all(4, np.arange(count)))
    by_ball, normal = bounds.by_ball(intervals, items)
    _, by_plane = bounds.by_plane(intervals, items, normal)
    _, by_best, _ = bounds.by_best_plane(intervals, items)
    for bound in (by_ball, by_plane, by_best):
        assert np.all(bound.reshape(4, count) <= least)
    assert np.median(least.ravel() - by_best) < np.median(least.ravel() - by_ball)


def test_a_bound_over_all_is_no_better_than_over_one(laid_out: tuple[Certifier, Intervals, np.ndarray]) -> None:
    certifier, intervals, _ = laid_out
    bounds = Bounds(certifier.sweep.bodies, certifier.sweep.pairs)
    whole = bounds.over_all(intervals)
    gathered = certifier.sweep.bodies
    moving = gathered.chain.carried_by[gathered.joint[certifier.sweep.pairs.b]].any(axis=1)
    assert np.all(np.isneginf(whole[moving]))
    assert np.isfinite(whole[~moving]).all()
    by_ball, _ = bounds.by_ball(intervals, Items.all(4, np.arange(len(whole))))
    assert np.all(whole[~moving] <= by_ball.reshape(4, -1).min(axis=0)[~moving] + 1e-12)
