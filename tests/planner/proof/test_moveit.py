"""MoveIt's files as they are: the checker reads of them the world in which hdplan plans, or one of both refuses."""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import hdplan
from hdplan import HdplanError, NotProvenError, Trajectory
from hdplan.planner.proof.reading import ReadProof
from hdplan.planner.proof.world import world_of
from hdplan.planner.robot.setup import Setup
from hdplan.verify import RejectedError, verify
from hdplan.verify.balls import HERE
from hdplan.verify.checking import check
from hdplan.verify.compare import check_equal
from hdplan.verify.constraints import path_of
from hdplan.verify.effects import check_claim
from hdplan.verify.reading import read_world
from hdplan.verify.world import World

from .worlds import kind_of, packed, unpacked

Data = dict[str, Any]

MBM = Path(__file__).parents[4] / "shared" / "mbm"
BOX = '<geometry><box size="0.05 0.05 0.4"/></geometry>'
LIMIT = '<limit lower="-2" upper="2" velocity="1.5" effort="30"/>'
URDF = f"""<robot name="r"><link name="floor"/>
<link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<link name="up"><collision><origin xyz="0 0 0.3"/>{BOX}</collision></link>
<link name="fore"><collision><origin xyz="0 0 0.3"/>{BOX}</collision></link>
<link name="hand"><collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.03"/></geometry></collision></link>
<link name="finger"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
<joint name="foot" type="fixed"><origin xyz="0 0 0.05"/><parent link="floor"/><child link="base"/></joint>
<joint name="a" type="revolute"><parent link="base"/><child link="up"/><axis xyz="0 1 0"/>{LIMIT}</joint>
<joint name="b" type="revolute"><origin xyz="0 0 0.6"/><parent link="up"/><child link="fore"/><axis xyz="0 1 0"/>{LIMIT}
</joint><joint name="c" type="revolute"><origin xyz="0 0 0.6"/><parent link="fore"/><child link="hand"/>
<axis xyz="1 0 0"/>{LIMIT}</joint>
<joint name="f" type="prismatic"><origin xyz="0 0.1 0.1"/><parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.1" velocity="0.2" effort="30"/></joint></robot>"""
SRDF = """<robot name="r"><group name="arm"><joint name="a"/><joint name="b"/><joint name="c"/></group>
<group name="two"><joint name="a"/><joint name="b"/></group>
<disable_collisions link1="base" link2="fore" reason="Never"/>
<disable_collisions link1="base" link2="hand" reason="Never"/>
<disable_collisions link1="finger" link2="fore" reason="Never"/></robot>"""
ROBOT: Data = {"urdf": "r.urdf", "srdf": "r.srdf", "base": {"position": [0.1, 0, 0.2], "rpy": [0, 0, 0.5]}}
HALF = [0, 0, 0.6, 0.8]


def solid(kind: Any, sizes: list[float], *place: float, turn: Any = HALF) -> Data:
    pose = {"position": [*place], "orientation": turn}
    return {"primitives": [{"type": kind, "dimensions": sizes}], "primitive_poses": [pose]}


