"""MoveIt's files as they are: the checker reads of them the world in which hdplan plans, or one of both refuses."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest
import yaml

import hdplan
from hdplan.planner.proof.reading import ReadProof
from hdplan.verify import RejectedError, verify
from hdplan.verify.checking import check
from hdplan.verify.reading import read_world

from . import moveit_cell as cells
from .moveit_cell import GOOD, HELD, MATRIX, MOTION, OBJECTS, REQUEST, ROBOT, SCENE, URDF, Cell, put, solid, written
from .worlds import kind_of, packed, unpacked

Proven = tuple[Cell, bytes]


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Proven:
    """The files, and their proof."""
    cell = written(tmp_path_factory.mktemp("moveit"))
    return cell, cell.prove().data


def test_a_request_is_required(tmp_path: Path) -> None:
    scene, motion, request, robot = written(tmp_path)
    for given, words in (((None, None), "--request"), ((None, robot), "--request"), ((request, None), "robot")):
        with pytest.raises(RejectedError, match=words):
            read_world(scene, motion, None, *given)


XACRO = URDF.replace('name="r">', 'name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">').replace("0.6", "${0.2 * 3}")
MJCF = """<mujoco model="r"><compiler angle="radian"/><worldbody><body name="base" pos="0 0 0.05">
<geom type="box" size="0.05 0.05 0.05"/><body name="up"><joint name="a" axis="0 1 0" range="-2 2"/>
<geom type="box" size="0.025 0.025 0.2" pos="0 0 0.3"/>
<body name="fore" pos="0 0 0.6"><joint name="b" axis="0 1 0" range="-2 2"/>
<geom type="box" size="0.025 0.025 0.2" pos="0 0 0.3"/>
<body name="hand" pos="0 0 0.6"><joint name="c" axis="1 0 0" range="-2 2"/><geom size="0.03" pos="0 0 0.1"/>
<body name="finger" pos="0 0.1 0.1"><joint name="f" type="slide" axis="0 1 0" range="0 0.1"/><geom size="0.01"/></body>
</body></body></body></body></worldbody></mujoco>"""
UNREAD = {"r.xacro": XACRO, "r.xml": MJCF}
ELSEWHERE: dict[str, tuple[str, str, Any, str]] = {
    "an obstacle": ("scene", OBJECTS + ".0.primitive_poses.0.position", [-1.5, 0.1, 0.5], "obstacle ball"),
    "what is held": ("scene", HELD + ".object.primitive_poses.0.position", [0, 0, 0.21], r"bodies\[cup"),
    "touch_links": ("scene", HELD + ".touch_links", [], "touch_links"),
    "the start": ("request", "start_state.joint_state.position", [0.2, 0.1, 0.15], r"start\[0\]"),
    "the goal": ("request", "goal_constraints.0.joint_constraints.0.position", 0.41, r"goal\[0\]"),
    "a padding": ("scene", "link_padding", [], r"clearances\.own"),
}


@pytest.mark.parametrize("name", UNREAD)
def test_a_robot_in_xacro_or_mjcf_is_taken_from_the_proof_and_all_else_is_read(name: str, tmp_path: Path) -> None:
    cell = written(
        tmp_path, {**MOTION, "times": None, "velocities": None}, robot={"robot": {**ROBOT, "urdf": name}},
        request={x: y for x, y in REQUEST.items() if x != "max_velocity_scaling_factor"},
    )  # fmt: skip
    (tmp_path / name).write_text(UNREAD[name])
    with pytest.raises(RejectedError, match="no proof that has it"):
        cell.read()
    proof = cell.prove()
    taken = f"the robot ({name}) with its limits and the pairs left out; "
    assert proof.text.startswith(f"accepted in part; NOT read by the checker, but taken from the proof: {taken}")
    verdict, _ = cell.check(proof.data)
    assert (verdict.text, verdict.whole) == (proof.text, False)
    head, world, rest = unpacked(proof.data)
    for which, path, value, words in ELSEWHERE.values():
        message = getattr(cell, which)
        before = message.read_bytes()
        message.write_text(json.dumps(put(json.loads(before), path, value)))
        files = {**head["files"], which: hashlib.sha256(message.read_bytes()).hexdigest()}
        with pytest.raises(RejectedError, match=words):
            cell.check(packed({**head, "files": files}, world, rest))
        message.write_bytes(before)


@pytest.mark.parametrize(("model", "whose"), [("r", ""), ("", ""), ("other", " of the robot other")])
def test_pairs_that_moveit_would_compare_are_named(model: str, whose: str, tmp_path: Path) -> None:
    """MoveIt compares links that its matrix does not let touch, or does not name, for any robot."""
    cell = written(tmp_path, scene=put(SCENE, "robot_model_name", model))
    pairs = "base-fore, base-hand, fore-hand" if whose else "base-hand, fore-hand"
    line = f"\n  not compared, although MoveIt's allowed collision matrix{whose} does: {pairs}\n"
    assert line in cell.check(cell.prove().data)[0].text
    for message in ({"entry_names": [], "entry_values": []}, {}):  # which says nothing
        assert not written(tmp_path, scene=put(SCENE, MATRIX, message)).read().passed


def test_a_request_is_proven_and_verified(original: Proven, tmp_path: Path) -> None:
    cell, proof = original
    (tmp_path / "m.proof").write_bytes(proof)
    verdict = verify(cell.scene, cell.motion, tmp_path / "m.proof", cell.request, cell.robot)
    assert verdict.whole
    claims = "limits, start, goal, velocity, acceleration"
    for words in (claims, "request: SHA-256", "robot: SHA-256", "the SRDF: base-hand"):
        assert words in verdict.text
    assert "the SRDF: base-fore" not in verdict.text  # the matrix checks it
    assert ReadProof(cell.scene, cell.motion, proof, cell.request, cell.robot).rows == 1
    world = cell.agrees()
    assert [x["name"] for x in world["bodies"]][-5:] == ["cup", "ball", "desk", "desk/1", "obstacle2"]
    assert world["clearances"]["own"] == dict.fromkeys(("ball", "desk", "desk/1", "obstacle2"), 0.01)
    assert world["limits"]["velocity"] == [0.75, 0.75, 0.75]
    assert world["held"] == {"f": 0.02}


def test_a_robot_beside_a_scene_of_hdplans_takes_the_place_of_its_own(tmp_path: Path) -> None:
    """The same holds for every other command."""
    scene, motion, _, robot = written(tmp_path)
    ends = {"start": {"joints": [0.1, 0.2, 0.1]}, "goal": {"joints": [0.4, 0.5, 0]}}
    scene.write_text(json.dumps({"hdplan": 1, "robot": {"name": "panda"}, **ends}))
    proof = hdplan.prove(scene, motion, robot=robot).data
    assert check(scene, motion, proof, robot=robot)[0].whole
    for words, more in (("robot", {}), ("joint", {"robot": "ur5"})):
        with pytest.raises(RejectedError, match=words):
            check(scene, motion, proof, **more)
    with pytest.raises(RejectedError, match="'hdplan'"):
        check(scene, motion, proof, scene, robot)


OTHER: dict[str, tuple[str, str, Any, str]] = {  # file, place, value, and where the world differs
    "an object's place": ("scene", OBJECTS + ".0.primitive_poses.0.position.1", 0.1000001, "bodies"),
    "an object's turn": ("scene", OBJECTS + ".1.pose.orientation", [0.6, 0, 0, -0.8], "bodies"),
    "a size": ("scene", OBJECTS + ".1.primitives.1.dimensions.0", 0.30000001, "bodies"),
    "sizes exchanged": ("scene", OBJECTS + ".1.primitives.1.dimensions", [0.05, 0.3], "bodies"),
    "a kind": ("scene", OBJECTS + ".1.primitives.1", {"type": 2, "dimensions": [0.3]}, "bodies"),
    "a frame": ("scene", OBJECTS + ".1.header.frame_id", "world", "bodies"),
    "a frame's place": ("scene", "fixed_frame_transforms.0.transform.translation.x", 1.3, "bodies"),
    "a frame's frame": ("scene", "fixed_frame_transforms.0.header.frame_id", "", "bodies"),
    "a name": ("scene", OBJECTS + ".0.id", "balloon", "bodies"),
    "no objects": ("scene", "world.collision_objects", [], "bodies"),
    "a held object's place": ("scene", HELD + ".object.primitive_poses.0.position.2", 0.21, "bodies"),
    "nothing held": ("scene", "robot_state.attached_collision_objects", [], "bodies"),
    "a held object's link": (
        "scene", HELD,
        {
            "link_name": "fore",
            "object": {"header": {"frame_id": "fore"}, "id": "cup", **solid("box", [0.03, 0.03, 0.1], 0, 0, 0.2)},
        }, "bodies",
    ),
    "what it may touch": ("scene", HELD + ".touch_links", [], "not_compared"),
    "what else it may touch": ("scene", HELD + ".touch_links", ["up"], "not_compared"),
    "an entry allowed": ("scene", MATRIX + ".entry_values", [[True] * 3] * 3, "not_compared"),
    "entries that check more": ("scene", MATRIX + ".entry_values", [[False] * 3] * 3, "not_compared"),
    "a default that checks": ("scene", MATRIX + ".default_entry_values", [False], "not_compared"),
    "another robot's matrix": ("scene", "robot_model_name", "q", "not_compared"),
    "no padding": ("scene", "link_padding", [], "clearances"),
    "a held joint": ("scene", "robot_state.joint_state.position.1", 0.03, "held"),
    "the start": ("request", "start_state.joint_state.position.0", 0.21, "start"),
    "the goal": ("request", "goal_constraints.0.joint_constraints.1.position", 0.49, "goal"),
    "a goal for a joint that is held": (
        "request", "goal_constraints.0.joint_constraints",
        [{"joint_name": x, "position": y} for x, y in (("a", 0.4), ("b", 0.5), ("c", 0), ("f", 0.02))], "goal",
    ),
    "the speed": ("request", "max_velocity_scaling_factor", 0.4, "limits"),
    "the acceleration": ("request", "max_acceleration_scaling_factor", 0.9, "limits"),
    "no limits": ("request", "max_velocity_scaling_factor", 1, "limits"),
    "a path constraint": (
        "request", "path_constraints",
        {"position_constraints": [{"link_name": "hand", "constraint_region": solid("box", [9] * 3, 0, 0, 0)}]}, "path",
    ),
    "the robot's place": ("robot", "robot.base.position.0", 0.11, "joints"),
    "a pair that is ignored": ("robot", "robot.ignore_pairs", [["up", "hand"]], "not_compared"),
}  # fmt: skip


@pytest.mark.parametrize("change", OTHER)
def test_a_change_of_meaning_is_rejected(change: str, original: Proven, tmp_path: Path) -> None:
    """The old proof is, also where whoever means harm has put the new file's hash there."""
    which, path, value, where = OTHER[change]
    cell = written(tmp_path, **{which: put(GOOD[which], path, value)})
    assert f"{which}: is not the file that was proven" in cell.outcome(original[1])
    cell.agrees()
    assert cell.outcome(original[1], cell.read().hashes).startswith(f"the worlds differ: {where}")


