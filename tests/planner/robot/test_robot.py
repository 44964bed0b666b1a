"""Robots: names, planned and locked joints, limits, pairs, and the messages when something is wrong."""

from __future__ import annotations

import itertools
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh

import hdplan
from hdplan import InputError, Mesh, Pose, Robot, RobotSpec, Scene, Trajectory, certify, load_robot, plan
from hdplan.planner.certificate.verdict import Status
from hdplan.planner.geometry.meshes import TriangleMesh, load_mesh
from hdplan.planner.robot import pin_model
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.robot_files.library import robot_names
from hdplan.scenes.targets import JointTarget

from ..urdf import joint_text, link_text, robot_text, write_robot

ARMS = {"panda": 7, "ur3_gripper": 6, "ur5": 6, "ur5_gripper": 6, "ur10": 6, "xarm7": 7, "kinova": 6, "z1": 6}
FINGERS = {"panda_finger_joint1": 0.065, "panda_finger_joint2": 0.065}  # beyond the URDF's 0.04
READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
BALL = '<sphere radius="0.05"/>'
ARM = """<robot name="arm">
  <link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="upper"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="lower"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="tip"><collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="b" type="{kind}"><parent link="upper"/><child link="lower"/><origin xyz="{offset} 0 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="c" type="fixed"><parent link="lower"/><child link="tip"/></joint>
</robot>"""


def _scene(robot: RobotSpec, start: JointTarget, goal: JointTarget, from_request: bool = False) -> Scene:
    return Scene("test", Path("some/scene.yaml"), robot, (), start, goal, from_request=from_request)


def _file(folder: Path, kind: str = "revolute", offset: float = 1.0) -> Path:
    path = folder / "arm.urdf"
    path.write_text(ARM.format(kind=kind, offset=offset))
    return path


def axes(folder: Path, spans: list[tuple[str, float, float]]) -> Robot:
    """A chain of joints along z, one for each kind and span; a long bed, and a block behind the last joint."""
    parts = [link_text("l0", box="9 1 0.1")]
    for i, (kind, low, high) in enumerate(spans, 1):
        parts.append(link_text(f"l{i}", box="0.2 0.2 0.2" if i == len(spans) else ""))
        parts.append(joint_text(f"j{i}", f"l{i - 1}", f"l{i}", "1 0 0", kind=kind, limits=(low, high)))
    return load_robot(RobotSpec(urdf=write_robot(folder / "axes.urdf", *parts)))


@pytest.fixture(scope="module")
def panda() -> Robot:
    return load_robot(RobotSpec(name="panda"))


@pytest.mark.parametrize(("name", "count"), ARMS.items())
def test_the_named_arms_load(name: str, count: int) -> None:
    robot = load_robot(RobotSpec(name=name))
    assert robot.n == count == robot.model.nv == len(robot.lower) == len(robot.upper)
    assert robot.links
    assert np.all(robot.lower < robot.upper)


def test_names_are_unique_and_lead_to_files() -> None:
    table = robot_names()
    assert set(ARMS) <= set(table)
    assert len({files.urdf for files in table.values()}) == len(table)
    assert all(files.urdf.is_file() and (files.srdf is None or files.srdf.is_file()) for files in table.values())


@pytest.mark.slow
@pytest.mark.parametrize("name", robot_names())
def test_every_listed_robot_loads_or_says_why_not(name: str) -> None:
    try:
        robot = load_robot(RobotSpec(name=name))
    except InputError as error:
        message = str(error)
    else:
        message = " ".join(robot.notes)
        assert robot.n > 0
    assert "\n" not in message


def test_unknown_robots_links_and_joints_are_refused_with_the_nearest_name() -> None:
    for name, more, words in (
        ("pamda", {}, r"'pamda' \(did you mean 'panda'"),
        ("panda", {"locked": {"panda_joint77": 0.0}}, "robot.locked: unknown joint 'panda_joint77' .*'panda_joint7'"),
        ("panda", {"ignore_pairs": [("panda_hnd", "panda_link1")]}, "ignore_pairs: unknown link .*'panda_hand'"),
    ):
        with pytest.raises(InputError, match=words):
            load_robot(RobotSpec(name=name, **more))


