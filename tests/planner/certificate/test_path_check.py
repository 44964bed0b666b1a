"""Laws of the proof of path constraints: never optimistic, close to the truth, blind to how the world is turned."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from hdplan import PathConstraints, Pose, Robot, RobotSpec, Scene, Trajectory, Upright, Within, load_robot, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.path_check import TOLERANCE_SLACK, Kept, PathCheck, PathProof
from hdplan.planner.certificate.verdict import Certificate, Status, at_most
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows

from ..urdf import joint_text, link_text, write_robot

LOOKS = 2000
CRANE = (
    *map(link_text, ("base", "mast", "boom", "trolley", "hook")),
    joint_text("slew", "base", "mast", kind="continuous", at="0.1 0 0.2", rpy="0.1 0.2 0"),
    joint_text("luff", "mast", "boom", "0 1 0.2", at="0 0.1 0.5", limits=(-2, 2)),
    joint_text("run", "boom", "trolley", "1 0 0.1", kind="prismatic", at="0 0 0.1", rpy="0.2 0 0.4", limits=(-0.5, 1)),
    joint_text("swing", "trolley", "hook", "1 1 0", at="0 0 -0.3", rpy="0 0.5 0", limits=(-2, 2)),
)
PLANAR = (
    *map(link_text, ("base", "upper", "fore")),
    joint_text("shoulder", "base", "upper", "0 1 0", limits=(-9, 9)),
    joint_text("elbow", "upper", "fore", "0 1 0", at="0 0 0.5", limits=(-9, 9)),
)
UPSIDE_DOWN = Pose((0.1, -0.2, 1.5), (1.0, 0.0, 0.0, 0.0))
TILTED = Pose((0.0, 0.3, 0.2), (0.3, -0.2, 0.1, math.sqrt(0.86)))
ROBOTS = {"panda": "panda_hand", "ur5": "tool0", "crane": "hook"}


def spec_of(name: str, folder: Path, base: Pose) -> RobotSpec:
    if name in ("crane", "planar"):
        urdf = write_robot(folder / f"{name}.urdf", *(CRANE if name == "crane" else PLANAR))
        return RobotSpec(urdf=urdf, base=base)
    return RobotSpec(name=name, base=base)


def scene_of(spec: RobotSpec, *constraints: Upright | Within) -> Scene:
    given = {"upright" if isinstance(each, Upright) else "position": each for each in constraints}
    return Scene(robot=spec, start="default", goal="default", path=PathConstraints(**given))


def proof_of(robot: Robot, scene: Scene, curve: Curve) -> PathProof:
    return PathCheck(Setup(scene, robot), Chain.of(robot.model)).prove(curve)


def is_broken(proof: PathProof, kept: Kept, values: Array, interval: Rows, scale: float) -> bool:
    """True if a constraint is refuted; its bound is neither below its values (k,) at places in intervals (k,), nor far
    above the truth, and where they are not allowed, it is not proven."""
    assert values.max() <= kept.worst
    assert kept.met <= kept.worst
    unproven = {d.interval for d in proof.departures if d.field == kept.field}
    assert set(interval[values > kept.allowed].tolist()) <= unproven
    assert bool(unproven) or kept.worst <= kept.allowed + 2e-9
    assert kept.worst - max(kept.met, values.max()) <= 1.01 * TOLERANCE_SLACK * scale
    return any(d.field == kept.field and d.violated for d in proof.departures)


def sampled(robot: Robot, scene: Scene, q: Array) -> dict[str, Array]:
    """Angle and excursion at configurations (k, n) by Pinocchio's frames and plain formulas."""
    upright, box, data = scene.path.upright, scene.path.position, robot.model.createData()
    angles, places = [], []
    for row in q:
        pin.framesForwardKinematics(robot.model, data, robot.pin_q(row))
        if upright:
            axis = data.oMf[robot.model.getFrameId(upright.link)].rotation @ upright.axis
            angles.append(math.atan2(math.hypot(axis[0], axis[1]), axis[2]))
        if box:
            place = data.oMf[robot.model.getFrameId(box.link)].act(np.array(box.point))
            inner = np.linalg.inv(box.pose.matrix) @ [*place, 1.0]
            places.append(max(abs(inner[i]) - box.size[i] / 2 for i in range(3)))
    found = {"path.upright": np.array(angles), "path.position": np.array(places)}
    return {field: values for field, values in found.items() if len(values)}


def random_pose(rng: np.random.Generator, reach: float) -> Pose:
    quaternion = rng.normal(size=4)
    return Pose(tuple(rng.uniform(-reach, reach, 3)), tuple(quaternion / np.linalg.norm(quaternion)))