SCENE: Data = {
    "name": "a cell",
    "robot_model_name": "r",
    "robot_state": {
        "joint_state": {"name": ["a", "f"], "position": [0.3, 0.02], "velocity": [0.0, 0.0]},
        "multi_dof_joint_state": {
            "joint_names": ["virtual"], "transforms": [{"translation": [0, 0, 0], "rotation": [0, 0, 0, 1]}],
        },
        "attached_collision_objects": [
            {
                "link_name": "hand",
                "object": {"header": {"frame_id": "hand"}, "id": "cup", **solid("box", [0.03, 0.03, 0.1], 0, 0, 0.2)},
                "touch_links": ["fore"], "weight": 0.5,
            }
        ],
    },
    "fixed_frame_transforms": [
        {
            "header": {"frame_id": "base"}, "child_frame_id": "/room",
            "transform": {"translation": {"x": 1.2, "y": 0.1}, "rotation": {"z": 0.6, "w": 0.8}},
        }
    ],
    "allowed_collision_matrix": {
        "entry_names": ["base", "fore", "up"],
        "entry_values": [[False, False, True], [False, False, True], [True, True, False]],
        "default_entry_names": ["finger"], "default_entry_values": [True],
    },
    "link_padding": [{"link_name": x, "padding": 0.01} for x in ("base", "up", "fore", "hand", "finger")],
    "link_scale": [{"link_name": "base", "scale": 1.0}],
    "world": {
        "collision_objects": [
            {"id": "ball", **solid("sphere", [0.1], -1.5, 0.1, 0.4)},
            {
                "header": {"frame_id": "room"}, "id": "desk",
                "pose": {"position": [0.4, 0.3, 0], "orientation": [0, 0.6, 0, -0.8]},
                "primitives": [{"type": 1, "dimensions": [0.4, 0.3, 0.2]}, {"type": 3, "dimensions": [0.3, 0.05]}],
                "primitive_poses": [{}, {"position": [0, 0.2, 0.3], "orientation": {"x": 0.6, "w": 0.8}}],
            },
            {"header": {"frame_id": "base"}, **solid("cylinder", [0.2, 0.1], 0, -1.4, 0.2), "operation": 0},
        ]
    },
}  # fmt: skip
REQUEST: Data = {
    "group_name": "r_arm",
    "start_state": {"joint_state": {"name": ["b", "c", "a"], "position": [0.2, 0.1, 0.1]}, "is_diff": True},
    "goal_constraints": [
        {"joint_constraints": [{"joint_name": x, "position": y} for x, y in (("a", 0.4), ("b", 0.5), ("c", 0))]}
    ],
    "max_velocity_scaling_factor": 0.5,
    "max_acceleration_scaling_factor": 0,
    "planner_id": "RRTConnect",
    "workspace_parameters": {"min_corner": {"x": -1}, "max_corner": {"x": 1}},
}  # fmt: skip
MOTION: Data = {
    "hdplan_trajectory": 1, "joint_names": ["a", "b", "c"], "times": [0, 4],
    "positions": [[0.1, 0.2, 0.1], [0.4, 0.5, 0]], "velocities": [[0, 0, 0], [0, 0, 0]],
}  # fmt: skip
GOOD: dict[str, Data] = {"scene": SCENE, "request": REQUEST, "robot": {"robot": ROBOT}}
OBJECTS, MATRIX, HELD = (
    "world.collision_objects",
    "allowed_collision_matrix",
    "robot_state.attached_collision_objects.0",
)


def files(folder: Path, motion: Data = MOTION, **changed: Any) -> tuple[Path, Path, Path, str]:
    """Write a planning scene, a motion, a request and a robot's section; the last two are changed by name."""
    folder.mkdir(exist_ok=True)
    (folder / "r.urdf").write_text(URDF)
    (folder / "r.srdf").write_text(SRDF)
    for name, content in (GOOD | changed).items():
        (folder / f"{name}.yaml").write_text(content if isinstance(content, str) else json.dumps(content))
    (folder / "m.json").write_text(json.dumps(motion))
    return folder / "scene.yaml", folder / "m.json", folder / "request.yaml", str(folder / "robot.yaml")


def planned(scene: Path, motion: Path, request: Path, robot: str) -> Data:
    """The world in which hdplan plans."""
    return world_of(Setup.of(hdplan.load_scene(scene, request, robot)), Trajectory.load(motion))


def put(content: Data, path: str, value: Any) -> Data:
    """A message with another value at a place such as `world.collision_objects.0.id`; None: without it."""
    other = copy.deepcopy(content)
    *way, last = (int(x) if x.isdigit() else x for x in path.split("."))
    where: Any = other
    for step in way:
        where = where[step]
    where[last] = value
    return other


def read(given: tuple[Path, Path, Path, str]) -> Any:
    scene, motion, request, robot = given
    return read_world(scene, motion, None, request, robot)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> tuple[tuple[Path, Path, Path, str], bytes]:
    """The files, and their proof."""
    given = files(tmp_path_factory.mktemp("moveit"))
    scene, motion, request, robot = given
    return given, hdplan.prove(scene, motion, request, robot).data


