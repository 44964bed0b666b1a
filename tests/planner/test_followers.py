"""Joints that follow others: a robot with a linkage does what the same robot does whose followers are ordinary joints,
moved by hand; what cannot be done right is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import ArrayLike

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.control.barrier_settings import BarrierSettings
from hdplan.planner.control.barriers import scene_barriers
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.problem.problem import Problem
from hdplan.planner.proof.proof import prove
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.inverse_kinematics import inverse_kinematics
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.verify import RejectedError, verify
from hdplan.verify.checking import check
from hdplan.verify.reading import read_world

from .linkage import JOINTS, RULES, linkage_urdf
from .proof.worlds import packed, unpacked

START, GOAL = [-1.0, 0.3, -0.5, 0.2, 0.4], [1.0, 0.6, -0.2, 0.5, -0.4]
OBSTACLES: list[dict[str, Any]] = [
    {"name": "post", "shape": {"type": "box", "size": [0.1, 0.1, 1.2]}, "pose": {"position": [1.0, 0.0, 1.0]}},
    {"name": "ball", "shape": {"type": "sphere", "radius": 0.15}, "pose": {"position": [-0.9, 0.3, 0.8]}},
]


def by_hand(q: Array) -> dict[str, Array]:
    """All joints of the arm at configurations (..., 5), followers too, as RULES say."""
    found = {joint: np.asarray(q)[..., i] for i, joint in enumerate(JOINTS)}
    for joint, (followed, factor, offset) in RULES.items():
        found[joint] = factor * found[followed] + offset
    return found


def scene_of(folder: Path, follow: bool = True, **sections: Any) -> Scene:
    """The arm among obstacles; without `follow` its followers are ordinary joints, which start and goal name."""
    urdf = linkage_urdf(folder, follow)
    ends = {"start": START, "goal": GOAL}
    if not follow:
        ends = {key: {name: float(at) for name, at in by_hand(np.array(q)).items()} for key, q in ends.items()}
    cases = {
        "hdplan": 1,
        "robot": {"urdf": urdf.name},
        "obstacles": OBSTACLES,
        **{key: {"joints": q} for key, q in ends.items()},
        **sections,
    }
    file = folder / f"{urdf.stem}.yaml"
    file.write_text(json.dumps(cases))
    return hdplan.load_scene(file)


def matrix(robot: Robot, free: Robot) -> Array:
    """How the free arm's joints move with the other's (m, n), found by moving one at a time."""
    at = [unfolded(free, q) for q in np.vstack([np.zeros((1, robot.n)), np.eye(robot.n)])]
    return np.stack(at[1:], axis=1) - at[0][:, None]


def unfolded(free: Robot, q: Array) -> Array:
    return np.stack([by_hand(q)[joint] for joint in free.joint_names], axis=-1)


def test_followers_are_not_planned_and_narrow_what_they_follow(tmp_path: Path) -> None:
    robot = load_robot(RobotSpec(urdf=linkage_urdf(tmp_path)))
    assert robot.joint_names == JOINTS
    assert set(robot.followers) == set(RULES)
    assert robot.locked == {}
    np.testing.assert_allclose([robot.lower[2], robot.upper[2]], [-1.8, 1.2])  # (-0.07 - 0.02) / 0.05: the sled's
    assert any("'elbow': limits narrowed to [-1.8, 1.2]" in note for note in robot.notes)
    assert any("'piston' follows 'lift' at -1.25 x its value + 0.1" in note for note in robot.notes)
    assert robot.endless.tolist() == [False, False, False, True, False]
    q = robot.draw(np.random.default_rng(0), 50)
    np.testing.assert_allclose(robot.expand(q), unfolded(robot.unfolded, q), atol=1e-15)
    assert ((robot.expand(q) >= robot.unfolded.lower) & (robot.expand(q) <= robot.unfolded.upper)).all()
    assert robot.unfolded.unfolded is robot.unfolded


def test_a_robot_without_followers_is_its_own_unfolded_one() -> None:
    panda = load_robot(RobotSpec(name="panda"))
    q = panda.draw(np.random.default_rng(0), 3)
    assert panda.unfolded is panda
    assert panda.expand(q) is q
    assert panda.fold(q) is q


def test_distances_and_verdicts_are_those_of_the_arm_moved_by_hand(tmp_path: Path) -> None:
    """Single configurations and curves of every degree; a collision of a follower alone, too."""
    rng = np.random.default_rng(1)
    ours, other = (Certifier(Setup.of(scene_of(tmp_path, follow))) for follow in (True, False))
    free, seen = other.robot, set()
    for k in range(30):
        q = ours.robot.draw(rng, 6)
        for one, two in zip(ours.nearest(q[0]), other.nearest(unfolded(free, q[0])), strict=True):
            assert one is not None and two is not None  # noqa: PT018
            assert {one.link, one.other} == {two.link, two.other}
            assert one.distance == pytest.approx(two.distance, abs=1e-9)
        assert {(c.link, c.other) for c in ours.contacts(q[0])} == {
            (c.link, c.other) for c in other.contacts(unfolded(free, q[0]))
        }
        rows = q[0] + rng.choice([0.02, 0.1, 0.4]) * (q - q[0])
        times, rates = np.cumsum(rng.uniform(0.5, 1.0, 6)), rng.uniform(-0.1, 0.1, (2, 6, 5))[: k % 3]
        motion = Trajectory(ours.robot.joint_names, rows, {}, times, *rates)
        still = unfolded(free, np.zeros(5))
        by_hand_ = Trajectory(
            free.joint_names, unfolded(free, rows), {}, times, *(unfolded(free, rate) - still for rate in rates)
        )
        mine, theirs = (c.certify(m, check_ends=False) for c, m in ((ours, motion), (other, by_hand_)))
        assert mine.status == theirs.status
        for here, there in ((mine.clearance, theirs.clearance), (mine.self_clearance, theirs.self_clearance)):
            assert here == pytest.approx(there, abs=1e-6) if here is not None else there is None
        seen.add(mine.status.value)
        assert {(p.link, p.other) for p in mine.failures} == {(p.link, p.other) for p in theirs.failures}
    assert {"certified", "in_contact"} <= seen


def tip(robot: Robot, q: ArrayLike) -> list[float]:
    """The far end of the rod at a configuration."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
    return list(data.oMf[robot.model.getFrameId("bar")].act(np.array([-0.48, 0.0, 0.0])).tolist())


