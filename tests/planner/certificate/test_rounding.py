"""Laws of what floating point can carry: what is allowed errs by less than is taken off, and no number is too wild."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import hdplan
from hdplan import InputError, Limits, Obstacle, Payload, Pose, Scene, SteadyMotion, TimedPoses, Trajectory, Upright
from hdplan.planner.certificate.certifier import Certifier, certify
from hdplan.planner.certificate.rounding import MOST_TERM, MOTION, PLACING, ROUNDING, TIME, refuse_large_motion
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.shapes import Box, Shape, Sphere

from ..urdf import joint_text, link_text, write_robot

Long = NDArray[np.longdouble]

UNIT_MASS = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
# a turntable that turns without end, and a slide that reaches far
SLIDE = (
    link_text("base", sphere=0.05),
    link_text("table"),
    link_text("tip", sphere=0.05, at="0.3 0 0", inertial=UNIT_MASS),
    joint_text("turn", "base", "table", kind="continuous", at="0.1 0.2 0.3"),
    joint_text(
        "slide", "table", "tip", kind="prismatic", at="0 0.1 0", rpy="0.3 0 0", limits=(-1e6, 1e6), velocity=1e6
    ),
)


@pytest.fixture
def slide(tmp_path: Path) -> Scene:
    robot = hdplan.RobotSpec(urdf=write_robot(tmp_path / "slide.urdf", *SLIDE))
    return Scene(robot=robot, start=[0.0, 0.0], goal=[0.0, 0.0])


def ball(place: tuple[float, float, float], **more: Any) -> Obstacle:
    shape: Shape = more.pop("shape", Sphere(0.05))
    return Obstacle("ball", shape, Pose(place), **more)


# --- the derivation ---------------------------------------------------------------------------------


def exactly(joints: Array, point: Array) -> Long:
    """The tip's point in extended precision, by hand."""
    turn, slid = np.longdouble(joints[0]), np.longdouble(joints[1])
    lean = np.longdouble("0.3")
    x, y, z = (np.longdouble(value) for value in point)
    z = z + slid
    y, z = np.cos(lean) * y - np.sin(lean) * z + np.longdouble("0.1"), np.sin(lean) * y + np.cos(lean) * z
    x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    return np.array([x + np.longdouble("0.1"), y + np.longdouble("0.2"), z + np.longdouble("0.3")])


def test_the_robot_is_placed_to_what_is_taken_off_wherever_it_is_not_refused(slide: Scene) -> None:
    rng, robot = np.random.default_rng(3), load_scene_robot(slide)
    bodies = Certifier(Setup.of(slide, robot)).sweep.bodies
    tip = [body.name for body in bodies.bodies].index("tip")
    outcomes = {True: 0, False: 0}
    for _ in range(300):
        size = 10.0 ** rng.uniform(0, 6, size=2)
        times, rows = np.array([0.0, 1.0]), rng.uniform(-1, 1, size=(2, 2)) * size
        rates = rng.uniform(-1, 1, size=(2, 2, 2)) * size
        curve = Curve.through(rows, times, *rates)
        try:
            refuse_large_motion(bodies, [body.name for body in bodies.bodies], curve, robot.joint_names)
        except InputError:
            outcomes[False] += 1
            continue
        outcomes[True] += 1
        start, width = np.array([rng.integers(0, 1 << 10) / 1024]), np.array([2.0**-11])
        middle, _, _ = curve.part(np.zeros(1, dtype=np.int64), start, width)
        turned, moved = bodies.chain.frames(robot.pin_q(middle))
        joint = bodies.joint[tip]
        found = turned[0, joint] @ (bodies.origin[tip] + bodies.center[tip]) + moved[0, joint]
        s = np.longdouble(start[0] + 0.5 * width[0])
        choose = [1, 5, 10, 10, 5, 1]
        weights = [choose[i] * s**i * (1 - s) ** (5 - i) for i in range(6)]
        true = exactly(
            sum(w * c.astype(np.longdouble) for w, c in zip(weights, curve.control[0], strict=True)),
            np.array([0.3, 0, 0]),
        )
        assert float(np.linalg.norm((found - true).astype(np.float64))) < ROUNDING
    assert min(outcomes.values()) > 50