def test_a_request_is_required(tmp_path: Path) -> None:
    scene, motion, request, robot = files(tmp_path)
    for given, words in (
        ((None, None), "--request FILE"),
        ((None, robot), "--request FILE"),
        ((request, None), "robot"),
    ):
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
    "an obstacle": ("scene", "world.collision_objects.0.primitive_poses.0.position", [-1.5, 0.1, 0.5], "obstacle ball"),
    "what is held": (
        "scene",
        "robot_state.attached_collision_objects.0.object.primitive_poses.0.position",
        [0, 0, 0.21],
        r"bodies\[cup",
    ),
    "touch_links": ("scene", "robot_state.attached_collision_objects.0.touch_links", [], "touch_links"),
    "the start": ("request", "start_state.joint_state.position", [0.2, 0.1, 0.15], r"start\[0\]"),
    "the goal": ("request", "goal_constraints.0.joint_constraints.0.position", 0.41, r"goal\[0\]"),
    "a padding": ("scene", "link_padding", [], r"clearances\.own"),
}


@pytest.mark.parametrize("name", UNREAD)
def test_a_robot_in_xacro_or_mjcf_is_taken_from_the_proof_and_all_else_is_read(name: str, tmp_path: Path) -> None:
    robot = {"robot": {**ROBOT, "urdf": name}}
    scene, motion, request, section = given = files(
        tmp_path, {**MOTION, "times": None, "velocities": None}, robot=robot,
        request={x: y for x, y in REQUEST.items() if x != "max_velocity_scaling_factor"},
    )  # fmt: skip
    (tmp_path / name).write_text(UNREAD[name])
    with pytest.raises(RejectedError, match="no proof that has it"):
        read(given)
    proof = hdplan.prove(scene, motion, request, section)
    taken = f"the robot ({name}) with its limits and the pairs left out; "
    assert proof.text.startswith(f"accepted in part; NOT read by the checker, but taken from the proof: {taken}")
    verdict, _ = check(scene, motion, proof.data, request, section)
    assert verdict.text == proof.text
    assert not verdict.whole
    for which, path, value, words in ELSEWHERE.values():
        message = {"scene": scene, "request": request}[which]
        before = message.read_text()
        message.write_text(json.dumps(put(json.loads(before), path, value)))
        head, world, rest = unpacked(proof.data)
        files_ = {x: hash_of(tmp_path / f"{x}.yaml") if x == which else y for x, y in head["files"].items()}
        with pytest.raises(RejectedError, match=words):
            check(scene, motion, packed({**head, "files": files_}, world, rest), request, section)
        message.write_text(before)