def random_curve(rng: np.random.Generator, robot: Robot, kind: int) -> Curve:
    """A walk, jumps across the joints' whole ranges, or whole turns; straight, cubic or quintic between the rows."""
    low, high = np.clip(robot.lower, -3, 3), np.clip(robot.upper, -3, 3)
    rows = int(rng.integers(2, 9))
    steps = rng.normal(size=(rows, robot.n)).cumsum(axis=0) * [0.02, 0.2, 1.0][kind % 3]
    rows_at = rng.uniform(low, high) + steps if kind % 2 else rng.uniform(low, high, size=(rows, robot.n))
    if kind == 5:
        rows_at[1:] += 2 * math.pi * rng.integers(-1, 2, size=(rows - 1, robot.n))
    times = np.cumsum(rng.uniform(0.1, 1.0, rows))
    speeds, rates = rng.normal(size=(2, rows, robot.n))
    return Curve.through(rows_at, *((), (times, speeds), (times, speeds, 3 * rates))[int(rng.integers(3))])


@pytest.mark.sampled(4)
@pytest.mark.parametrize("base", [Pose(), UPSIDE_DOWN, TILTED], ids=["standing", "upside down", "tilted"])
@pytest.mark.parametrize("name", ROBOTS)
def test_dense_samples_never_find_more_than_is_proven(name: str, base: Pose, tmp_path: Path) -> None:
    spec = spec_of(name, tmp_path, base)
    robot, rng = load_robot(spec), np.random.default_rng([len(name), int(base.position[2] * 10)])
    seen: set[bool] = set()
    for kind in range(6):
        curve = random_curve(rng, robot, kind)
        interval = rng.integers(0, len(curve) - 1, LOOKS)
        q = curve.at(interval, rng.uniform(size=LOOKS))
        axis = rng.normal(size=3)
        upright = Upright(ROBOTS[name], tuple(axis / np.linalg.norm(axis)))
        size = tuple(np.where(rng.uniform(size=3) < 0.3, np.inf, rng.uniform(0.05, 2.0, 3))[:2]) + (0.7,)
        box = Within(ROBOTS[name], size, random_pose(rng, 0.6), tuple(rng.uniform(-0.2, 0.2, 3)))
        scene = scene_of(spec, upright, box)
        found = sampled(robot, scene, q)
        # a tolerance that the motion breaks, grazes or keeps
        tolerance = float(np.clip(found["path.upright"].max() * [0.7, 1.0001, 1.1][kind % 3], 1e-3, math.pi))
        scene = scene_of(spec, dataclasses.replace(upright, tolerance=tolerance), box)
        proof = proof_of(robot, scene, curve)
        for kept in proof.kept:
            seen.add(is_broken(proof, kept, found[kept.field], interval, kept.allowed or min(size) / 2))
        for departure in proof.departures:
            place = curve.at(np.array([departure.interval]), np.array([departure.fraction]))
            assert sampled(robot, scene, place)[departure.field][0] == pytest.approx(departure.found, abs=1e-7)
            assert departure.parameter == pytest.approx((departure.interval + departure.fraction) / (len(curve) - 1))
    assert seen == {True, False}


def test_a_violation_between_two_good_rows_is_found_and_named(tmp_path: Path) -> None:
    spec = spec_of("planar", tmp_path, Pose())
    robot = load_robot(spec)
    scene = scene_of(spec, Upright("fore", tolerance=0.1), Within("fore", (np.inf, 0.01, 0.6), Pose((0, 0, 0.5))))
    for turns in ([2 * math.pi, 0.0], [0.0, -2 * math.pi], [2 * math.pi, -4 * math.pi]):
        proof = proof_of(robot, scene, Curve.through(np.array([[0.0, 0.0], [0.0, 0.0], turns, turns])))
        upright = [d for d in proof.departures if d.field == "path.upright"]
        assert [(d.interval, d.violated) for d in upright] == [(1, True)]
        assert upright[0].found > 3.0
        assert "path.upright: fore is tilted by 3.14 rad, 0.1 are allowed" in upright[0].words
        fell = [d.interval for d in proof.departures if d.field == "path.position"]
        assert fell == ([1] if turns[0] else [])


def test_the_proof_agrees_with_an_arm_in_a_plane(tmp_path: Path) -> None:
    spec = spec_of("planar", tmp_path, Pose())
    robot, rng = load_robot(spec), np.random.default_rng(8)
    assert {False, True} == {_planar_case(robot, spec, rng) for _ in range(12)}


