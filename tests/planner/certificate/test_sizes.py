"""Laws of what is unknown: no world within a scene's sizes is closer than what is proven; no size is no change; larger
sizes prove no more; and messages give what is unknown in millimetres."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan import Calibration, InputError, Obstacle, Pose, Scene, Sphere, Tracking, Trajectory, Uncertainty, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.intervals import Intervals
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.robot_curve import curve_of, unfolded_curve
from hdplan.planner.robot.setup import Setup

from .worlds import Worlds

LESS = 1e-9  # [m] for coal's own rounding


def sized(scene: Scene, around: Uncertainty | None = None, **robot: Any) -> Scene:
    """The scene with these sizes of all obstacles and of the robot."""
    obstacles = [dataclasses.replace(each, uncertainty=around) for each in scene.obstacles]
    sizes = {"tracking": None, "calibration": None, **robot}
    return dataclasses.replace(scene, obstacles=obstacles, robot=dataclasses.replace(scene.robot, **sizes))


def random_scene(seed: int, robot: str, home: list[float], **more: Any) -> tuple[Scene, Trajectory]:
    """Things around a robot, each with sizes of its own, some of which move; and a motion near its home."""
    rng = np.random.default_rng(seed)
    shapes = [hdplan.Box(rng.uniform(0.1, 0.5, 3)), Sphere(0.1), hdplan.Capsule(0.05, 0.4), hdplan.Cylinder(0.08, 0.3)]
    obstacles = []
    for i, shape in enumerate(shapes):
        way = rng.normal(size=3) * [1.0, 1.0, 0.3]
        place = np.array([0.0, 0.0, 0.5]) + way / np.linalg.norm(way) * rng.uniform(0.5, 0.9)
        unknown = Uncertainty(*rng.uniform(0.0, [0.01, 0.03, 0.05]))
        turn = rng.normal(size=4)
        pose = Pose(place, turn / np.linalg.norm(turn))
        motion = hdplan.SteadyMotion(rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.2, 0.2, 3)) if i % 2 else None
        obstacles.append(Obstacle(f"thing{i}", shape, pose, motion=motion, uncertainty=unknown))
    tracking = Tracking(rng.uniform(0.0, 0.004, len(home)), 0.01)
    sizes = {"tracking": tracking, "calibration": Calibration(*rng.uniform(0.0, 0.004, 2))}
    spec, timing = hdplan.RobotSpec(name=robot, **sizes, **more), hdplan.Timing(duration=1.0)
    scene = Scene(robot=spec, obstacles=obstacles, start=home, goal=home, timing=timing)
    rows = home + np.cumsum([np.zeros(len(home)), *rng.uniform(-0.06, 0.06, (4, len(home)))], axis=0)
    return scene, Trajectory(Setup.of(scene).robot.joint_names, rows, times=np.linspace(0.0, 1.0, 5))


HOMES: dict[str, tuple[list[float], dict[str, Any]]] = {
    "panda": ([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], {}),
    "ur5": ([0.5, -1.2, 1.5, -1.8, -1.57, 0.0], {"base": Pose([0.1, 0.0, 1.2], [0.8, 0.6, 0.0, 0.0])}),  # hangs
}


@pytest.mark.parametrize("robot", HOMES)
def test_no_world_within_the_sizes_is_closer_than_what_is_proven(robot: str) -> None:
    home, more = HOMES[robot]
    near, seed = 0, 0
    while near < 3:
        seed += 1
        scene, motion = random_scene(seed, robot, home, **more)
        setup = Setup.of(scene)
        proof = Certifier(setup).sweep.prove(motion.curve)
        if not proof.failures and proof.clearance[0] < 0.2:
            worlds = Worlds(setup.scene, setup.robot, motion).sampled(np.random.default_rng(seed), 4)
            found = np.array(list(worlds))
            assert (found.min(axis=0) >= np.array(proof.clearance) - LESS).all(), seed
            near += 1


@pytest.mark.parametrize("robot", HOMES)
def test_places_at_an_instant_are_those_of_an_interval_without_length(robot: str) -> None:
    """Places taken from a longer interval equal new ones, with unknown joints and things that drift."""
    home, more = HOMES[robot]
    scene, motion = random_scene(1, robot, home, **more)
    setup, rng = Setup.of(scene), np.random.default_rng(1)
    bodies, curve = Certifier(setup).sweep.bodies, unfolded_curve(setup.robot, curve_of(setup.robot, motion))
    rho, interval, start = bodies.reach(curve), rng.integers(0, 4, 20), rng.uniform(0.0, 0.5, 20)
    width = rng.uniform(0.0, 0.5, 20) * (np.arange(20) > 0)
    found = Intervals.of(bodies, curve, rho, interval, start, width).instants
    known = Intervals.of(bodies, curve, rho, interval, start + 0.5 * width, np.zeros(20))
    for each in ("start", "width", "delta", "deviation", "rotation", "origin", "center", "reach", "axes", "points"):
        np.testing.assert_allclose(getattr(found, each), getattr(known, each), atol=1e-14, err_msg=each)
    np.testing.assert_allclose(found.latest, known.latest, atol=1e-14)
    np.testing.assert_allclose(found.moved, known.moved, atol=1e-14)
    assert known.moved.any()
    for mine, other in zip(found.drift.parts, known.drift.parts, strict=True):
        np.testing.assert_array_equal(mine, other)


@pytest.mark.parametrize("robot", HOMES)
def test_an_unmeasured_clearance_is_proven_all_the_same(robot: str) -> None:
    """A motion keeps the required clearance whether or not its clearance is measured; the measured
    value is no more than the true one, and no less than required."""
    home, more = HOMES[robot]
    kept = refused = 0
    for seed in range(1, 9):
        scene, motion = random_scene(seed, robot, home, **more)
        sweep = Certifier(Setup.of(scene)).sweep
        known = sweep.prove(motion.curve)
        least = min(known.clearance) if not known.failures else 0.0
        for floor in (0.0, 0.5 * least, least - 2e-3, least + 2e-2):
            if floor < 0.0:
                continue
            found = sweep.prove(motion.curve, floor, measured=False)
            whole = sweep.prove(motion.curve, floor)
            failed = [{(each.interval, each.pair) for each in x.failures} for x in (found, whole)]
            assert failed[0] == failed[1], (seed, floor)
            assert found.whole
            kept, refused = kept + (not found.failures), refused + bool(found.failures)
            if not found.failures:
                closest = [spot.distance for spot in known.closest if spot is not None]
                assert floor <= min(found.clearance) <= min(closest) + LESS
                assert min(found.clearance) > 0.0
    assert kept > 2
    assert refused > 2


def test_a_shift_costs_exactly_its_size() -> None:
    """The proven bound is that of the scene at its nominal sizes, less the shift."""
    scene = load_scene("panda_cage")
    motion = hdplan.plan(scene).trajectory
    known = hdplan.certify(scene, motion)
    for shift in (1e-4, 0.001, 0.005):
        found = hdplan.certify(sized(scene, Uncertainty(shift)), motion)
        assert found.worst is not None
        assert known.worst is not None
        assert found.worst.unknown == pytest.approx(shift, rel=1e-9)
        assert found.worst.distance == pytest.approx(known.worst.distance - shift, abs=1e-9)
        assert found.clearance is not None
        assert found.clearance >= found.worst.distance - 5e-4 - 1e-9
        assert f"{1e3 * shift:.3g} mm for obstacles[].uncertainty.position" in found.notes[0]


def test_sizes_of_zero_change_nothing_to_the_byte() -> None:
    scene = load_scene("panda_cage")
    none = sized(scene, Uncertainty(0.0, 0.0, 0.0), tracking=Tracking([0.0] * 7), calibration=Calibration(0.0))
    assert none == scene
    one, other = hdplan.plan(scene), hdplan.plan(none)
    assert one.trajectory.positions.tobytes() == other.trajectory.positions.tobytes()
    first, second = (dataclasses.replace(x.certificate, seconds=0.0, prover=None) for x in (one, other))
    assert first == second


def test_larger_sizes_prove_no_more() -> None:
    scene, motion = random_scene(1, *("panda", HOMES["panda"][0]))
    rng = np.random.default_rng(0)
    for _ in range(4):
        last = np.array([np.inf, np.inf])
        base, joint, around = rng.uniform(0, 0.004, 2), rng.uniform(0, 0.004), rng.uniform(0, [0.01, 0.03, 0.05])
        for share in (0.0, 0.3, 1.0, 2.0):
            sizes = {"tracking": Tracking(share * joint), "calibration": Calibration(*(share * base))}
            setup = Setup.of(sized(scene, Uncertainty(*(share * around)), **sizes))
            proof = Certifier(setup).sweep.prove(motion.curve)
            found = np.array([spot.distance for spot in proof.closest if spot is not None])
            assert (np.array(proof.clearance) <= found).all()
            assert (found <= last).all()
            last = found


def test_turning_a_ball_about_its_centre_costs_no_clearance() -> None:
    ball = Obstacle("ball", Sphere(0.2), [0.6, 0.0, 0.2], uncertainty=Uncertainty(orientation=0.5))
    home = HOMES["panda"][0]
    scene = Scene(robot="panda", obstacles=[ball], start=home, goal=home)
    motion = Trajectory(Setup.of(scene).robot.joint_names, np.array([home, home]))
    known = hdplan.certify(sized(scene), motion)
    assert hdplan.certify(scene, motion).clearance == pytest.approx(known.clearance, abs=1e-9)


def test_uncertain_moving_obstacles_are_compared_with_static_links() -> None:
    """A person beside the base, which never moves, may walk into it; a table that is off may not."""
    home = HOMES["panda"][0]
    rows = {"start": home, "goal": home, "timing": hdplan.Timing(duration=2.0)}
    for unknown, status in ((Uncertainty(speed=0.4), Status.TOO_CLOSE), (Uncertainty(0.3), Status.CERTIFIED)):
        post = Obstacle("post", hdplan.Cylinder(0.05, 0.1), [-0.6, 0.0, 0.05], uncertainty=unknown)
        scene = Scene(robot="panda", obstacles=[post], **rows)
        motion = Trajectory(Setup.of(scene).robot.joint_names, np.array([home, home]), times=[0.0, 2.0])
        found = hdplan.certify(scene, motion)
        assert found.status is status, found.text
        if status is Status.TOO_CLOSE:
            assert "panda_link0" in {place.link for place in found.failures}
            assert "mm unknown" in found.text


def test_a_stretch_that_cannot_be_proven_ends_soon() -> None:
    """Halving would never end where the nominal scene is free and not all its worlds are."""
    scene = load_scene("panda_cage")
    motion = hdplan.plan(scene).trajectory
    found = hdplan.certify(sized(scene, tracking=Tracking(0.02)), motion)
    assert found.status is Status.TOO_CLOSE
    assert found.configurations < 5000
    rest = Trajectory(motion.joint_names, motion.positions[[0, 0]])
    assert hdplan.certify(sized(scene, tracking=Tracking(0.02)), rest, check_ends=False).configurations < 200


def test_joints_keep_their_limits_with_what_they_may_be_off() -> None:
    scene = load_scene("panda_person")
    setup, known = Setup.of(scene), Setup.of(sized(scene))
    np.testing.assert_allclose(known.robot.upper - setup.robot.upper, 0.002)
    np.testing.assert_allclose(setup.robot.lower - known.robot.lower, 0.002)
    np.testing.assert_allclose(known.limits["velocity"] - setup.limits["velocity"], 0.01)
    result = hdplan.plan(scene)
    curve = result.trajectory.curve
    assert (curve.derivative.largest() <= setup.limits["velocity"]).all()
    with pytest.raises(InputError, match=r"robot.tracking.velocity: 9 of joint 'panda_joint1' leaves nothing"):
        hdplan.plan(sized(scene, tracking=Tracking(velocity=9.0)))
    with pytest.raises(InputError, match=r"^[^:]*panda_person[^:]*: robot.tracking.position: 2 values, but panda"):
        hdplan.plan(sized(scene, tracking=Tracking([0.002, 0.002])))
    with pytest.raises(InputError, match=r"robot.tracking.position: 1 of joint 'a' leaves nothing") as error:
        _narrow(1.0)
    assert "\n" not in str(error.value)


def _narrow(off: float) -> None:
    from hdplan.planner.robot.scene_robot import _with_lag

    limits = {"lower": np.zeros(1), "upper": np.ones(1), "inner": np.zeros((2, 1))}
    robot = Setup.of(load_scene("empty")).robot
    _with_lag(dataclasses.replace(robot, joint_names=("a",), **limits), (off,))


def test_an_end_at_which_all_is_lost_is_refused_with_its_millimetres() -> None:
    scene = sized(load_scene("panda_cage"), Uncertainty(0.05))
    words = r"start: panda_\w+ and bar\d are [\d.]+ mm apart, and 50 mm are unknown"
    with pytest.raises(hdplan.UnsolvableError, match=words):
        hdplan.plan(scene)


@pytest.mark.parametrize("left", [0.3, 0.02, 0.002])
def test_a_robot_that_stands_is_proven_as_long_as_nobody_can_have_come(left: float) -> None:
    """A person may be near by then: the time is divided all the same where nothing moves."""
    q = [0.3, 0.2]
    ball = Obstacle("ball", Sphere(0.1), [1.6, 1.0, 0.1])
    alone = load_scene("planar_arm").with_start(q).with_goal(q).with_obstacles([ball])
    names, none = Setup.of(alone).robot.joint_names, np.zeros((3, 2))
    stands = Trajectory(names, np.tile(q, (3, 1)), {}, np.array([0.0, 1.0, 2.0]), none, none)
    apart = hdplan.certify(alone, stands).clearance
    assert apart is not None
    walks = dataclasses.replace(ball, uncertainty=Uncertainty(speed=(apart - left) / 2.0))
    found = hdplan.certify(alone.with_obstacles([walks]), stands)
    assert found.certified, found.text
    assert found.clearance is not None
    assert 0.0 < found.clearance <= left + 1e-9 + 0.05 * apart