def test_a_contact_of_a_follower_alone_is_refuted(tmp_path: Path) -> None:
    """A ball where the rod swings, far from all else."""
    middle = np.array([0.0, 0.2, 0.3, 0.0, 0.0])
    place = {"position": tip(spec(tmp_path), middle)}
    ball = {"name": "ball", "shape": {"type": "sphere", "radius": 0.03}, "pose": place}
    rows = np.array([middle - [0, 0, 0.6, 0, 0], middle, middle + [0, 0, 0.6, 0, 0]])
    certifier = Certifier(Setup.of(scene_of(tmp_path, obstacles=[ball])))
    found = certifier.certify(Trajectory(JOINTS, rows), check_ends=False)
    assert found.status.value == "in_contact"
    assert {place.link for place in found.failures} == {"bar"}


SETTINGS: list[dict[str, Any]] = [
    {},
    {"planner": {"swept": True}},
    {"planner": {"distance": "fcl"}},
    {"path": {"upright": {"link": "bar", "tolerance": 0.2}}, "timing": {"duration": 1.0}, "limits": {"velocity": 3.0}},
]


@pytest.mark.parametrize("sections", SETTINGS, ids=["default", "swept", "fcl", "path"])
def test_gradients_are_those_of_differences_and_of_the_arm_moved_by_hand(tmp_path: Path, sections: Any) -> None:
    """The CasADi program has the same, and second derivatives are compared, too."""
    moving = {**OBSTACLES[1], "name": "cart", "motion": {"velocity": [0.2, 0.0, 0.1]}} if "path" in sections else None
    sections = {**sections, "obstacles": [*OBSTACLES, moving] if moving else OBSTACLES}
    planner = {"waypoints": 6, "activation": 0.3, **sections.pop("planner", {})}
    ours, other = (hdplan.build(scene_of(tmp_path, follow, planner=planner, **sections)) for follow in (True, False))
    e = matrix(ours.robot, other.robot)
    q = ours.polyline() + np.random.default_rng(0).normal(scale=0.05, size=(6, 5))
    found, by_hand_ = ours.penalty(q), other.penalty(unfolded(other.robot, q))
    assert found.cost > 0.0
    if "path" not in sections:  # there the free arm's velocities are penalized, too
        assert found.cost == pytest.approx(by_hand_.cost, rel=1e-9)
        np.testing.assert_allclose(found.gradient, by_hand_.gradient @ e, rtol=1e-7, atol=1e-9 * found.cost)
        np.testing.assert_allclose(found.diagonal, e.T @ by_hand_.diagonal @ e, rtol=1e-7, atol=1e-7 * found.cost)
    assert_differences(ours, q)
    if not planner.get("distance"):
        import casadi as ca

        program = ours.casadi()
        cost = ca.Function("f", [program.x, program.p], [ca.gradient(program.nlp["f"], program.x)])
        x = program.guess(q)
        once = np.asarray(cost(x, 1.0) - cost(x, 0.0)).ravel()
        inside = ours.penalty(np.vstack([ours.start, q[1:-1], ours.goal])).gradient[1:-1]
        stages = np.concatenate([once, np.zeros(5)])[: 5 * 15].reshape(5, 15)[1:, :5]
        np.testing.assert_allclose(stages, inside, rtol=1e-6, atol=1e-6 * found.cost)