SAME: dict[str, tuple[str, str, Any]] = {
    "colours": ("scene", "object_colors", [{"id": "ball", "color": {"r": 1}}]),
    "a name": ("scene", "name", "another cell"),
    "numbers as text": ("scene", OBJECTS + ".0.primitive_poses.0.position", ["-1.5e+0", "1e-1", 0.4]),
    "a vector by name": ("scene", OBJECTS + ".0.primitive_poses.0.position", {"x": -1.5, "y": 0.1, "z": 0.4}),
    "a turn by its negative": ("scene", OBJECTS + ".0.primitive_poses.0.orientation", [0, 0, -0.6, -0.8]),
    "a turn of another length": ("scene", OBJECTS + ".0.primitive_poses.0.orientation", [0, 0, 0.603, 0.804]),
    "rows of ROS 2": ("scene", MATRIX + ".entry_values", [{"enabled": x} for x in SCENE[MATRIX]["entry_values"]]),
    "contact that is allowed": ("scene", MATRIX + ".default_entry_names", ["hand"]),
    "a map without cells": ("scene", "world.octomap", {"octomap": {"id": "OcTree", "resolution": 0.1, "data": []}}),
    "a stamp": ("request", "start_state.joint_state.header", {"stamp": {"sec": 5}}),
    "another planner": ("request", "planner_id", "BKPIECE"),
    "no limits of the workspace": ("request", "workspace_parameters", None),
    "the group without the robot's name": ("request", "group_name", "arm"),
    "the speed as text": ("request", "max_velocity_scaling_factor", "5e-1"),
}  # fmt: skip