# --- locked joints ----------------------------------------------------------------------------------------------------


def test_fingers_are_held_by_default_and_named(panda: Robot) -> None:
    assert set(panda.locked) == set(FINGERS)
    assert any("panda_finger_joint1" in note for note in panda.notes)


def test_locked_joints_take_the_value_even_a_little_beyond_limits() -> None:
    full = pin.buildModelFromUrdf(str(robot_names()["panda"].urdf))
    robot = load_robot(RobotSpec(name="panda", locked={**FINGERS, "panda_joint3": 0.4}))
    assert robot.n == 6
    assert robot.locked == {**FINGERS, "panda_joint3": 0.4}
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper)
    reduced, complete = robot.model.createData(), full.createData()
    pin.framesForwardKinematics(robot.model, reduced, robot.pin_q(q))
    pin.framesForwardKinematics(full, complete, np.concatenate([q[:2], [0.4], q[2:], [0.065, 0.065]]))
    for link in robot.links:
        a, b = reduced.oMf[robot.model.getFrameId(link)], complete.oMf[full.getFrameId(link)]
        np.testing.assert_allclose(a.homogeneous, b.homogeneous, atol=1e-12)


@pytest.mark.parametrize("value", [-50.0, 3.01, -3.01])
def test_a_joint_held_where_it_cannot_be_is_refused(value: float) -> None:
    """robot.locked holds it there, or a scene's start."""
    words = rf"joint 'panda_joint1' is to be held at {value:g}, more than 0\.1 beyond its limits"
    with pytest.raises(InputError, match=words):
        load_robot(RobotSpec(name="panda", locked={"panda_joint1": value}))
    others = tuple(f"panda_joint{i}" for i in range(2, 8))
    start = JointTarget("start", by_name={"panda_joint1": value} | dict.fromkeys(others, -0.5))
    scene = Scene(robot=RobotSpec(name="panda", group=others), start=start, goal="default")
    with pytest.raises(InputError, match=words):
        load_scene_robot(scene)


def test_a_mimic_joint_follows_the_joint_that_is_held() -> None:
    robot = load_robot(RobotSpec(name="panda", locked={"panda_finger_joint1": 0.03}))
    assert robot.locked == {"panda_finger_joint1": 0.03, "panda_finger_joint2": 0.03}


def test_the_base_moves_everything() -> None:
    pose = Pose((0.1, 0.2, 0.9144), (0.0, 0.0, 0.6, 0.8))
    here, there = (load_robot(RobotSpec(name="ur5", base=base)) for base in (Pose(), pose))
    q = here.pin_q(np.full(6, 0.3))
    for robot in (here, there):
        assert robot.model.frames[0].placement.isIdentity()
    placed = []
    for robot in (here, there):
        data, geometry = robot.model.createData(), pin.GeometryData(robot.collision)
        pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry, q)
        placed.append([placement.homogeneous for placement in geometry.oMg])
    for a, b in zip(*placed, strict=True):
        np.testing.assert_allclose(pose.matrix @ a, b, atol=1e-12)


# --- configurations ---------------------------------------------------------------------------------------------------