def assert_differences(problem: Problem, q: Array) -> None:
    """The gradient is that of differences of the cost, along random ways."""
    gradient, rng = problem.penalty(q).gradient, np.random.default_rng(3)
    for _ in range(3):
        way = rng.normal(size=q.shape)
        step = 1e-6
        slope = (problem.penalty(q + step * way).cost - problem.penalty(q - step * way).cost) / (2 * step)
        assert slope == pytest.approx(float(np.sum(gradient * way)), rel=2e-3, abs=1e-5)


def test_a_pose_of_a_link_that_followers_carry_is_reached(tmp_path: Path) -> None:
    """Every configuration returned does; the numbers of followers do not matter."""
    scene = scene_of(tmp_path)
    robot = load_robot(scene.robot)
    for link in ("hand", "sled", "bar"):
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, robot.pin_q(np.array(START)))
        frame = data.oMf[robot.model.getFrameId(link)]
        place = hdplan.Pose(tuple(frame.translation.tolist()))
        found = inverse_kinematics(robot, place, link, all_branches=True, free_rotation="all")
        assert len(found)
        for q in found:
            pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
            off = data.oMf[robot.model.getFrameId(link)].translation - frame.translation
            assert np.linalg.norm(off) <= 1e-3 + 1e-9


def test_rates_of_followers_are_kept(tmp_path: Path) -> None:
    """One number is for all joints, the URDF's own for those that it gives; lists and names are the planned joints'."""

    def most(limits: Any) -> dict[str, list[float]]:
        scene = scene_of(tmp_path, timing={"rate": 100}, **({"limits": limits} if limits else {}))
        return {key: values.tolist() for key, values in Setup.of(scene).limits.items()}

    found = most({"velocity": 1.0, "acceleration": 2.0})
    assert found["velocity"] == pytest.approx([1.0, 1.0 / 1.25, 1.0, 1.0, 1.0])
    assert found["acceleration"] == pytest.approx([2.0, 2.0 / 1.25, 2.0, 2.0, 2.0])
    assert most({"acceleration": 9.0})["velocity"] == [1.5, 1.5, 1.5, 3.0, 1.5]  # of followers only the sled has one
    assert most({"velocity": [1.0, 2.0, 40.0, 1.0, 1.0], "acceleration": 9.0})["velocity"] == pytest.approx(
        [1.0, 2.0, 30.0, 1.0, 1.0]
    )
    assert most({"velocity": {"lift": 0.5}, "acceleration": 9.0})["velocity"] == [1.5, 0.5, 1.5, 3.0, 1.5]
    for limits, message in (
        ({"torque": 100.0}, "limits.torque: torques are not known where 'cylinder' follows 'lift'"),
        ({"velocity": {"rod": 1.0}}, "joint 'rod' is not planned itself: 'rod' follows 'elbow' at -1 x its value"),
        ({"position": {"rod": [0.0, 1.0]}}, "joint 'rod' is not planned itself"),
    ):
        with pytest.raises(InputError, match=message):
            most({**limits, "acceleration": 9.0})


def test_torques_of_a_linkage_are_refused(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, limits={"acceleration": 1.0}, planner={"objective": "energy"})
    with pytest.raises(InputError, match=r"planner\.objective: 'energy'.*torques are not known where 'cylinder'"):
        hdplan.plan(scene)


WRONG: list[tuple[Callable[[Path], object], str]] = [
    (lambda f: spec(f, group=("turn", "rod")), r"group\[1\].*it is a mimic joint, which follows 'elbow'"),
    (lambda f: spec(f, group=("turn", "piston")), r"mimic joint, which follows 'cylinder'"),
    (lambda f: spec(f, locked={"rod": 0.0}), "robot.locked: joint 'rod' follows 'elbow', which is planned"),
    (lambda f: spec(f, {"slide": ("elbow", 0.05, 9.0)}, group=("elbow",)), "leave no range"),
    (lambda f: spec(f, {"rod": ("elbow", 2e3, 0.0)}), "'rod' follows 'elbow' by a multiplier of 2000"),
    (lambda f: start(f, {"rod": 0.1}), "joint 'rod' is given the value 0.1, but would be at 0.5: 'rod' follows"),
    (lambda f: start(f, {"slide": -0.005, "rad": 0.5}), "unknown joint 'rad'"),
]


