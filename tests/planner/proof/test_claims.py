"""Claims of a proof beside clearances: torques, path constraints and goals that are poses, by the checker alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pinocchio as pin
import pytest

import hdplan
from hdplan import Box, Cylinder, Ellipsoid, PathConstraints, Pose, Relative, Sphere, Upright, Within
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.path_bounds import held_by
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.robot.setup import Setup
from hdplan.verify import RejectedError, effects
from hdplan.verify.balls import HERE
from hdplan.verify.effects import bonds_of_path, check_path, check_torques, chord, reached
from hdplan.verify.kernel import Motion
from hdplan.verify.reading import read_world
from hdplan.verify.world import Bond, World

from .worlds import read as read_files, rejects_unless

HELD = [Box([0.1, 0.05, 0.2]), Sphere(0.06), Ellipsoid([0.05, 0.1, 0.07]), Cylinder(0.04, 0.2)]
ROBOTS = [  # a robot, a link of it, and how its base stands
    ("panda", "panda_hand", Pose()),
    ("ur5", "tool0", Pose.from_rpy([0.1, 0.2, 1.5], [np.pi, 0.3, 0.2])),
    ("xarm7", "link7", Pose.from_rpy([0, 0, 0.5], [0.4, -0.7, 0.1])),
    ("tiago", "arm_7_link", Pose()),  # its torso slides
]


def swinging(folder: Path, arm: tuple[str, str, Pose], rng: np.random.Generator, **more: object) -> Path:
    """A scene and a motion of quintics that begins and ends at rest: `folder`/scene.yaml and motion.json."""
    robot, link, base = arm
    shape = HELD[rng.integers(len(HELD))]
    held = hdplan.Attached("tool", link, shape, Pose.from_rpy([0.02, -0.03, 0.2], [0.2, 0.4, 0.6]), mass=2.0)
    load = hdplan.Payload(link, 1.5, [0.05, 0.02, 0.1], [0.01, 0.001, 0.002, 0.02, -0.001, 0.015])
    spec = hdplan.RobotSpec(name=robot, base=base)
    loaded = hdplan.load_robot(spec)
    low, high = np.maximum(loaded.lower, -2.0), np.minimum(loaded.upper, 2.0)
    rows = low + (high - low) * rng.uniform(0.3, 0.7, (5, loaded.n))
    times = np.cumsum([0.0, 0.5, 0.6, 0.4, 0.7])
    rates = 0.3 * (high - low) * rng.uniform(-1, 1, (2, 5, loaded.n))
    rates[:, [0, -1]] = 0.0
    motion = hdplan.Trajectory(loaded.joint_names, rows, loaded.locked, times, *rates)
    scene = hdplan.Scene(
        robot=spec, start=rows[0], goal=rows[-1], attached=[held], payload=load,
        limits=hdplan.Limits(torque=1000.0), timing=hdplan.Timing(duration=2.2), **more,
    )  # fmt: skip
    scene.save(folder / "scene.yaml")
    motion.save(folder / "motion.json")
    return folder


def read(folder: Path) -> tuple[Setup, World, hdplan.Trajectory]:
    scene, motion = folder / "scene.yaml", folder / "motion.json"
    setup = Setup.of(hdplan.load_scene(scene))
    return setup, read_files(scene, motion), hdplan.Trajectory.load(motion)


def bonds_of(world: World) -> list[Bond]:
    """Proof that the path constraints of a world are kept."""
    return bonds_of_path(world, world.path, lambda: True)


def bounds(world: World, spans: np.ndarray) -> np.ndarray:
    """The checker's bounds of the torques on parts of a motion."""
    found = []
    original = effects.everywhere
    effects.everywhere = lambda name, of, count, beyond: found.append(beyond)  # type: ignore[assignment]
    torques = effects.torques
    kept: list[np.ndarray] = []
    try:
        check_torques(world)
        effects.torques = lambda *args: kept.append(torques(*args)) or kept[-1]
        found[0](spans)
    finally:
        effects.everywhere, effects.torques = original, torques
    return kept[0]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("robot", ROBOTS, ids=[name for name, *_ in ROBOTS])
def test_torques_of_pinocchio_are_within_the_bounds_which_are_tight(robot: tuple, tmp_path: Path) -> None:
    rng = np.random.default_rng(len(robot[0]))
    setup, world, motion = read(swinging(tmp_path, robot, rng))
    curve, model = curve_of(setup.robot, motion), setup.loaded_model
    data = model.createData()
    order = [setup.robot.joint_names.index(x.name) for x in world.joints]
    slack = []
    for width in (1.0, 2.0**-4, 2.0**-8):
        begin = rng.integers(0, 4, 60) + width * rng.integers(0, round(1 / width), 60)
        found = bounds(world, np.stack([begin, begin + width], axis=1))
        largest = np.zeros_like(found)
        for share in np.linspace(0.0, 1.0, 9):
            at = np.minimum(begin + share * width, 4 - 1e-12)
            row = at.astype(int)
            q, v, a = (curve.over_time(i).at(row, at - row) for i in range(3))
            torque = [pin.rnea(model, data, *x) for x in zip(setup.robot.pin_q(q), v, a, strict=True)]
            largest = np.maximum(largest, np.abs(np.array(torque))[:, order])
        assert (largest <= found * (1 + 1e-9)).all()
        slack.append(float(np.median(found - largest)))
    assert slack[1] < slack[0] / 30  # quadratic in the width of a part, but for where the nine samples are
    assert slack[2] < slack[1] / 10