def test_configurations_by_position_name_and_state_agree(panda: Robot) -> None:
    state = panda.named_states["default"]
    values = tuple(state[joint] for joint in panda.joint_names)
    by_name = dict(reversed(list(zip(panda.joint_names, values, strict=True))))
    for given in ({"positions": values}, {"by_name": by_name}, {"state": "default"}):
        np.testing.assert_array_equal(panda.configuration(JointTarget("start", **given)), values)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (JointTarget("goal", positions=(0.0,) * 6), "goal: 6 values, but panda plans 7 joints: panda_joint1, "),
        (JointTarget("goal", positions=(4.0, *READY[1:])), r"'panda_joint1' is 4, outside its limits \[-2.8973, 2.89"),
        (JointTarget("goal", state="defualt"), r"unknown state 'defualt' \(did you mean 'default'\?\)"),
        (JointTarget("goal", by_name={"panda_jiont1": 0.0}), r"'panda_jiont1' \(did you mean 'panda_joint1'\?\)"),
        (JointTarget("goal", by_name={"panda_finger_joint1": 0.0}), "not planned and held at 0.001"),
        (JointTarget("goal", by_name={"panda_joint1": 0.0}), "no value for panda_joint2, "),
    ],
)
def test_wrong_configurations_are_refused(panda: Robot, target: JointTarget, words: str) -> None:
    with pytest.raises(InputError, match=words):
        panda.configuration(target)
    scene = _scene(RobotSpec(name="panda"), JointTarget("start", positions=READY), target)
    with pytest.raises(InputError, match=r"some/scene\.yaml: "):
        _ = Setup.of(scene, panda).query


def test_only_a_request_may_lie_beyond_a_limit_by_its_rounding(panda: Robot) -> None:
    cases = (0.0, False, True), (5e-4, False, False), (5e-4, True, True), (2e-3, True, False)
    for excess, from_request, allowed in cases:
        q = np.array(READY)
        q[3] = panda.upper[3] + excess
        target = JointTarget("start", positions=tuple(q))
        if allowed:
            np.testing.assert_array_equal(panda.configuration(target, from_request), q)
        else:
            with pytest.raises(InputError, match="panda_joint4"):
                panda.configuration(target, from_request)


def test_a_request_holds_joints_that_are_not_planned_and_drops_unknown_ones() -> None:
    names = dict(zip((f"panda_joint{i}" for i in range(1, 8)), READY, strict=True))
    start = JointTarget("start", by_name={"robotiq": 1.0, **names, **FINGERS})
    scene = _scene(RobotSpec(name="panda"), start, JointTarget("goal", by_name=names), from_request=True)
    robot = load_scene_robot(scene)
    assert robot.locked == FINGERS
    setup = Setup.of(scene, robot)
    np.testing.assert_array_equal(setup.query.start, READY)
    assert any("robotiq" in note for note in setup.notes)
    changed = replace(scene, robot=RobotSpec(name="panda", locked={"panda_finger_joint1": 0.01}))
    assert load_scene_robot(changed).locked["panda_finger_joint1"] == 0.01


def test_limits_make_room_for_a_request_that_lies_a_little_beyond(panda: Robot) -> None:
    """Other descriptions of a Panda let joint 4 go to 0.0175; too far beyond is refused, as is a hand-written scene."""
    joint = panda.joint_names.index("panda_joint4")
    for excess, from_request, allowed in ((0.08, True, True), (0.2, True, False), (0.08, False, False)):
        goal = dict(zip(panda.joint_names, READY, strict=True)) | {"panda_joint4": panda.upper[joint] + excess}
        start = JointTarget("start", by_name=dict(zip(panda.joint_names, READY, strict=True)))
        scene = _scene(RobotSpec(name="panda"), start, JointTarget("goal", by_name=goal), from_request)
        robot = load_scene_robot(scene)
        if not allowed:
            np.testing.assert_array_equal(robot.upper, panda.upper)
            with pytest.raises(InputError, match=r"panda_joint4.*outside its limits"):
                _ = Setup.of(scene, robot).query
            continue
        assert robot.upper[joint] == goal["panda_joint4"]
        assert np.sum(robot.upper != panda.upper) == 1
        np.testing.assert_array_equal(robot.lower, panda.lower)
        assert any("panda_joint4" in note and "widened" in note for note in robot.notes)
        setup = Setup.of(scene, robot)
        np.testing.assert_array_equal(setup.query.goal, list(goal.values()))
        assert load_scene_robot(scene) is robot
        np.testing.assert_array_equal(robot.inner, (panda.lower, panda.upper))
        motion = plan(scene).trajectory.positions  # beyond the robot's own limits at the goal alone
        assert motion[-1, joint] == goal["panda_joint4"]
        assert (motion[:-1] <= panda.upper).all()
        assert (motion[:-1] >= panda.lower).all()