def hash_of(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(("model", "whose"), [("r", ""), ("", ""), ("other", " of the robot other")])
def test_pairs_that_moveit_would_compare_are_named(model: str, whose: str, tmp_path: Path) -> None:
    """MoveIt compares links that its matrix does not let touch, or does not name, for any robot."""
    given = files(tmp_path, scene=put(SCENE, "robot_model_name", model))
    scene, motion, request, robot = given
    proof = hdplan.prove(scene, motion, request, robot)
    verdict = check(scene, motion, proof.data, request, robot)[0]
    pairs = "base-fore, base-hand, fore-hand" if whose else "base-hand, fore-hand"
    assert f"\n  not compared, although MoveIt's allowed collision matrix{whose} does: {pairs}\n" in verdict.text
    for message in ({"entry_names": [], "entry_values": []}, {}):  # which says nothing
        given = files(tmp_path, scene=put(SCENE, MATRIX, message))
        assert not read_world(scene, motion, None, request, robot).passed


def outcome(proof: bytes, given: tuple[Path, Path, Path, str], hashes: dict[str, str] | None = None) -> str:
    """What the checker says of a proof, in which other hashes of files are put: "" where it accepts."""
    scene, motion, request, robot = given
    if hashes is not None:
        head, world, rest = unpacked(proof)
        proof = packed({**head, "files": hashes}, world, rest)
    try:
        check(scene, motion, proof, request, robot)
    except RejectedError as error:
        return str(error)
    return ""


def test_a_request_is_proven_and_verified(original: Any, tmp_path: Path) -> None:
    (scene, motion, request, robot), proof = original
    (tmp_path / "m.proof").write_bytes(proof)
    verdict = verify(scene, motion, tmp_path / "m.proof", request, robot)
    assert verdict.whole
    for words in (
        "limits, start, goal, velocity, acceleration",
        "request: SHA-256",
        "robot: SHA-256",
        "the SRDF: base-hand",
    ):
        assert words in verdict.text
    assert "the SRDF: base-fore" not in verdict.text  # the matrix checks it
    assert ReadProof(scene, motion, proof, request, robot).rows == 1
    world = read((scene, motion, request, robot)).world
    check_equal(world, planned(scene, motion, request, robot))
    assert [x["name"] for x in world["bodies"]][-5:] == ["cup", "ball", "desk", "desk/1", "obstacle2"]
    assert world["clearances"]["own"] == dict.fromkeys(("ball", "desk", "desk/1", "obstacle2"), 0.01)
    assert world["limits"]["velocity"] == [0.75, 0.75, 0.75]
    assert world["held"] == {"f": 0.02}


def test_a_robot_beside_a_scene_of_hdplans(tmp_path: Path) -> None:
    """It takes the place of the scene's, as for every other command."""
    scene, motion, _, robot = files(tmp_path)
    scene.write_text(
        json.dumps(
            {
                "hdplan": 1,
                "robot": {"name": "panda"},
                "start": {"joints": [0.1, 0.2, 0.1]},
                "goal": {"joints": [0.4, 0.5, 0]},
            }
        )
    )
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
def test_a_change_of_meaning_is_rejected(change: str, original: Any, tmp_path: Path) -> None:
    """With the old proof, and where whoever means harm has put the new file's hash there."""
    which, path, value, where = OTHER[change]
    given = files(tmp_path, **{which: put(GOOD[which], path, value)})
    assert f"{which}: is not the file that was proven" in outcome(original[1], given)
    reading = read(given)
    assert outcome(original[1], given, reading.hashes).startswith(f"the worlds differ: {where}")
    check_equal(reading.world, planned(*given))


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
def test_other_words_of_the_same_meaning_have_the_same_world(change: str, original: Any, tmp_path: Path) -> None:
    which, path, value = SAME[change]
    given = files(tmp_path, **{which: put(GOOD[which], path, value)})
    assert "is not the file that was proven" in outcome(original[1], given)
    assert not outcome(original[1], given, read(given).hashes)
    check_equal(read(given).world, planned(*given))


def position(link: str, region: Data, **more: Any) -> Data:
    return {"link_name": link, "constraint_region": region, **more}


def turned(link: str, *most: float, turn: Any = HALF, **more: Any) -> Data:
    tolerances = {f"absolute_{x}_axis_tolerance": y for x, y in zip("xyz", most, strict=True)}
    return {"link_name": link, "orientation": turn, **tolerances, **more}


BALL, CRATE = solid("sphere", [0.02], 0.3, 0.1, 1.2), solid("box", [0.1, 0.2, 0.3], 0.3, 0.1, 1.2)
DESK = {"header": {"frame_id": "room"}}
CONSTRAINTS: dict[str, tuple[str, Data]] = {
    "a ball": ("goal", {"position_constraints": [position("hand", BALL)]}),
    "a crate on the desk": ("goal", {"position_constraints": [position("hand", CRATE, **DESK)]}),
    "a large ball": ("goal", {"position_constraints": [position("hand", solid("sphere", [3], 0, 0, 0))]}),
    "a turn": (
        "goal",
        {
            "position_constraints": [position("hand", BALL, **DESK)],
            "orientation_constraints": [turned("hand", 0.1, 0.2, 0.3, **DESK, parameterization=1)],
        },
    ),
    "free about z": (
        "goal",
        {"position_constraints": [position("hand", BALL)], "orientation_constraints": [turned("hand", 2, 2.5, 3.14)]},
    ),
    "free about all": (
        "goal",
        {"position_constraints": [position("hand", BALL)], "orientation_constraints": [turned("hand", 4, 4, 4)]},
    ),
    "two links": (
        "goal",
        {
            "position_constraints": [position("hand", BALL), position("fore", CRATE)],
            "orientation_constraints": [turned("fore", 0.1, 0.1, 0.1)],
        },
    ),
    "upright": ("path", {"orientation_constraints": [turned("hand", 0.3, 0.2, 6.3)]}),
    "upside down": ("path", {"orientation_constraints": [turned("hand", 0.3, 0.2, 4, turn=[1, 0, 0, 0])]}),
    "x upright": ("path", {"orientation_constraints": [turned("hand", 4, 0.2, 0.3, turn=[0.1, -0.7, 0.1, 0.7])]}),
    "x upright, but for rounding": (
        "path",
        {"orientation_constraints": [turned("fore", 4, 0.2, 0.3, turn=[0, 0.7071067811865476, 0, 0.7071067811865476])]},
    ),
    "upright, a little off": (
        "path",
        {"orientation_constraints": [turned("hand", 0.3, 0.2, 4, turn=[0.001, 3e-3, 0, 1])]},
    ),
    "upside down, a little off": (
        "path",
        {"orientation_constraints": [turned("hand", 0.3, 0.2, 4, turn=[1, 3e-3, 0, 4e-3], **DESK)]},
    ),
    "a box along the way": (
        "path",
        {"position_constraints": [position("hand", CRATE, **DESK, target_point_offset={"z": 0.1})]},
    ),
    "both": (
        "path",
        {
            "name": "both",
            "joint_constraints": [],
            "orientation_constraints": [turned("fore", 0.3, 0.2, 4)],
            "position_constraints": [position("hand", CRATE)],
        },
    ),
}


@pytest.mark.parametrize("name", CONSTRAINTS)
def test_constraints_are_read_as_hdplan_reads_them(name: str, tmp_path: Path) -> None:
    end, content = CONSTRAINTS[name]
    request = {**REQUEST, **({"goal_constraints": [content]} if end == "goal" else {"path_constraints": content})}
    given = files(tmp_path, request=request)
    world = read(given).world
    check_equal(world, planned(*given))
    assert bool(world["path"]) == (end == "path")
    assert ("poses" in world["goal"][0]) == (end == "goal")


def test_an_axis_a_little_off_the_vertical_is_kept_within_moveits_tolerances() -> None:
    """However a link is turned whose axis is as far from up or down as a world allows, MoveIt's angles, intrinsic about
    x, y and z, are within the tolerance; and little is given away."""
    rng, frames = np.random.default_rng(0), SimpleNamespace(of=lambda *_: HERE)
    for _ in range(300):
        free, most = str(rng.choice(["x", "z"])), rng.uniform(0.02, 1.4, 3)
        lean, end = rng.uniform(0, 2 * np.pi), rng.choice([-1.0, 1.0])
        way = np.array([*(np.sin(rng.uniform(0, 9.9e-3)) * np.array([np.cos(lean), np.sin(lean)])), 0.0])
        wanted = turning(np.eye(3)["xyz".index(free)], way + [0, 0, end * np.sqrt(1 - way @ way)], rng)
        most["xyz".index(free)] = 4
        content = turned("hand", *most.tolist(), turn=wanted.as_quat().tolist())
        (found,) = path_of({"orientation_constraints": [content]}, frames)
        assert found["tolerance"] > min(*most, 1.5) - 0.01
        tilt, about = found["tolerance"] + found["off"], rng.uniform(0, 2 * np.pi)
        there = [np.sin(tilt) * np.cos(about), np.sin(tilt) * np.sin(about), np.cos(tilt)]
        angles = (wanted.inv() * turning(np.array(found["axis"]), np.array(there), rng)).as_euler("XYZ")
        assert (np.abs(angles) <= most + 1e-9).all()


def test_a_motion_is_proven_to_keep_an_axis_a_little_off_the_vertical(tmp_path: Path) -> None:
    """By its tolerance without the 2 mrad by which the axis is off: the link is tilted by 0.9 rad at the end."""
    for most, kept in ((0.9021, True), (0.9019, False)):
        path = {"orientation_constraints": [turned("fore", 1.4, most, 4, turn=[0, 0.001, 0, 1])]}
        given = files(tmp_path, request={**REQUEST, "path_constraints": path})
        if kept:
            assert "path" in hdplan.prove(given[0], given[1], *given[2:]).text.split("also proven: ")[1].split("\n")[0]
            continue
        with pytest.raises(NotProvenError, match=r"path\.upright"):
            hdplan.prove(given[0], given[1], *given[2:])
        reading = read(given)
        with pytest.raises(RejectedError, match=r"path\.upright"):
            check_claim(World(reading.world, {}), "path")


def turning(axis: Any, way: Any, rng: np.random.Generator) -> Rotation:
    """A rotation, one of many, that turns one unit vector into another."""
    return Rotation.from_rotvec(rng.uniform(-3, 3) * way) * Rotation.align_vectors(way[None], axis[None])[0]


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
        {"orientation_constraints": [turned("hand", 0.3, 0.2, 4, turn=[0.006, 0, 0, 1])]}, "up or down",
    ),
    "an axis as far off as it may be tilted": (
        "request", "path_constraints",
        {"orientation_constraints": [turned("hand", 0.001, 0.2, 4, turn=[0.001, 0, 0, 1])]}, "up or down",
    ),
    "the robot's own group": ("robot", "robot.group", "two", "robot's own"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_unsupported_input_is_named(case: str, tmp_path: Path) -> None:
    which, path, value, words = REFUSED[case]
    given = files(tmp_path, **{which: put(GOOD[which], path, value)})
    with pytest.raises(RejectedError, match=words):
        read(given)


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
    given = files(tmp_path, **{which: content})
    with pytest.raises(RejectedError, match=words):
        read(given)
    with pytest.raises(HdplanError, match=words):
        planned(*given)


def test_a_goal_in_the_frame_of_an_object_is_refused(tmp_path: Path) -> None:
    goal = {"position_constraints": [position("hand", BALL, **DESK)]}
    scene = put(SCENE, OBJECTS + ".0.id", "room")  # after which nothing is given in the frame of that name
    scene = put(scene, OBJECTS + ".1.header.frame_id", "")
    given = files(tmp_path, scene=scene, request={**REQUEST, "goal_constraints": [goal]})
    with pytest.raises(RejectedError, match="the name of an object"):
        read(given)
    with pytest.raises(HdplanError, match="the name of an object"):
        planned(*given)


def test_a_link_of_the_name_world_that_is_elsewhere_is_not_the_world(tmp_path: Path) -> None:
    """MoveIt looks among links first; where the robot stands elsewhere, poses in that frame have two meanings."""
    for base, good in (({}, True), (ROBOT["base"], False)):
        given = files(
            tmp_path,
            scene=put(SCENE, OBJECTS + ".0.header", {"frame_id": "world"}),
            robot={"robot": {**ROBOT, "base": base}},
        )
        (tmp_path / "r.urdf").write_text(URDF.replace('"floor"', '"world"'))
        if good:
            check_equal(read(given).world, planned(*given))
            continue
        with pytest.raises(RejectedError, match="frame 'world'"):
            read(given)
        with pytest.raises(HdplanError, match="unknown frame 'world'"):
            planned(*given)


def test_an_octomap_is_taken_from_the_proof(tmp_path: Path) -> None:
    """Its cells are proven, but the checker does not read them itself, and says so first."""
    way = [0, -64, *[3, 0] * 14, 2, 0]  # down to one cell, at the origin
    octomap = {"octomap": {"binary": True, "id": "OcTree", "resolution": 0.1, "data": way}}
    octomap |= {"header": {"frame_id": "room"}, "origin": {"position": [1, 0, 2]}}
    given = files(tmp_path, scene=put(SCENE, "world.octomap", octomap))
    scene, motion, request, robot = given
    proof = hdplan.prove(scene, motion, request, robot).data
    verdict, world = check(scene, motion, proof, request, robot)
    assert verdict.text.startswith(
        'accepted in part; NOT read by the checker, but taken from the proof: "<octomap>" (octomap)'
    )
    assert kind_of(world["bodies"][-1]["shape"])[0] == "boxes"
    assert not verdict.whole
    with pytest.raises(RejectedError, match="octomap"):
        read(given)


def test_a_message_that_ros_prints(original: Any, tmp_path: Path) -> None:
    """With a byte order mark, in other words of YAML, and with `---` at its end."""
    given = files(tmp_path, scene="\ufeff" + yaml.safe_dump(SCENE) + "---\n", request=yaml.safe_dump(REQUEST) + "---")
    assert not outcome(original[1], given, read(given).hashes)
    check_equal(read(given).world, planned(*given))
    twice = files(tmp_path, scene=yaml.safe_dump(SCENE) + "---\nname: b\n")
    with pytest.raises(RejectedError):
        read(twice)


TEXT = """a cell
* desk top
1.2 0.1 0
0 0 0.6 0.8
2
box
0.4 0.3 0.2
0.4 0.3 0
0 0 0 1
0 0 0 0
cylinder
0.05 0.3
0 0.2 0.3
0.6 0 0 0.8
0.5 0.5 0.5 1
1
rim
0 0 0.2
0 0 0 1
* ball
0 0 0
0 0 0 1
1
sphere
0.1
-1.5 1e-01 0.4
0 0 0 1
0 0 0 0
0
.
"""
OLD_TEXT = """
* ball
1
sphere
0.1
-1.5 0.1 0.4
0 0 0 1
0 0 0 0
.
"""


@pytest.mark.parametrize("text", [TEXT, OLD_TEXT, "empty\n.\n"])
def test_objects_that_rviz_exports(text: str, tmp_path: Path) -> None:
    """They are a scene, too; with another word they have hdplan's world, or one of both refuses."""
    scene, motion, request, robot = files(tmp_path)
    scene = scene.rename(tmp_path / "cell.scene")
    given = scene, motion, request, robot
    scene.write_text(text)
    check_equal(read(given).world, planned(*given))
    rng, both = np.random.default_rng(0), 0
    for _ in range(40):
        words = text.split(" ") if rng.integers(2) else text.split("\n")
        at = rng.integers(len(words))
        way = rng.integers(4)
        words[at : at + int(way > 0)] = [[words[at - 1]], [], ["1"], [f"{words[at]}5"]][way]
        scene.write_text((" " if "\n" in "".join(words) else "\n").join(words))
        try:
            own, world = planned(*given), read(given).world
        except (HdplanError, RejectedError):
            continue
        both += 1
        check_equal(world, own)
    assert both > 3


def test_other_spaces_than_those_of_ascii_are_in_no_number(tmp_path: Path) -> None:
    """Python splits words there; a program in C++ reads "0.1", and then nothing, or something else."""
    scene, motion, request, robot = files(tmp_path)
    scene = scene.rename(tmp_path / "cell.scene")
    for space in "\u00a0\u2003\u2028\x1c\x85":
        scene.write_text(TEXT.replace("1.2 0.1 0\n", f"1.2{space}0.1 0\n"))
        with pytest.raises(RejectedError):
            read((scene, motion, request, robot))
        with pytest.raises(HdplanError, match="but a number of a position is expected"):
            planned(scene, motion, request, robot)


# --- random changes ---

WORDS = [
    "a",
    "b",
    "c",
    "f",
    "base",
    "up",
    "hand",
    "finger",
    "desk",
    "cup",
    "ball",
    "room",
    "world",
    "",
    "/base",
    "arm",
    "r",
    "box",
]
VALUES: list[Any] = [0, 1, -1, 0.5, 1e-5, "1e-05", "2", "", True, False, [], {}, [0, 0, 0], [0, 0, 0, 1], [1.0]]
KEYS = [
    "header",
    "pose",
    "id",
    "operation",
    "meshes",
    "is_diff",
    "touch_links",
    "frame_id",
    "w",
    "x",
    "type",
    "weight",
    "zz",
]


def places(content: Any) -> Iterator[tuple[Any, Any]]:
    """Every container with each of its keys or indices."""
    for key in list(content) if isinstance(content, dict) else range(len(content)):
        yield content, key
        if isinstance(content[key], (dict, list)):
            yield from places(content[key])


def change(rng: np.random.Generator, content: Data) -> None:
    """Change one thing."""
    found = list(places(content))
    where, key = found[rng.integers(len(found))]
    old = where[key]

    def pick(values: list[Any]) -> Any:
        return copy.deepcopy(values[rng.integers(len(values))])

    ways: list[Callable[[], None]] = [lambda: where.__delitem__(key), lambda: where.__setitem__(key, pick(VALUES))]
    if isinstance(where, list):
        ways += [lambda: where.append(copy.deepcopy(old)), lambda: where.reverse()]
    if isinstance(old, dict):
        ways += [lambda: old.__setitem__(pick(KEYS), pick([*VALUES, *WORDS]))] * 2
    if type(old) is str:
        ways += [lambda: where.__setitem__(key, pick(WORDS))] * 4
    if type(old) is bool:
        ways += [lambda: where.__setitem__(key, not old)] * 4
    if type(old) in (int, float):
        ways += [lambda: where.__setitem__(key, old + float(rng.normal(scale=0.1)))] * 4
    ways[rng.integers(len(ways))]()


@pytest.mark.parametrize("count", [60, pytest.param(200, marks=pytest.mark.slow)])
def test_changed_files_have_hdplans_world_or_one_of_both_refuses(original: Any, tmp_path: Path, count: int) -> None:
    """Whatever is changed; and the old proof is accepted for them only where hdplan plans in the same world."""
    rng = np.random.default_rng(0)
    world = unpacked(original[1])[1]
    both = accepted = hdplans = checkers = 0
    given = files(tmp_path)
    for _ in range(count):
        messages = {"scene": copy.deepcopy(SCENE), "request": copy.deepcopy(REQUEST)}
        change(rng, messages["scene" if rng.random() < 0.7 else "request"])
        given[0].write_text(json.dumps(messages["scene"]))
        given[2].write_text(json.dumps(messages["request"]))
        own = reading = None
        try:
            own = planned(*given)
        except HdplanError:
            hdplans += 1
        try:
            reading = read(given)
        except RejectedError:
            checkers += 1
        if own is None or reading is None:
            continue
        both += 1
        check_equal(reading.world, own)
        if not outcome(original[1], given, reading.hashes):
            accepted += 1
            check_equal(world, own)
    assert min(both, hdplans, checkers) > count // 4
    assert count // 20 < accepted < both


@pytest.mark.skipif(not MBM.is_dir(), reason="the benchmark's files are not here")
@pytest.mark.parametrize("robot", ["panda", "ur5", "fetch", "baxter"])
def test_files_of_the_benchmark_are_read_as_hdplan_reads_them(robot: str, tmp_path: Path) -> None:
    folders = [x for x in sorted((MBM / robot).iterdir()) if any(x.glob("scene*.yaml"))]
    for scene in itertools.chain.from_iterable(sorted(x.glob("scene*.yaml"))[7:8] for x in folders):
        request, section = scene.with_name(scene.name.replace("scene", "request")), MBM / robot / "robot.yaml"
        setup = Setup.of(hdplan.load_scene(scene, request, section))
        ends = [setup.query.start, setup.query.goal]
        motion = tmp_path / "m.json"
        Trajectory(setup.robot.joint_names, ends).save(motion)
        if {x.name for x in setup.scene.obstacles} & {str(x.name) for x in setup.robot.model.frames}:
            continue
        reading = read_world(scene, motion, None, request, str(section))
        check_equal(reading.world, world_of(setup, Trajectory.load(motion)))
        assert not reading.taken