@pytest.mark.core
def test_a_torque_limit_just_below_the_peak_is_rejected_and_one_just_above_accepted(tmp_path: Path) -> None:
    _, world, _ = read(swinging(tmp_path, ROBOTS[0], np.random.default_rng(5)))
    spans = np.arange(0, 4, 2.0**-9)
    peak = bounds(world, np.stack([spans, spans + 2.0**-9], axis=1)).max(axis=0)
    names = [x.name for x in world.joints]
    for joint in (1, 5):
        for share, good in ((1.01, True), (0.99, False)):
            world.limits["torque"] = [float(x) * (share if i == joint else 1.01) for i, x in enumerate(peak)]
            with rejects_unless(good, f"limits.torque: joint '{names[joint]}' is beyond"):
                check_torques(world)


def test_a_motion_that_begins_at_speed_has_no_torques(tmp_path: Path) -> None:
    folder = swinging(tmp_path, ROBOTS[0], np.random.default_rng(6))
    motion = hdplan.Trajectory.load(folder / "motion.json")
    rates = motion.velocities.copy()
    rates[0, 3] = 1e-3
    dataclasses.replace(motion, velocities=rates).save(folder / "motion.json")
    with pytest.raises(RejectedError, match="begins or ends with a jump"):
        check_torques(read(folder)[1])


def test_a_mass_whose_inertia_is_not_known_is_not_left_out(tmp_path: Path) -> None:
    folder = swinging(tmp_path, ROBOTS[0], np.random.default_rng(7))
    _, world, _ = read(folder)
    world.loads[3]["inertia"][2] = float("nan")
    with pytest.raises(RejectedError, match=r"loads\[3\]\.inertia: .* finite numbers"):
        check_torques(world)
    scene = hdplan.load_scene(folder / "scene.yaml")
    held = dataclasses.replace(scene.attached[0], shape=hdplan.Capsule(0.05, 0.1))
    dataclasses.replace(scene, attached=[held]).save(folder / "scene.yaml")
    with pytest.raises(RejectedError, match="inertia of a capsule cannot be checked"):
        read_world(folder / "scene.yaml", folder / "motion.json")


BOX = Within("panda_hand", [0.3, np.inf, 0.4], Pose.from_rpy([0.3, 0, 0.6], [0.2, 0, 0.6]), [0, 0.1, 0.1])
PLACE = Pose.from_rpy([0.1, 0, 0.4], [1.1, 0, 0.2])
CONSTRAINTS = {
    "upright": PathConstraints(upright=Upright("panda_hand", [0.3, -0.2, -0.9], 0.5)),
    "position": PathConstraints(position=BOX),
    "relative": PathConstraints(relative=Relative("panda_hand", "panda_link3", None, 0.3, 0.9)),
    "relative to a pose": PathConstraints(relative=Relative("panda_link2", "panda_link7", PLACE, 0.3, 0.9)),
}


@pytest.mark.parametrize("kind", CONSTRAINTS)
def test_bounds_of_path_constraints_hold_what_the_certificate_finds_and_are_tight(kind: str, tmp_path: Path) -> None:
    setup, world, motion = read(swinging(tmp_path, ROBOTS[0], np.random.default_rng(8), path=CONSTRAINTS[kind]))
    curve, chain = curve_of(setup.robot, motion), Certifier(setup).path.chain
    bonds = bonds_of(world)
    rng = np.random.default_rng(9)
    slack = []
    for width in (2.0**-2, 2.0**-6, 2.0**-10):
        begin = rng.integers(0, 4, 80) + width * rng.integers(0, round(1 / width), 80)
        # a share of what is allowed, the largest of all bonds of the constraint; as chords where it is an angle
        part = Motion(world, np.stack([begin, begin + width], axis=1))
        found = np.stack([part.apart(x) / x.most for x in bonds]).max(axis=0)
        largest = np.zeros(80)
        for share in np.linspace(0, 1, 9):
            at = np.minimum(begin + share * width, 4 - 1e-12)
            row = at.astype(int)
            frames = chain.frames(setup.robot.pin_q(curve.at(row, at - row)))
            shares = []
            for held in held_by(setup):
                value = held.found(*frames)
                if "box" in held.kept(0.0):  # how far beyond it: not a share
                    continue
                angle = "rad" in held.kept(0.0)
                shares.append(np.sin(value / 2) / np.sin(held.allowed / 2) if angle else value / held.allowed)
            if shares:
                largest = np.maximum(largest, np.max(shares, axis=0))
        assert (largest <= found * (1 + 1e-8)).all()
        slack.append(float(np.median(found - largest)))
    if kind != "position":
        assert slack[2] < slack[1] / 30 < slack[0] / 300