@pytest.mark.parametrize(("excess", "allowed"), [(0.0, True), (0.08, True), (0.12, False)])
def test_limits_make_room_for_a_named_state_that_lies_a_little_beyond(
    tmp_path: Path, excess: float, allowed: bool
) -> None:
    srdf = tmp_path / "arm.srdf"
    srdf.write_text(
        f'<robot name="arm"><group_state name="up" group="arm"><joint name="a" value="{2 + excess}"/>'
        '<joint name="b" value="0"/></group_state></robot>'
    )
    spec = RobotSpec(urdf=_file(tmp_path), srdf=srdf)
    scene = _scene(spec, JointTarget("start", state="up"), JointTarget("goal", positions=(0.0, 0.0)))
    robot = load_scene_robot(scene)
    assert robot.upper.tolist() == [2 + excess if allowed else 2.0, 1.0]
    assert any("joint 'a': limits [-1, 2] widened to" in note for note in robot.notes) == (allowed and excess > 0)
    if allowed:
        np.testing.assert_array_equal(Setup.of(scene, robot).query.start, [2 + excess, 0.0])
    else:
        with pytest.raises(InputError, match=r"start: state 'up': joint 'a' is 2.12, outside its limits \[-1, 2\]"):
            _ = Setup.of(scene, robot).query
    plain = _scene(spec, JointTarget("start", positions=(2.05, 0.0)), JointTarget("goal", positions=(0.0, 0.0)))
    assert load_scene_robot(plain).upper.tolist() == [2.0, 1.0]


def test_links_are_distinguished_whatever_they_are_called(tmp_path: Path) -> None:
    """A held joint is taken out of Pinocchio's model, in which a link may have the joint's name."""
    file, names = tmp_path / "arm.urdf", ("base", "a (link)", "a")
    links = [link_text(name, sphere=0.1) for name in names]
    ends = ("b", "base", "a (link)"), ("a", "a (link)", "a")
    joints = [joint_text(*each, kind="continuous", at="1 0 0") for each in ends]
    write_robot(file, *links, *joints)
    assert load_robot(RobotSpec(urdf=file)).links == names
    assert load_robot(RobotSpec(urdf=file, locked={"b": 0.3})).links == names
    write_robot(file, *links, *joints, link_text("floor"), joint_text("base", "floor", "base", kind="fixed"))
    assert load_robot(RobotSpec(urdf=file, locked={"a": 0.3})).links == names