def spec(folder: Path, rules: Any = None, **more: Any) -> Robot:
    return load_robot(RobotSpec(urdf=linkage_urdf(folder, **(rules or {})), **more))


def start(folder: Path, more: dict[str, float]) -> object:
    return Setup.of(scene_of(folder, start={"joints": {**dict(zip(JOINTS, START, strict=True)), **more}})).query


@pytest.mark.parametrize(("made", "message"), WRONG)
def test_invalid_linkages_are_refused(made: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        made(tmp_path)


def test_values_of_followers_may_be_given_where_they_are_right(tmp_path: Path) -> None:
    start(tmp_path, {"rod": 0.5, "slide": -0.005, "piston": -0.275})
    assert spec(tmp_path, {"rod": ("elbow", 0.0, 0.3)}).locked == {"rod": 0.3}  # it does not move
    held = spec(tmp_path, locked={"elbow": 0.4})
    assert held.joint_names == ("turn", "lift", "roll", "bend")
    assert held.locked == pytest.approx({"elbow": 0.4, "rod": -0.4, "slide": 0.04})
    stuck = spec(tmp_path, {"slide": ("elbow", 0.05, 9.0)})
    assert "elbow" in stuck.locked
    assert any("leave no range: elbow" in note for note in stuck.notes)


def test_a_motion_may_name_followers_that_follow(tmp_path: Path) -> None:
    certifier = Certifier(Setup.of(scene_of(tmp_path, obstacles=[])))
    rows = np.linspace(START, GOAL, 5)
    names = (*JOINTS, "rod")
    whole = np.column_stack([rows, -rows[:, 2]])
    assert certifier.certify(Trajectory(names, whole)).certified
    for row in (0, 2):
        off = whole.copy()
        off[row, 5] += 1e-3
        with pytest.raises(InputError, match=r"joint 'rod' is up to 0\.001 from where it would follow"):
            certifier.certify(Trajectory(names, off))
    with pytest.raises(InputError, match=r"joint 'rod' is up to 0\.5 from"):
        certifier.certify(Trajectory(JOINTS, rows, {"rod": 0.0}))


def test_hands_are_held_and_arms_are_planned(tmp_path: Path) -> None:
    """A joint that drives only what hangs on it is a hand's, whatever its name, unless a group asks for it."""
    file = linkage_urdf(tmp_path)
    jaws = "".join(
        f'<link name="{name}"/><joint name="{name}" type="prismatic"><parent link="hand"/><child link="{name}"/>'
        f'<axis xyz="0 1 0"/><limit lower="0" upper="0.1" velocity="1" effort="1"/>{mimic}</joint>'
        for name, mimic in (("jaw", ""), ("other", '<mimic joint="jaw" multiplier="-1" offset="0.1"/>'))
    )
    file.write_text(file.read_text().replace("</robot>", f"{jaws}</robot>"))
    robot = load_robot(RobotSpec(urdf=file))
    assert robot.joint_names == JOINTS
    assert robot.locked == {"jaw": 0.0, "other": 0.1}
    checked = load_robot(RobotSpec(urdf=file, group=(*JOINTS, "jaw")))
    assert checked.joint_names == (*JOINTS, "jaw")
    assert "other" in checked.followers


def test_a_followed_joint_without_limits_is_not_turned_back(tmp_path: Path) -> None:
    """A whole turn of it takes what follows elsewhere: the goal is where the scene says."""
    robot = spec(tmp_path, {"rod": ("roll", 0.5, 0.0)})
    at = robot.joint_names.index("roll")
    assert robot.lower[at] == -np.inf
    assert not robot.endless.any()
    scene = scene_of(tmp_path, goal={"joints": [*GOAL[:3], 6.0, GOAL[4]]})
    assert Setup.of(scene).query.goal[at] == pytest.approx(6.0 - 2 * np.pi)
    linkage_urdf(tmp_path, rod=("roll", 0.5, 0.0))
    setup = Setup.of(scene)
    assert setup.query.goal[at] == 6.0
    turned = np.linspace(setup.query.start, setup.query.goal - 2 * np.pi * np.eye(5)[at], 4)
    assert Certifier(setup).certify(Trajectory(JOINTS, turned)).status.value == "wrong_ends"


def test_barriers_are_those_of_the_arm_moved_by_hand(tmp_path: Path) -> None:
    """Their gradients too, and speeds of points are bounded with what follows."""
    scenes = [scene_of(tmp_path, follow) for follow in (True, False)]
    ours, other = (scene_barriers(scene, load_robot(scene.robot), BarrierSettings()) for scene in scenes)
    e, rng = matrix(ours.robot, other.robot), np.random.default_rng(5)
    assert set(ours.names) <= set(other.names)
    same = [other.names.index(name) for name in ours.names]
    assert len(set(ours.names)) < len(ours.names)  # several bodies of one pair: compared by their least values
    for q in ours.robot.draw(rng, 5):
        mine, theirs = ours.evaluate(q), other.evaluate(unfolded(other.robot, q))
        for name in sorted(set(ours.names)):
            one = [i for i, each in enumerate(ours.names) if each == name]
            two = [i for i, each in enumerate(other.names) if each == name]
            a, b = one[int(mine.value[one].argmin())], two[int(theirs.value[two].argmin())]
            assert mine.value[a] == pytest.approx(theirs.value[b], abs=1e-9)
            np.testing.assert_allclose(mine.gradient[a], theirs.gradient[b] @ e, atol=1e-7)
    assert same
    assert ours.levers == pytest.approx(other.levers @ np.abs(e), rel=0.1)


def test_it_is_planned_proven_and_checked(tmp_path: Path) -> None:
    """From end to end; a proof for another multiplier is rejected, even one that names the robot's file."""
    astray = spec(tmp_path, {"rod": ("elbow", 2.0, 0.0)})  # where its rod would be
    ball = {"name": "pea", "shape": {"type": "sphere", "radius": 0.02}, "pose": {"position": tip(astray, START)}}
    scene = scene_of(tmp_path, planner={"clearance": 0.005}, obstacles=[*OBSTACLES, ball])
    found = hdplan.plan(scene, time_limit=60.0)
    assert found.certified
    assert found.trajectory.joint_names == JOINTS
    file, motion, other = scene.source, tmp_path / "motion.json", tmp_path / "proof.bin"
    found.save(motion)
    proof = prove(file, motion)
    assert "limits, start, goal" in proof.text
    proof.save(other)
    verdict = verify(file, motion, other)
    assert verdict.whole
    assert "piston at -1.25 x lift + 0.1" in verdict.text  # a chain, from its head
    linkage_urdf(tmp_path, rod=("elbow", 2.0, 0.0))
    with pytest.raises(RejectedError, match="SHA-256 differs"):
        verify(file, motion, other)
    head, world, rest = unpacked(proof.data)
    named = packed({**head, "files": read_world(file, motion).hashes}, world, rest)
    with pytest.raises(RejectedError, match=r"the worlds differ: joints\[rod\]\.follows\[1\]: 2.0 is read.* has -1.0"):
        check(file, motion, named)
    with pytest.raises(RejectedError, match=r"bar 0.*: leaf .* its plane keeps them -?[0-9.]+ mm apart"):
        check(file, motion, forged(proof.data, file, motion))
    urdf = linkage_urdf(tmp_path)
    urdf.write_text(urdf.read_text().replace('upper="0.09"', 'upper="0"'))  # of the sled
    with pytest.raises(RejectedError, match=r"limits.position: joint 'slide' is beyond it"):
        check(file, motion, forged(proof.data, file, motion))
    linkage_urdf(tmp_path)
    assert check(file, motion, forged(proof.data, file, motion))[0] == verdict
    content = json.loads(motion.read_text())
    for sign, good in ((-1, True), (-1.01, False)):
        columns = {"joint_names": [*content["joint_names"], "rod"]}
        rows = {"positions": [[*row, sign * row[2]] for row in content["positions"]]}
        motion.write_text(json.dumps({**content, **columns, **rows}))
        if good:
            assert check(file, motion, forged(proof.data, file, motion))[0].whole
        else:
            with pytest.raises(RejectedError, match="'rod' moves otherwise in the world"):
                forged(proof.data, file, motion)


def forged(data: bytes, scene: Path, motion: Path) -> bytes:
    """The proof with the hashes of the files as they are now, and with the world that the checker reads in them."""
    head, _, rest = unpacked(data)
    reading = read_world(scene, motion)
    return packed({**head, "files": reading.hashes}, reading.world, rest)


def test_a_robot_with_other_followers_is_not_the_scenes(tmp_path: Path) -> None:
    scene = scene_of(tmp_path)
    robot = load_robot(scene.robot)
    with pytest.raises(InputError, match="other joints"):
        Setup.of(scene, replace(robot.unfolded, self_pairs=robot.self_pairs))