@pytest.mark.parametrize("kind", CONSTRAINTS)
def test_a_path_constraint_violated_only_between_rows_is_rejected(kind: str, tmp_path: Path) -> None:
    _, world, _ = read(swinging(tmp_path, ROBOTS[0], np.random.default_rng(8), path=CONSTRAINTS[kind]))
    bonds = bonds_of(world)
    spans = np.arange(0, 4, 2.0**-7)
    fine = [Motion(world, np.stack([spans, spans + 2.0**-7], axis=1)).apart(x) for x in bonds]
    for bond, values in zip(bonds, fine, strict=True):
        bond.most = float(values.max()) * 1.02
        assert spans[values.argmax()] % 1  # the worst is between rows
    original = effects.bonds_of_path
    try:
        effects.bonds_of_path = lambda *_: bonds
        check_path(world, [], lambda: True)
        for i, values in enumerate(fine):
            bonds[i].most = float(values.max()) * 0.97
            with pytest.raises(RejectedError, match="after row"):
                check_path(world, [], lambda: True)
            bonds[i].most = float(values.max()) * 1.02
    finally:
        effects.bonds_of_path = original


@pytest.mark.parametrize("angle", [1e-6, 0.01, 1.0, 2.9, 3.05, 3.14])
def test_an_angle_just_beyond_what_is_allowed_is_longer_than_its_chord(angle: float) -> None:
    allowed = chord(angle)
    assert 2 * np.sin(angle / 2) * (1 - 1e-12) <= allowed < 2 * np.sin((angle + 2e-9) / 2)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("free", ["none", "x", "z", "all"])
def test_goal_poses_are_met_within_their_tolerances_and_no_more(free: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(10)
    setup, world, motion = read(swinging(tmp_path, ROBOTS[0], rng))
    model, data = setup.robot.model, setup.robot.model.createData()
    pin.framesForwardKinematics(model, data, setup.robot.pin_q(motion.positions[-1]))
    hand = data.oMf[model.getFrameId("panda_hand")]

    def goal(off: float, angle: float) -> dict:
        """The hand's pose at the end, moved by `off` [m] and turned by `angle` [rad]."""
        axis = rng.normal(size=3)
        if free in ("x", "z"):  # about an axis across the free one, and by any angle about that
            axis["xyz".index(free)] = 0.0
        axis /= np.linalg.norm(axis)
        turned = hand.rotation @ pin.exp3(angle * axis)
        if free in ("x", "z"):
            turned = turned @ pin.exp3(rng.uniform(-3, 3) * np.eye(3)["xyz".index(free)])
        away = rng.normal(size=3)
        place = hand.translation + off * away / np.linalg.norm(away)
        return {
            "link": "panda_hand", "position": place.tolist(), "rotation": turned.ravel().tolist(), "off": 1e-14,
            "position_tolerance": 2e-3, "orientation_tolerance": 0.3, "free": free,
        }  # fmt: skip

    def met(*targets: list[dict]) -> bool:
        world.goal = [{"poses": each} for each in targets]
        return reached(world, "goal")

    for _ in range(20):
        inside = goal(2e-3 * (1 - 1e-6), 0.3 * (1 - 1e-6))
        too_far, too_turned = goal(2e-3 * (1 + 1e-5), 0.0), goal(0.0, 0.3 * (1 + 1e-5))
        assert met([inside])
        assert not met([too_far])
        assert met([too_turned]) == (free == "all")
        assert met([too_far], [inside])
        assert not met([too_far, inside])
        assert met([inside, inside])


@pytest.mark.parametrize(("size", "good"), [(1.0, True), (1 - 1e-9, False), (0.6, False), (1.1, False)])
def test_an_upright_axis_is_a_unit_vector(size: float, good: bool) -> None:
    """One of length 0.3 that is turned by 1.28 rad is nearer to the vertical than a unit vector turned by 1 rad."""
    world = cast(World, SimpleNamespace(links={"a": (-1, HERE)}, pieces=[]))
    path = [{"kind": "upright", "link": "a", "axis": [0, 0, size], "off": 0.0, "tolerance": 1.0}]
    with rejects_unless(good, "its axis must be a unit vector"):
        assert len(bonds_of_path(world, path, lambda: True)) == 1


def test_an_object_held_without_a_mass_is_named_where_torques_are_limited(tmp_path: Path) -> None:
    home = [0.5, -1.2, 1.5, -1.8, -1.57, 0.0]
    for mass, torque, named in ((None, "urdf", True), (0.5, "urdf", False), (None, None, False)):
        held = [hdplan.Attached("box", "wrist_3_link", Box([0.02] * 3), [0.0, 0.0, 0.1], mass=mass)]
        limits = hdplan.Limits(acceleration=2.0, torque=torque)
        scene = hdplan.Scene(robot="ur5", start=home, goal=[0.6, *home[1:]], attached=held, limits=limits)
        result = hdplan.plan(scene)
        scene.save(tmp_path / "s.yaml")
        result.save(tmp_path / "m.json")
        words = "torques do not include a mass of box, as none is given"
        assert (words in result.certificate.notes) == named
        assert (words in hdplan.prove(tmp_path / "s.yaml", tmp_path / "m.json").text) == named