def test_a_robot_is_loaded_once_until_its_files_change(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    turn = joint_text("turn", "base", "arm", "1 0 0")
    text = robot_text(link_text("base"), link_text("arm", box="0.1 0.1 0.4"), turn, name="arm")
    file.write_text(text)
    ends = JointTarget("start", (0.0,)), JointTarget("goal", (0.5,))
    first = load_scene_robot(_scene(RobotSpec(urdf=file), *ends))
    assert load_scene_robot(_scene(RobotSpec(urdf=file), *ends)) is first
    assert load_scene_robot(_scene(RobotSpec(urdf=file, base=Pose((0.0, 0.0, 1.0))), *ends)) is not first
    file.write_text(text.replace('upper="1.0"', 'upper="1.25"'))
    assert load_scene_robot(_scene(RobotSpec(urdf=file), *ends)).upper == 1.25


def test_continuous_joints_are_one_angle() -> None:
    kinova = load_robot(RobotSpec(name="kinova"))
    assert kinova.model.nq > kinova.n
    assert np.sum(np.isinf(kinova.upper)) == 3
    q = np.random.default_rng(0).uniform(-9, 9, (4, 5, kinova.n))
    configurations = kinova.pin_q(q)
    assert configurations.shape == (4, 5, kinova.model.nq)
    np.testing.assert_allclose(pin.normalize(kinova.model, configurations[0, 0]), configurations[0, 0], atol=1e-15)


# --- pairs ------------------------------------------------------------------------------------------------------------


def test_pairs_leave_out_neighbours_disabled_ignored_and_rigid_ones(panda: Robot) -> None:
    pairs = {frozenset(pair) for pair in panda.self_pairs}
    assert frozenset(("panda_link0", "panda_link5")) in pairs
    for a, b in (("panda_link0", "panda_link1"), ("panda_link1", "panda_link3"), ("panda_hand", "panda_link7")):
        assert frozenset((a, b)) not in pairs
    assert all(panda.link_joint[a] != panda.link_joint[b] for a, b in panda.self_pairs)
    fewer = load_robot(RobotSpec(name="panda", ignore_pairs=(("panda_link5", "panda_link0"),)))
    assert pairs - {frozenset(pair) for pair in fewer.self_pairs} == {frozenset(("panda_link0", "panda_link5"))}


def test_a_pair_that_always_touches_is_left_out_with_a_word(tmp_path: Path) -> None:
    apart = load_robot(RobotSpec(urdf=_file(tmp_path, offset=0.12)))
    assert set(apart.self_pairs) == {("base", "lower"), ("base", "tip"), ("tip", "upper")}
    assert not apart.notes
    touching = load_robot(RobotSpec(urdf=_file(tmp_path, offset=0.0)))
    assert not touching.self_pairs
    (note,) = (each for each in touching.notes if "proven always to touch" in each)
    assert "base-lower" in note
    assert "base-tip" in note


# --- files ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_joints_of_several_coordinates_are_refused_by_name(tmp_path: Path, kind: str) -> None:
    with pytest.raises(InputError, match="joint 'b' of arm has"):
        load_robot(RobotSpec(urdf=_file(tmp_path, kind)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "no such file"),
        ("<robot", "not well-formed XML"),
        ("<sdf/>", "the root element is <sdf>"),
        ('<robot name="x"><link name="a"/><link name="b"/></robot>', "not connected"),
        ('<robot name="x"><link name="a"/></robot>', "no joint left to plan"),
        (ARM.format(kind="revolute", offset=1).replace(BALL, '<mesh filename="no.stl"/>'), "no.stl"),
    ],
)
def test_a_wrong_urdf_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], text: str | None, words: str
) -> None:
    path = tmp_path / "bad.urdf"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        load_robot(RobotSpec(urdf=path))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_damaged_mesh_of_a_link_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Never half read: what is missing of a link would be proven free."""
    ball = trimesh.creation.icosphere(1, 0.05)
    path = tmp_path / "arm.urdf"
    for ending, kind in (("stl", "stl_ascii"), ("stl", "stl"), ("obj", "obj"), ("ply", "ply"), ("dae", "dae")):
        data = ball.export(file_type=kind)
        data = data.encode() if isinstance(data, str) else data
        mesh = tmp_path / f"ball.{ending}"
        shape = f'<mesh filename="package://{mesh.name}" scale="1 2 1"/>'
        path.write_text(ARM.format(kind="revolute", offset=1).replace(BALL, shape))
        mesh.write_bytes(data)
        (index,) = load_robot(RobotSpec(urdf=path)).link_geometry["tip"]
        item = load_robot(RobotSpec(urdf=path)).collision.geometryObjects[index]
        assert (item.meshPath, item.geometry.num_tris) == (str(mesh), len(ball.faces))
        np.testing.assert_allclose(np.ptp(item.geometry.vertices(), axis=0), ball.extents * [1, 2, 1], atol=1e-6)
        mesh.write_bytes(data[: len(data) * 2 // 3])
        with pytest.raises(InputError, match=rf"arm\.urdf: link 'tip': mesh {mesh}: ") as caught:
            load_robot(RobotSpec(urdf=path))
        assert "\n" not in str(caught.value)
        mesh.unlink()
    os.mkfifo(tmp_path / "ball.dae")
    with pytest.raises(InputError, match="is a pipe, not a file"):
        load_robot(RobotSpec(urdf=path))
    assert capfd.readouterr() == ("", "")


def test_groups_and_states_of_an_srdf(tmp_path: Path) -> None:
    srdf = tmp_path / "arm.srdf"
    srdf.write_text(
        '<robot name="arm"><group name="arm"><chain base_link="base" tip_link="upper"/></group>'
        '<group_state name="up" group="arm"><joint name="a" value="0.5"/><joint name="b" value="0.25"/></group_state>'
        '<disable_collisions link1="tip" link2="base" reason="Never"/></robot>'
    )
    robot = load_robot(RobotSpec(urdf=_file(tmp_path), srdf=srdf))
    assert robot.joint_names == ("a",)
    assert robot.locked == {"b": 0.25}
    np.testing.assert_array_equal(robot.configuration(JointTarget("start", state="up")), [0.5])
    assert ("base", "tip") not in robot.self_pairs


def test_a_mesh_that_a_urdf_mirrors_is_a_solid_still(tmp_path: Path) -> None:
    """A negative scale is how URDFs make a left arm of a right one: what is outside stays outside."""
    path, ball = tmp_path / "arm.urdf", trimesh.creation.icosphere(1, 0.05)
    ball.apply_translation([0.1, 0.2, 0.3])
    ball.export(tmp_path / "ball.ply")
    for scale in itertools.product((-1, 2), repeat=3):
        mesh = f'<mesh filename="ball.ply" scale="{" ".join(map(str, scale))}"/>'
        path.write_text(ARM.format(kind="revolute", offset=1).replace(BALL, mesh))
        robot = load_robot(RobotSpec(urdf=path))
        tree = robot.collision.geometryObjects[robot.link_geometry["tip"][0]].geometry
        corners = np.array([[t[0], t[1], t[2]] for t in map(tree.tri_indices, range(tree.num_tris))])
        found = TriangleMesh(np.asarray(tree.vertices()), corners)
        assert found.volume == pytest.approx(ball.volume * abs(np.prod(scale)), rel=1e-6)
        np.testing.assert_allclose(np.sort(found.vertices, axis=0), np.sort(ball.vertices * scale, axis=0), atol=1e-6)


def test_a_file_that_changes_while_it_is_read_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A kept robot is what its files say, even if one changes between its reading and the last one's."""
    urdf, mesh = tmp_path / "arm.urdf", tmp_path / "ball.obj"
    urdf.write_text(ARM.format(kind="revolute", offset=1).replace(BALL, '<mesh filename="ball.obj"/>'))
    trimesh.creation.icosphere(1, 0.05).export(mesh)
    target = JointTarget("start", (0.0, 0.0))
    scene = _scene(RobotSpec(urdf=urdf), target, target)
    true = load_mesh

    def changing(shape: Mesh, field: str) -> TriangleMesh:
        found = true(shape, field)
        trimesh.creation.icosphere(2, 0.07).export(mesh)
        return found

    def triangles() -> int:
        robot = load_scene_robot(scene)
        (index,) = robot.link_geometry["tip"]
        return int(robot.collision.geometryObjects[index].geometry.num_tris)

    monkeypatch.setattr(pin_model, "load_mesh", changing)
    assert triangles() == 80
    monkeypatch.setattr(pin_model, "load_mesh", true)
    assert triangles() == 320
    kept = load_scene_robot(scene)
    assert load_scene_robot(scene) is kept
    urdf.write_text(urdf.read_text().replace("ball.obj", "./ball.obj"))
    assert load_scene_robot(scene) is not kept