@pytest.mark.parametrize("change", SAME)
def test_other_words_of_the_same_meaning_have_the_same_world(change: str, original: Proven, tmp_path: Path) -> None:
    which, path, value = SAME[change]
    cell = written(tmp_path, **{which: put(GOOD[which], path, value)})
    assert "is not the file that was proven" in cell.outcome(original[1])
    assert not cell.outcome(original[1], cell.read().hashes)
    cell.agrees()


REFUSED: dict[str, tuple[str, str, Any, str]] = {
    "a mesh": ("scene", OBJECTS + ".0.meshes", [{"triangles": []}], "meshes"),
    "a plane": ("scene", OBJECTS + ".0.planes", [{"coef": [0, 0, 1, 0]}], "planes"),
    "a cone": ("scene", OBJECTS + ".0.primitives.0", {"type": 4, "dimensions": [1, 1]}, "box, sphere"),
    "a removal": ("scene", OBJECTS + ".0.operation", 1, "operation"),
    "an unknown field": ("scene", OBJECTS + ".0.colour", 1, "'colour'"),
    "a difference": ("scene", "is_diff", True, "is_diff"),
    "a moving frame": ("scene", OBJECTS + ".0.header", {"frame_id": "hand"}, "frame 'hand'"),
    "an unknown frame": ("scene", OBJECTS + ".0.header", {"frame_id": "moon"}, "frame 'moon'"),
    "a frame that is moved": ("scene", "fixed_frame_transforms.0.child_frame_id", "floor", "another pose"),
    "paddings that differ": ("scene", "link_padding.0.padding", 0.02, "the same for all"),
    "a padding below 0": ("scene", "link_padding.0.padding", -0.01, "link_padding"),
    "a scale": ("scene", "link_scale.0.scale", 1.1, "link_scale"),
    "a moved base": ("scene", "robot_state.multi_dof_joint_state.transforms.0.translation", [0, 0, 1], "base"),
    "a velocity of a held joint": ("scene", "robot_state.joint_state.velocity", [0, 0.1], "is held, and is to move"),
    "a velocity too few": ("scene", "robot_state.joint_state.velocity", [0.1], "velocities of other joints"),
    "a name that is held": ("scene", OBJECTS + ".0.id", "cup", "taken"),
    "a name twice": ("scene", OBJECTS + ".0.id", "desk/1", "taken"),
    "a joint twice": ("request", "start_state.joint_state.name", ["a", "a", "b"], "twice"),
    "rows that lack": ("scene", MATRIX + ".entry_names", ["base", "fore"], "rows"),
    "a quaternion without w": ("scene", "fixed_frame_transforms.0.transform.rotation", {"z": 1}, "ROS 1"),
    "two goals": ("request", "goal_constraints", REQUEST["goal_constraints"] * 2, "one goal"),
    "a factor": ("request", "max_velocity_scaling_factor", 1.5, "scaling_factor"),
    "a planner of lines": ("request", "planner_id", "LIN", "shape of the motion"),
    "waypoints": ("request", "reference_trajectories", [{}], "reference_trajectories"),
    "a speed of a link": ("request", "max_cartesian_speed", 0.1, "max_cartesian_speed"),
    "a group that holds what the motion moves": ("request", "group_name", "two", "moves otherwise"),
    "another group": ("request", "group_name", "leg", "group"),
    "joints along the way": (
        "request", "path_constraints", {"joint_constraints": [{"joint_name": "a", "position": 0}]}, "of joints",
    ),
    "an axis that is off": (
        "request", "path_constraints",
        {"orientation_constraints": [cells.turned("hand", 0.3, 0.2, 4, turn=[0.006, 0, 0, 1])]}, "up or down",
    ),
    "an axis as far off as it may be tilted": (
        "request", "path_constraints",
        {"orientation_constraints": [cells.turned("hand", 0.001, 0.2, 4, turn=[0.001, 0, 0, 1])]}, "up or down",
    ),
    "the robot's own group": ("robot", "robot.group", "two", "robot's own"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_unsupported_input_is_named(case: str, tmp_path: Path) -> None:
    which, path, value, words = REFUSED[case]
    with pytest.raises(RejectedError, match=words):
        written(tmp_path, **{which: put(GOOD[which], path, value)}).read()


FRAME = "fixed_frame_transforms.0.child_frame_id"
BOTH: dict[str, tuple[str, tuple[tuple[str, Any], ...], str]] = {
    "a frame with the name of an object before it": (
        "scene", ((FRAME, "ball"), (OBJECTS + ".1.header.frame_id", "ball")), "the name of an object",
    ),
    "a frame with the name of what is held": ("scene", ((HELD + ".object.id", "room"),), "the name of an object"),
    "a frame with the name of an object's own frame": (
        "scene", ((FRAME, "ball/top"), (OBJECTS + ".1.header.frame_id", "ball/top")), "the name of an object",
    ),
    "a base moved by a joint's value": (
        "scene", (("robot_state.joint_state", {"name": ["a", "virtual/x"], "position": [0.3, 1]}),), "robot's base",
    ),
    "a goal for the base": (
        "request",
        (
            (
                "goal_constraints.0.joint_constraints",
                [{"joint_name": x, "position": 0.4} for x in ("a", "b", "c", "virtual/theta")],
            ),
        ), "robot's base",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BOTH)
def test_input_that_moveit_takes_differently_is_refused_by_both(case: str, tmp_path: Path) -> None:
    """MoveIt places what is given in a frame in an object's, if that has the name, and moves a base by `joint/x`."""
    which, changes, words = BOTH[case]
    content = GOOD[which]
    for path, value in changes:
        content = put(content, path, value)
    written(tmp_path, **{which: content}).refused(words)


def test_a_goal_in_the_frame_of_an_object_is_refused(tmp_path: Path) -> None:
    goal = {"position_constraints": [cells.position("hand", cells.BALL, **cells.DESK)]}
    scene = put(SCENE, OBJECTS + ".0.id", "room")  # after which nothing is given in the frame of that name
    scene = put(scene, OBJECTS + ".1.header.frame_id", "")
    written(tmp_path, scene=scene, request={**REQUEST, "goal_constraints": [goal]}).refused("the name of an object")


def test_a_link_of_the_name_world_that_is_elsewhere_is_not_the_world(tmp_path: Path) -> None:
    """MoveIt looks among links first; where the robot stands elsewhere, poses in that frame have two meanings."""
    scene = put(SCENE, OBJECTS + ".0.header", {"frame_id": "world"})
    for base in ({}, ROBOT["base"]):
        cell = written(tmp_path, scene=scene, robot={"robot": {**ROBOT, "base": base}})
        (tmp_path / "r.urdf").write_text(URDF.replace('"floor"', '"world"'))
        if base:
            cell.refused("frame 'world'", "unknown frame 'world'")
        else:
            cell.agrees()


def test_an_octomap_is_taken_from_the_proof(tmp_path: Path) -> None:
    """Its cells are proven, but the checker does not read them itself, and its verdict begins with that."""
    way = [0, -64, *[3, 0] * 14, 2, 0]  # down to one cell, at the origin
    octomap = {"octomap": {"binary": True, "id": "OcTree", "resolution": 0.1, "data": way}}
    octomap |= {"header": {"frame_id": "room"}, "origin": {"position": [1, 0, 2]}}
    cell = written(tmp_path, scene=put(SCENE, "world.octomap", octomap))
    verdict, world = cell.check(cell.prove().data)
    taken = 'NOT read by the checker, but taken from the proof: "<octomap>" (octomap)'
    assert verdict.text.startswith(f"accepted in part; {taken}")
    assert kind_of(world["bodies"][-1]["shape"])[0] == "boxes"
    assert not verdict.whole
    with pytest.raises(RejectedError, match="octomap"):
        cell.read()


def test_a_message_that_ros_prints_is_read(original: Proven, tmp_path: Path) -> None:
    """A byte order mark, other words of YAML, and `---` at its end change nothing."""
    cell = written(tmp_path, scene="\ufeff" + yaml.safe_dump(SCENE) + "---\n", request=yaml.safe_dump(REQUEST) + "---")
    assert not cell.outcome(original[1], cell.read().hashes)
    cell.agrees()
    with pytest.raises(RejectedError):
        written(tmp_path, scene=yaml.safe_dump(SCENE) + "---\nname: b\n").read()