def test_moving_obstacles_are_placed_to_what_is_taken_off() -> None:
    """They are, as late as S T allows, on a line and on a turn; a thousand times as late they are not."""
    rng = np.random.default_rng(4)
    worst, late = 0.0, 0.0
    for trial in range(200):
        velocity, spin = rng.normal(size=3), rng.normal(size=3) * (trial % 2)
        lever = rng.normal(size=3)
        speed = float(np.linalg.norm(velocity) + np.linalg.norm(spin) * np.linalg.norm(lever))
        motion = SteadyMotion(tuple(velocity.tolist()), tuple(spin.tolist()))
        carried = ObstacleMotion.of(Obstacle("x", Box((1, 1, 1)), motion=motion))
        latest = MOST_TERM / TIME / speed
        for time, kept in ((latest * rng.uniform(0.5, 1.0), True), (1000.0 * latest, False)):
            place = carried.at(np.array([time]))[0]
            found = place[:3, :3] @ lever + place[:3, 3]
            t, w = np.longdouble(time), spin.astype(np.longdouble)
            turned = lever.astype(np.longdouble)
            if (size := np.sqrt((w * w).sum())) > 0:
                axis, angle = w / size, size * t
                along = axis * (axis @ turned)
                turned = along + (turned - along) * np.cos(angle) + np.cross(axis, turned) * np.sin(angle)
            error = float(np.abs((found - (turned + t * velocity.astype(np.longdouble))).astype(np.float64)).max())
            worst, late = (max(worst, error), late) if kept else (worst, max(late, error))
    assert worst < ROUNDING < late


def test_the_bounds_are_where_they_are_stated(slide: Scene) -> None:
    """A motion just within them is checked; just beyond, the error names the field, the value and what is allowed."""
    far = MOST_TERM / PLACING
    still = Trajectory(("turn", "slide"), np.zeros((2, 2)))
    for share, kept in ((0.99, True), (1.01, False)):
        scene = replace(slide, obstacles=(ball((share * far - 0.05, 0, 0)),))
        if kept:
            assert certify(scene, still).certified
        else:
            with pytest.raises(InputError, match=r"obstacles\.ball: up to .* at most 3.52e\+04 m are allowed"):
                certify(scene, still)
        latest = MOST_TERM / TIME / 2.0
        mover = ball((0.0, 0.0, 5.0), motion=SteadyMotion((0.0, 0.0, 2.0)))
        scene = replace(slide, obstacles=(mover,))
        timed = replace(still, times=np.array([0.0, share * latest]))
        if not kept:
            words = r"times: .* obstacles\.ball moves at up to 2 m/s, .* at most 7.04e\+04 s"
            with pytest.raises(InputError, match=words):
                certify(scene, timed)
    assert MOTION > 0


# --- wild numbers -----------------------------------------------------------------------------------

REST = np.zeros((2, 2))