@pytest.mark.core
def test_random_configurations_lie_within_the_limits_and_reach_all_of_them(tmp_path: Path) -> None:
    """Slides are drawn from their whole range, however long, turning joints from one turn of it."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        spans = []
        for _ in range(6):
            kind, low = str(rng.choice(["prismatic", "revolute"])), float(rng.uniform(-20, 15))
            spans.append((kind, low, low + float(rng.choice([0.1, 5.0, 7.0, 13.0, 40.0]))))
        robot = axes(tmp_path, spans)
        drawn = robot.draw(rng, 2000)
        assert (drawn >= robot.lower).all()
        assert (drawn <= robot.upper).all()
        span = robot.upper - robot.lower
        whole = np.where(robot.turning, np.minimum(span, 2 * np.pi), span)
        assert (np.ptp(drawn, axis=0) > 0.98 * whole).all()
    panda_like = axes(tmp_path, [("continuous", 0, 0), ("revolute", -7.0, 7.0), ("revolute", 0.0, 7.0)])
    drawn = panda_like.draw(rng, 2000)
    assert (np.abs(drawn[:, :2]) <= np.pi).all()
    assert (drawn[:, 2] >= 0).all()


def test_a_pair_apart_at_the_far_end_of_a_long_slide_is_checked(tmp_path: Path) -> None:
    """The block lies on the bed for the slide's first metres, not at its end: a motion onto the bed is not free."""
    robot = axes(tmp_path, [("prismatic", 0, 20), ("prismatic", 0, 0.1)])
    assert robot.self_pairs == (("l0", "l2"),)
    scene = Scene(robot=RobotSpec(urdf=tmp_path / "axes.urdf"), start=[10, 0], goal=[1, 0])
    onto = Trajectory(robot.joint_names, np.array([[10.0, 0.0], [1.0, 0.0]]))
    assert certify(scene, onto).status is Status.IN_CONTACT


