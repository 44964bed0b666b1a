"""Laws of the bounds over intervals: none is above the exact distance anywhere on its interval, later ones are
tighter."""

from __future__ import annotations

import dataclasses
import gc
import weakref

import numpy as np
import pytest

import hdplan
from hdplan import Box, Capsule, Cylinder, Ellipsoid, Obstacle, Pose, Sphere, SteadyMotion, TimedPoses, load_scene
from hdplan.planner.certificate import interval_bounds
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.interval_bounds import Bounds, Items
from hdplan.planner.certificate.intervals import Intervals
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from tests.loops import in_numpy

SAME = 1e-13  # [m] sums of three products, in another order
LOOKS = 5  # places on an interval at which the exact distance is compared
SHAPES = (Box((0.2, 0.1, 0.3)), Sphere(0.1), Cylinder(0.08, 0.3), Capsule(0.05, 0.2), Ellipsoid((0.04, 0.1, 0.2)))


LaidOut = tuple[Certifier, Intervals, Curve]


def drifting(rng: np.random.Generator) -> tuple[SteadyMotion | TimedPoses, ...]:
    """Moves and turns evenly, or from pose to pose, within the 4 s that the motion takes and beyond."""
    poses = []
    for _ in range(4):
        quaternion = rng.normal(size=4)
        poses.append(Pose(tuple(rng.uniform(-1, 1, 3)), tuple(quaternion / np.linalg.norm(quaternion))))
    velocity, spin = (tuple(rng.normal(scale=0.3, size=3).tolist()) for _ in range(2))
    return SteadyMotion(velocity, spin), TimedPoses((0.3, 1.0, 2.5, 6.0), tuple(poses))


@pytest.fixture(scope="module", params=["panda_cage", "planar_arm", "kinova_shelf", "moving panda_cage"])
def assembled(request: pytest.FixtureRequest) -> LaidOut:
    """A robot among its scene's obstacles and some more, on a random motion of 4 intervals: straight lines between
    waypoints, or quintics in time, and then some obstacles move."""
    scene, moving = load_scene(request.param.split()[-1]), request.param.startswith("moving")
    rng = np.random.default_rng(7)
    motions = drifting(rng) if moving else (None,)
    more = tuple(
        Obstacle(
            f"more {k}",
            SHAPES[k % len(SHAPES)],
            motion.poses[0] if isinstance(motion, TimedPoses) else Pose(tuple(rng.uniform(-1.5, 1.5, 3).tolist())),
            motion=motion,
        )
        for k in range(8)
        for motion in [motions[k % len(motions)]]
    )
    robot = load_scene_robot(scene)
    certifier = Certifier(Setup.of(dataclasses.replace(scene, obstacles=(*scene.obstacles, *more)), robot))
    waypoints = robot.draw(rng, 1) + np.cumsum(rng.normal(scale=0.2, size=(5, robot.n)), axis=0)
    bodies, curve = certifier.sweep.bodies, Curve.through(waypoints)
    if moving:
        rates = rng.normal(scale=0.3, size=(2, 5, robot.n))
        curve = Curve.through(waypoints, np.arange(5.0), *rates)
    intervals = Intervals.of(bodies, curve, bodies.reach(curve), np.arange(4), np.zeros(4), np.ones(4))
    return certifier, intervals, curve


def exact(certifier: Certifier, curve: Curve) -> np.ndarray:
    """The signed distance of the pairs' hulls at LOOKS places on each interval: (intervals, LOOKS, pairs)."""
    sweep, values = certifier.sweep, []
    for k in range(len(curve) - 1):
        for share in np.linspace(0, 1, LOOKS):
            place = np.full(1, k), np.full(1, share), np.zeros(1)
            here = Intervals.of(sweep.bodies, curve, sweep.bodies.reach(curve), *place)
            bounds = Bounds(sweep.bodies, sweep.pairs)
            items = Items.all(1, np.arange(len(sweep.pairs.a)))
            values.append(bounds.by_best_plane(here, items)[0])
    return np.array(values).reshape(len(curve) - 1, LOOKS, -1)


def test_no_bound_is_above_the_distance(assembled: LaidOut) -> None:
    certifier, intervals, curve = assembled
    sweep = certifier.sweep
    bounds, count = Bounds(sweep.bodies, sweep.pairs), len(sweep.pairs.a)
    least = exact(certifier, curve).min(axis=1)  # (intervals, pairs)
    assert np.all(bounds.over_all(intervals) <= least.min(axis=0))
    items = Items.all(4, np.arange(count))
    by_ball, normal = bounds.by_ball(intervals, items)
    _, by_plane, _ = bounds.by_plane(intervals, items, normal)
    _, by_best, _, _ = bounds.by_best_plane(intervals, items)
    for bound in (by_ball, by_plane, by_best):
        assert np.all(bound.reshape(4, count) <= least)
    assert np.median(least.ravel() - by_best) < np.median(least.ravel() - by_ball)