def motion(**changed: Any) -> Trajectory:
    rest = {"times": np.array([0.0, 1.0]), "velocities": REST, "accelerations": REST}
    return Trajectory(("turn", "slide"), **{"positions": np.array([[0.0, 0.0], [0.5, 0.1]]), **rest, **changed})


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"velocities": REST + 1e308}, "velocities: waypoint 0, joint 'turn': 1e+308"),
        ({"velocities": REST - 1e7}, "at most 1e+06 is allowed"),
        ({"accelerations": REST + 1e300}, "accelerations: waypoint 0"),
        ({"velocities": REST + 1e308, "times": np.array([0.0, 1e10])}, "in 1e+10 s; at most 0.0001"),
        ({"times": np.array([0.0, 1e308])}, "times: 1e+308 s is too far from 0; at most 1e+60 s"),
        ({"times": np.array([-1e308, 1e308])}, "too far from 0"),
        ({"times": np.array([0.0, 5e-324])}, "too short; at least 1e-60 s"),
        ({"times": np.array([0.0, 1e-100]), "velocities": None, "accelerations": None}, "too short"),
    ],
)
def test_numbers_that_would_overflow_are_refused_at_the_door(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as error:
        motion(**changed)
    assert words in str(error.value)


WILD_MOTIONS: dict[str, dict[str, Any]] = {
    "far": {"positions": np.array([[0.0, 0.0], [1e308, 0.0]])},
    "turned often": {"positions": np.array([[0.0, 0.0], [9e5, 0.0]])},
    "slid far": {"positions": np.array([[0.0, 0.0], [0.0, 9e5]])},
    "late": {"times": np.array([1e15, 1e15 + 1])},
    "long": {"times": np.array([0.0, 1e30])},
    "at once": {"times": np.array([0.0, 1e-59])},
    "gaps of one digit": {"times": np.array([1e15, np.nextafter(1e15, np.inf)])},
    "denormal": {"positions": np.array([[0.0, 0.0], [5e-324, 5e-324]]), "velocities": REST + 5e-324},
    "jerky": {"times": np.array([0.0, 1e-3]), "accelerations": REST + 9e11},
}
UNCERTIFIABLE = {"far", "turned often", "slid far", "at once", "gaps of one digit", "jerky"}
WILD_OBSTACLES: dict[str, Callable[[], Obstacle]] = {
    "standing": lambda: ball((1.0, 1.0, 1.0)),
    "far": lambda: ball((1e12, 0.0, 0.0)),
    "away": lambda: ball((9e5, 0.0, 0.0)),
    "hurled": lambda: ball((1.0, 1.0, 1.0), motion=SteadyMotion((9e5, 0.0, 0.0))),
    "fast": lambda: ball((1.0, 1.0, 1.0), motion=SteadyMotion((1e300, 0.0, 0.0))),
    "spinning": lambda: ball((1, 1, 1), motion=SteadyMotion((0, 0, 0), (0, 1e300, 0)), shape=Box((1, 0.1, 0.1))),
    "turning": lambda: ball((1, 1, 1), motion=SteadyMotion((0, 0, 0), (0, 0, 20.0)), shape=Box((1, 0.1, 0.1))),
    "thrown": lambda: ball((1.0, 1.0, 1.0), motion=TimedPoses((0.0, 1e-300), (Pose((1, 1, 1)), Pose((2, 1, 1))))),
    "flickering": lambda: ball((1.0, 1.0, 1.0), motion=TimedPoses((0.0, 5e-324), (Pose((1, 1, 1)), Pose((2, 1, 1))))),
    "waiting": lambda: ball((1.0, 1.0, 1.0), motion=TimedPoses((1e300, 2e300), (Pose((1, 1, 1)), Pose((2, 1, 1))))),
}


@pytest.mark.sampled(7)
@pytest.mark.parametrize("thing", WILD_OBSTACLES)
@pytest.mark.parametrize("wild", [*WILD_MOTIONS, "tame"])
def test_wild_numbers_are_refused_or_judged_and_never_overflow(wild: str, thing: str, slide: Scene) -> None:
    """Limits of all kinds and a path constraint hold: an InputError, or a verdict whose numbers are numbers."""
    limits = Limits(velocity=1.0, acceleration=10.0, jerk=100.0, torque=100.0)
    path = hdplan.PathConstraints(upright=Upright("tip", tolerance=0.5))
    scene = replace(slide, limits=limits, payload=Payload("tip", 1.0), path=path)
    refused = ""
    try:
        scene = replace(scene, obstacles=(WILD_OBSTACLES[thing](),))
        found = certify(scene, motion(**WILD_MOTIONS.get(wild, {})), check_ends=False)
    except InputError as error:
        refused = str(error)
    if refused:
        assert wild in UNCERTIFIABLE or thing != "standing", refused
        assert "\n" not in refused
        assert "nan" not in refused
        return
    assert thing in ("standing", "turning", "waiting") or (wild, thing) == ("at once", "hurled"), found.text
    for value in (found.clearance, *(use.share for use in found.uses), *(kept.worst for kept in found.path)):
        assert value is None or not np.isnan(value)
    assert not (found.certified and wild in UNCERTIFIABLE)


def test_a_stretch_of_time_changes_no_verdict_about_places(slide: Scene) -> None:
    scene = replace(slide, obstacles=(ball((0.22, 0.56, 0.36)),))
    for end, free in ((0.2, True), (2.0, False)):
        statuses = set()
        for exponent in (-50, -9, 0, 9, 50):
            stretch = 10.0**exponent
            rates = np.array([[0.1, 0.0], [0.0, 0.05]]) / stretch
            timed = {"times": np.array([0.0, stretch]), "velocities": rates}
            found = certify(scene, motion(positions=np.array([[0, 0], [end, 0.1]]), **timed), check_ends=False)
            assert found.certified is free, found.text
            statuses.add((found.status, found.clearance))
        assert len(statuses) <= 2  # but for the last digit
