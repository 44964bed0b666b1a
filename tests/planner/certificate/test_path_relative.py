"""Laws of the proof that a link keeps its pose relative to another: never optimistic, close to the truth, blind to what
moves both."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from hdplan import InputError, PathConstraints, Relative, Robot, RobotSpec, Scene, Trajectory, load_robot
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.poses import Pose

from ..urdf import joint_text, link_text, write_robot
from .test_path_check import is_broken, proof_of

LOOKS = 1500
FIELDS = ("path.relative.position_tolerance", "path.relative.orientation_tolerance")


def _joint(name: str, parent: str, child: str, axis: str, at: str, **more: Any) -> str:
    return joint_text(name, parent, child, axis, at=at, limits=(-2, 2), **more)


def _arm(side: str, way: int) -> str:
    one, two, three, four = (f"{side}{k}" for k in (1, 2, 3, 4))
    return "".join((
        *map(link_text, (one, two, three, four, side)),
        _joint(f"{side}_yaw", "trunk", one, "0 0 1", f"0 {0.3 * way} 0.4", rpy="0.1 0 0"),
        _joint(f"{side}_lift", one, two, "0 1 0.1", "0.1 0 0.1"),
        _joint(f"{side}_slide", two, three, "1 0 0.2", "0.3 0 0", rpy="0 0.2 0", kind="prismatic"),
        _joint(f"{side}_roll", three, four, "1 0.3 0", "0.2 0 0", kind="continuous"),
        joint_text(f"{side}_tool", four, side, at="0.1 0 0.05", rpy="0.3 0 1", kind="fixed"),
    ))  # fmt: skip


TWO_ARMS = (
    *map(link_text, ("base", "mast", "trunk")),
    _joint("turn", "base", "mast", "0 0.2 1", "0.1 0 0.2"),
    _joint("rise", "mast", "trunk", "0 0 1", "0 0 0.1", kind="prismatic"),
    _arm("left", 1),
    _arm("right", -1),
)
LINKS = {"two_arms": ("right", "left"), "panda": ("panda_hand", "panda_link3"), "ur5": ("tool0", "base_link")}
TURNED = Pose((0.3, -0.2, 0.4), (0.3, -0.2, 0.1, math.sqrt(0.86)))


def spec_of(name: str, folder: Path, base: Pose = Pose()) -> RobotSpec:
    if name in LINKS and name != "two_arms":
        return RobotSpec(name=name, base=base)
    return RobotSpec(urdf=write_robot(folder / "two_arms.urdf", *TWO_ARMS), base=base)


def scene_of(spec: RobotSpec, constraint: Relative, start: Array) -> Scene:
    return Scene("test", Path("test.yaml"), spec, (), start, start, path=PathConstraints(relative=constraint))


def place(robot: Robot, link: str, q: Array) -> pin.SE3:
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
    return data.oMf[robot.model.getFrameId(link)].copy()


def sampled(robot: Robot, constraint: Relative, held: pin.SE3, q: Array) -> tuple[Array, Array]:
    """Distance and angle at configurations (k, n), in the other link's frame and by the logarithm."""
    found = []
    for row in q:
        pose = place(robot, constraint.to, row).actInv(place(robot, constraint.link, row))
        turn = float(np.linalg.norm(pin.log3(held.rotation.T @ pose.rotation)))
        found.append((float(np.linalg.norm(pose.translation - held.translation)), turn))
    return np.array(found)[:, 0], np.array(found)[:, 1]


def pose_of(placement: pin.SE3) -> Pose:
    return Pose(tuple(placement.translation), tuple(pin.Quaternion(placement.rotation).coeffs()))