def _planar_case(robot: Robot, spec: RobotSpec, rng: np.random.Generator) -> bool:
    """Angles add up to |q_1 + q_2|, and the tip is at 0.5 (sin q_1, cos q_1) + 0.3 (sin(q_1 + q_2), cos(q_1 + q_2))."""
    rows = rng.uniform(-1.5, 1.5, size=(3, 2))
    tolerance, wide = float(rng.uniform(0.3, 2.5)), float(rng.uniform(0.3, 1.6))
    box = Within("fore", (wide, np.inf, np.inf), point=(0.0, 0.0, 0.3))
    scene = scene_of(spec, Upright("fore", tolerance=tolerance), box)
    proof = proof_of(robot, scene, Curve.through(rows))
    upright, position = proof.kept
    exact = float(np.abs(rows.sum(axis=1)).max())  # linear in between, so greatest at a row
    assert exact <= upright.worst <= max(exact, tolerance) + TOLERANCE_SLACK * tolerance
    dense = np.concatenate([np.linspace(a, b, 5000) for a, b in itertools.pairwise(rows)])
    away = np.abs(0.5 * np.sin(dense[:, 0]) + 0.3 * np.sin(dense.sum(axis=1))).max() - wide / 2
    assert away <= position.worst <= away + TOLERANCE_SLACK * wide / 2 + 1e-6
    kept = exact <= tolerance and away <= 0
    assert bool(proof.departures) != kept
    return kept


@pytest.mark.sampled(2)
@pytest.mark.parametrize("turn", [UPSIDE_DOWN, TILTED, Pose((1.0, 2.0, 0.5), (0.0, 0.0, 1.0, 0.0))])
def test_a_box_that_moves_with_the_base_sees_the_same(turn: Pose) -> None:
    rng = np.random.default_rng(9)
    for _ in range(5):
        box = random_pose(rng, 0.5)
        carried = pin.SE3(turn.matrix @ box.matrix)
        moved = Pose(tuple(carried.translation), tuple(pin.Quaternion(carried.rotation).coeffs()))
        standing, carried_spec = RobotSpec(name="ur5"), RobotSpec(name="ur5", base=turn)
        curve = random_curve(rng, load_robot(standing), 1)
        one, other = (
            proof_of(load_robot(spec), scene_of(spec, Within("tool0", (0.6, np.inf, 0.8), pose)), curve)
            for spec, pose in ((standing, box), (carried_spec, moved))
        )
        assert one.kept[0].worst == pytest.approx(other.kept[0].worst, abs=1e-6)
        assert [d.interval for d in one.departures] == [d.interval for d in other.departures]


def test_upside_down_an_axis_points_the_other_way() -> None:
    rng = np.random.default_rng(10)
    standing, hanging = RobotSpec(name="ur5"), RobotSpec(name="ur5", base=UPSIDE_DOWN)
    for _ in range(5):
        curve = random_curve(rng, load_robot(standing), 1)
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        one, other = (
            proof_of(load_robot(spec), scene_of(spec, Upright("tool0", tuple(sign * axis), 0.5)), curve)
            for spec, sign in ((standing, 1), (hanging, -1))
        )
        assert one.kept[0].worst == pytest.approx(other.kept[0].worst, abs=1e-6)


@pytest.mark.core
def test_the_certificate_says_what_is_kept_or_where_it_is_not() -> None:
    scene = load_scene("ur5_table")
    robot = load_robot(scene.robot)
    start = robot.configuration(scene.start)
    turned = start + [0.5, 0, 0, 0, 0, 1.0]
    nodded = turned + [0, 0, 0, -0.3, 0, 0]
    bare = dataclasses.replace(scene, obstacles=())

    def verdict(rows: list[Array], *constraints: Upright | Within) -> Certificate:
        held = dataclasses.replace(bare, path=scene_of(scene.robot, *constraints).path)
        certifier = Certifier(Setup.of(held, robot))
        return certifier.certify(Trajectory(robot.joint_names, np.array(rows)), check_ends=False)

    down = Upright("tool0", (0.0, 0.0, -1.0), 0.1)
    wide = Within("tool0", (2.0, 2.0, 0.3), Pose((0.5, 0.0, 0.25)))
    good = verdict([start, turned], down, wide)
    assert good.status is Status.CERTIFIED
    assert f", tool0 upright within {at_most(good.path[0].worst)} of 0.1 rad" in good.text
    assert "the point of tool0 at least " in good.text
    assert (good.departures, good.unproven) == ((), ())
    bad = verdict([start, turned, nodded, turned], down, wide)
    assert bad.status is Status.OFF_PATH
    assert bad.text.startswith("off path: path.upright: tool0 is tilted by 0.2")
    assert "0.1 are allowed after waypoint " in bad.text
    assert bad.unproven == (1, 2)
    plain = verdict([start, turned, nodded, turned])
    assert plain.status is Status.CERTIFIED
    assert (plain.path, plain.departures) == ((), ())