def test_the_loop_in_c_is_the_one_in_numpy(assembled: LaidOut, monkeypatch: pytest.MonkeyPatch) -> None:
    certifier, intervals, _ = assembled
    bounds, count = Bounds(certifier.sweep.bodies, certifier.sweep.pairs), len(certifier.sweep.pairs.a)
    items = Items.all(4, np.arange(count))
    normal = np.random.default_rng(8).normal(size=(4 * count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[::7, 1] = np.nan  # nothing may pass for proven
    compiled = bounds.by_plane(intervals, items, normal)
    in_numpy(monkeypatch, interval_bounds)
    for found, expected in zip(compiled, bounds.by_plane(intervals, items, normal), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=SAME)
    for found in compiled[:2]:
        assert np.isnan(found[::7]).all()
        assert np.isfinite(np.delete(found, np.s_[::7])).all()


def test_no_items_have_no_bounds(assembled: LaidOut, monkeypatch: pytest.MonkeyPatch) -> None:
    certifier, intervals, _ = assembled
    bounds, none = Bounds(certifier.sweep.bodies, certifier.sweep.pairs), Items.all(4, np.arange(0))
    for _ in range(2):
        assert [len(found) for found in bounds.by_ball(intervals, none)] == [0, 0]
        assert [len(found) for found in bounds.by_best_plane(intervals, none)] == [0, 0, 0, 0]
        in_numpy(monkeypatch, interval_bounds)


def test_a_bound_over_all_is_no_better_than_over_one(assembled: LaidOut) -> None:
    certifier, intervals, _ = assembled
    bounds = Bounds(certifier.sweep.bodies, certifier.sweep.pairs)
    whole = bounds.over_all(intervals)
    gathered = certifier.sweep.bodies
    second = certifier.sweep.pairs.b
    moving = gathered.chain.carried_by[gathered.joint[second]].any(axis=1) | gathered.drifting[second]
    assert np.all(np.isneginf(whole[moving]))
    assert np.isfinite(whole[~moving]).all()
    by_ball, _ = bounds.by_ball(intervals, Items.all(4, np.arange(len(whole))))
    assert np.all(whole[~moving] <= by_ball.reshape(4, -1).min(axis=0)[~moving] + 1e-12)


def test_balls_in_c_are_those_in_numpy(assembled: LaidOut, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some drift, one is inside another's box, and one place is not a number."""
    certifier, intervals, _ = assembled
    center, every = intervals.center.copy(), np.arange(len(certifier.sweep.bodies.bodies))
    center[intervals.row(2, every)] = center[intervals.row(2, 1)]
    center[intervals.row(1, certifier.sweep.bodies.moving[0])] = np.nan
    intervals = dataclasses.replace(intervals, center=center)
    bounds, count = Bounds(certifier.sweep.bodies, certifier.sweep.pairs), len(certifier.sweep.pairs.a)
    items = Items.all(4, np.arange(count))
    compiled = bounds.by_ball(intervals, items)
    in_numpy(monkeypatch, interval_bounds)
    plain = bounds.by_ball(intervals, items)
    known = ~np.isnan(plain[0])
    assert not known.all()
    np.testing.assert_allclose(compiled[0], plain[0], rtol=0, atol=SAME)
    np.testing.assert_allclose(compiled[1][known], plain[1][known], rtol=0, atol=SAME)


def test_a_still_body_has_one_place_and_a_moving_one_is_where_it_is_alone(assembled: LaidOut) -> None:
    certifier, intervals, curve = assembled
    bodies = certifier.sweep.bodies
    still = np.setdiff1d(np.arange(len(bodies.bodies)), bodies.moving)
    assert len(intervals.rotation) == len(bodies.bodies) + 4 * len(bodies.moving)
    every = intervals.row(np.arange(4)[:, None], np.arange(len(bodies.bodies)))  # (4, bodies)
    assert (every[:, still] == every[0, still]).all()
    assert len(np.unique(every[:, bodies.moving])) == 4 * len(bodies.moving)
    assert not intervals.reach[every[0, still]].any()
    for k in range(4):
        alone = Intervals.of(bodies, curve, bodies.reach(curve), np.array([k]), np.zeros(1), np.ones(1))
        here = alone.row(0, np.arange(len(bodies.bodies)))
        for name in ("rotation", "origin", "center", "reach", "moved"):
            np.testing.assert_array_equal(getattr(alone, name)[here], getattr(intervals, name)[every[k]])
        for row, body in zip(here, bodies.bodies, strict=True):
            if body.joint == 0 and body.obstacle_motion is None:
                np.testing.assert_array_equal(alone.rotation[row], body.placement[:3, :3])


def test_point_clouds_are_not_kept_once_their_scene_is_gone() -> None:
    """Clouds differ with every look of a camera: kept, they would fill the memory of a process that plans for days."""
    scene, rng = load_scene("empty"), np.random.default_rng(4)
    robot, gone = load_scene_robot(scene), []
    for _ in range(3):
        cloud = Obstacle("cloud", hdplan.Points(rng.normal(size=(30, 3))), Pose((2.0, 0.0, 2.0)))
        certifier = Certifier(Setup.of(dataclasses.replace(scene, obstacles=(cloud,)), robot))
        certifier.certify(hdplan.Trajectory(robot.joint_names, np.zeros((2, robot.n))), check_ends=False)
        gone.append(weakref.ref(certifier.sweep.bodies.pieces[-1]))
        del certifier
    gc.collect()
    assert [each() for each in gone] == [None] * 3