def random_curve(rng: np.random.Generator, robot: Robot, kind: int) -> Curve:
    """Small and large steps, straight, cubic or quintic between the rows."""
    low, high = np.clip(robot.lower, -3, 3), np.clip(robot.upper, -3, 3)
    rows = int(rng.integers(2, 7))
    steps = rng.normal(size=(rows, robot.n)).cumsum(axis=0) * [0.01, 0.1, 0.6][kind % 3]
    at = rng.uniform(low, high) + steps if kind < 6 else rng.uniform(low, high, size=(rows, robot.n))
    times, (speeds, rates) = np.cumsum(rng.uniform(0.1, 1.0, rows)), rng.normal(size=(2, rows, robot.n)) * 0.1
    which = kind % 3 if kind < 3 else int(rng.integers(3))
    return Curve.through(at, *((), (times, speeds), (times, speeds, 3 * rates))[which])


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", LINKS)
@pytest.mark.parametrize("turned", [False, True])
def test_dense_samples_never_find_more_than_is_proven(name: str, turned: bool, tmp_path: Path) -> None:
    link, to = LINKS[name]
    link, to = (to, link) if turned else (link, to)
    spec = spec_of(name, tmp_path, TURNED if turned else Pose())
    robot, rng = load_robot(spec), np.random.default_rng([len(name), turned])
    seen: set[tuple[str, bool]] = set()
    for kind in range(8):
        curve = random_curve(rng, robot, kind)
        interval = rng.integers(0, len(curve) - 1, LOOKS)
        q = curve.at(interval, rng.uniform(size=LOOKS))
        held = place(robot, to, curve.rows[0]).actInv(place(robot, link, curve.rows[0]))
        if kind % 2:
            held = held * pin.SE3(pin.exp3(rng.normal(size=3) * 0.3), rng.normal(size=3) * 0.1)
        constraint = Relative(link, to, pose_of(held))
        values = dict(zip(FIELDS, sampled(robot, constraint, held, q), strict=True))
        # a tolerance that the motion breaks, grazes or keeps
        factor = [0.7, 1.0001, 1.1][(kind + kind // 3) % 3]
        most = (values[each].max() * factor for each in FIELDS)
        allowed = np.clip([*most], 1e-3, (1.0, math.pi)).tolist()
        constraint = dataclasses.replace(constraint, position_tolerance=allowed[0], orientation_tolerance=allowed[1])
        proof = proof_of(robot, scene_of(spec, constraint, curve.rows[0]), curve)
        assert tuple(kept.field for kept in proof.kept) == FIELDS
        for kept in proof.kept:
            seen.add((kept.field, is_broken(proof, kept, values[kept.field], interval, kept.allowed)))
        for departure in proof.departures:
            at = curve.at(np.array([departure.interval]), np.array([departure.fraction]))
            met = dict(zip(FIELDS, sampled(robot, constraint, held, at), strict=True))[departure.field][0]
            assert met == pytest.approx(departure.found, abs=1e-7)
    assert seen == set(itertools.product(FIELDS, (False, True)))


def test_a_common_motion_of_both_links_changes_nothing(tmp_path: Path) -> None:
    spec = spec_of("two_arms", tmp_path)
    robot, rng = load_robot(spec), np.random.default_rng(3)
    start, moved = robot.draw(rng, 2)
    moved[2:] = start[2:]  # turn and rise alone
    proof = proof_of(robot, scene_of(spec, Relative("left", "right"), start), Curve.through(np.array([start, moved])))
    assert [kept.worst for kept in proof.kept] == pytest.approx([0.0, 0.0], abs=3e-9)
    assert proof.configurations == 2
    for either in (Relative("left", "right"), Relative("right", "left")):
        moved[3] = start[3] + 0.5
        proof = proof_of(robot, scene_of(spec, either, start), Curve.through(np.array([start, moved])))
        assert proof.kept[1].worst == pytest.approx(0.5, abs=0.01)  # turned by that, whoever looks


def test_a_departure_between_two_good_rows_is_found_and_named(tmp_path: Path) -> None:
    spec = spec_of("two_arms", tmp_path)
    robot = load_robot(spec)
    start = np.zeros(robot.n)
    turned = start.copy()
    turned[robot.joint_names.index("left_roll")] = 2 * math.pi
    proof = proof_of(robot, scene_of(spec, Relative("left", "right"), start), Curve.through(np.array([start, turned])))
    assert [d.field for d in proof.departures if d.violated] == list(FIELDS)
    away, aside = proof.departures
    assert aside.found > 3.0
    assert aside.words.startswith(f"{FIELDS[1]}: left is turned by 3.14 rad against right, 0.05 are allowed")
    found = f"left is {away.found * 1e3:.3g} mm away from its place at right"
    assert away.words == f"{FIELDS[0]}: {found}, 5 mm are allowed"


def test_the_certificate_says_what_is_kept_or_where_it_is_not(tmp_path: Path) -> None:
    spec = spec_of("two_arms", tmp_path)
    robot = load_robot(spec)
    start = np.zeros(robot.n)
    moved, off = start.copy(), start.copy()
    moved[:2] = 0.4
    off[3] = 0.3
    certifier = Certifier(Setup.of(scene_of(spec, Relative("left", "right"), start), robot))
    assert not certifier.off_path(moved)
    assert len(certifier.off_path(off)) == 2
    good = certifier.certify(Trajectory(robot.joint_names, np.array([start, moved])), check_ends=False)
    assert good.status is Status.CERTIFIED
    assert "of 5 mm of its place at right, left turned within " in good.text
    bad = certifier.certify(Trajectory(robot.joint_names, np.array([start, off, start])), check_ends=False)
    assert bad.status is Status.OFF_PATH
    assert bad.text.startswith("off path: path.relative.")


@pytest.mark.parametrize(
    ("constraint", "message"),
    [
        (Relative("lft", "right"), r"path\.relative\.link: unknown link 'lft' \(did you mean 'left'\?\)"),
        (Relative("left", "rihgt"), r"path\.relative\.to: unknown link 'rihgt' \(did you mean 'right'\?\)"),
        (Relative("left", "left4"), r"path\.relative: 'left' and 'left4' do not move relative to each other"),
    ],
)
def test_links_that_cannot_be_meant_are_refused_by_name(constraint: Relative, message: str, tmp_path: Path) -> None:
    spec = spec_of("two_arms", tmp_path)
    robot = load_robot(spec)
    with pytest.raises(InputError, match=rf"test\.yaml: {message}"):
        Certifier(Setup.of(scene_of(spec, constraint, np.zeros(robot.n)), robot))