def test_check_pairs_are_checked_whatever_the_srdf_says() -> None:
    """Disabled ones and neighbours; not links that move as one, which motions do not change."""
    plain = load_robot("panda")
    disabled, neighbours = ("panda_link5", "panda_link7"), ("panda_link1", "panda_link2")
    together = ("panda_hand", "panda_link7")
    assert plain.unchecked.keys() >= {disabled, neighbours, together}
    checked = load_robot(RobotSpec(name="panda", check_pairs=(disabled[::-1], neighbours, together)))
    assert {*checked.self_pairs} - {*plain.self_pairs} == {disabled, neighbours}
    assert checked.unchecked.keys() == plain.unchecked.keys() - {disabled, neighbours}
    with pytest.raises(InputError, match=r"robot.check_pairs: unknown link 'panda_lnk2' .*'panda_link2'"):
        load_robot(RobotSpec(name="panda", check_pairs=(("panda_link1", "panda_lnk2"),)))
    with pytest.raises(InputError, match=r"check_pairs\[0\]: 'a' and 'b' are in ignore_pairs too"):
        RobotSpec(name="panda", check_pairs=(("a", "b"),), ignore_pairs=(("b", "a"),))


def test_a_pair_that_always_touches_and_is_to_be_checked_is_in_contact(tmp_path: Path) -> None:
    """A pair of the scene's is not left out because its bodies touch everywhere."""
    links = (link_text(name, box="1 1 1") for name in "abc")
    urdf = write_robot(tmp_path / "r.urdf", *links, joint_text("j1", "a", "b"), joint_text("j2", "b", "c"))
    assert load_robot(RobotSpec(urdf=urdf)).self_pairs == ()
    pairs = (("a", "b"), ("a", "c"))
    checked = RobotSpec(urdf=urdf, check_pairs=pairs)
    assert load_robot(checked).self_pairs == pairs
    scene = Scene(robot=checked, start=[0.0, 0.0], goal=[0.5, 0.5])
    with pytest.raises(hdplan.UnsolvableError, match=r"a and [bc] overlap"):
        plan(scene)
