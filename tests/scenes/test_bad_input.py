"""Bad input: one line that names the file, the field, what was found and what is allowed."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.shapes import Sphere
from hdplan.scenes.yaml_format.reader import load_scene

HEAD = "hdplan: 1\nrobot: {name: panda}\n"
BALL = "shape: {type: sphere, radius: 1}"
ENDS = "start: {state: default}\ngoal: {joints: [1, 2]}\n"


def error(file: Path, **also: Path | str) -> str:
    with pytest.raises(InputError) as caught:
        load_scene(file, **also)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 400 + len(str(file)) * 2
    return text


def refused(folder: Path, text: str) -> str:
    file = folder / "scene.yaml"
    file.write_text(text, encoding="utf-8")
    message = error(file)
    assert message.startswith(f"{file}: ")
    return message.removeprefix(f"{file}: ")


def shape(text: str) -> str:
    return f"{HEAD}{ENDS}obstacles: [{{name: a, shape: {{type: sphere, radius: 1}}}}, {{name: b, shape: {{{text}}}}}]\n"


def pose(text: str) -> str:
    return f"{HEAD}{ENDS}obstacles: [{{shape: {{type: sphere, radius: 1}}, pose: {{{text}}}}}]\n"


def attached(text: str) -> str:
    return f"{shape('type: sphere, radius: 1')}attached: [{text}]\n"


def robot(text: str) -> str:
    return f"hdplan: 1\nrobot: {{{text}}}\n{ENDS}"


def start(text: str) -> str:
    return f"{HEAD}start: {text}\ngoal: {{state: default}}\n"


def goal(text: str) -> str:
    return f"{HEAD}start: {{state: default}}\ngoal: {text}\n"


def aim(text: str) -> str:
    return goal(f"{{pose: {{link: hand, {text}}}}}")


def planner(text: str) -> str:
    return f"{HEAD}{ENDS}planner: {{{text}}}\n"


CASES = {
    # the file as YAML
    "empty": ("", ["is empty"]),
    "only comments": ("# nothing\n", ["is empty"]),
    "a list": ("- 1\n", ["mapping of sections", "a list of 1"]),
    "a text": ("hello", ["mapping of sections", "'hello'"]),
    "syntax": ("hdplan: 1\nrobot: {name: panda\nstart: [\n", ["line 3", "YAML syntax"]),
    "tab": ("hdplan: 1\nrobot:\n\tname: panda\n", ["line 3", "YAML syntax"]),
    "unknown tag": ("hdplan: !what 1\n", ["line 1", "YAML syntax", "!what"]),
    "control character": ("hdplan: 1\nrobot: \x07\n", ["YAML syntax", "line 2"]),
    "two documents": ("hdplan: 1\n---\nhdplan: 1\n", ["line 2", "second document"]),
    "two documents, the second cut off": ("hdplan: 1\n---\n#", ["line 2", "second document"]),
    "no such day": ("hdplan: 2026-99-99\n", ["YAML syntax", "month"]),
    "key twice": (HEAD + ENDS + "start: {state: x}\n", ["line 5", "'start'", "twice"]),
    "key twice inside": (shape("type: box, size: [1, 1, 1], size: [1, 1, 1]"), ["line 5", "'size'", "twice"]),
    "key that is no name": (HEAD + ENDS + "1: 2\n", ["keys must be names", "1"]),
    # version and sections
    "no version": ("robot: {name: panda}\n" + ENDS, ["'hdplan: 1' is missing"]),
    "other version": ("hdplan: 2\nrobot: {name: panda}\n" + ENDS, ["hdplan: ", "must be 1", "found 2"]),
    "version as text": ("hdplan: '1'\n" + ENDS, ["hdplan: ", "must be 1", "'1'"]),
    "version true": ("hdplan: true\n" + ENDS, ["hdplan: ", "must be 1", "true"]),
    "unknown section": (HEAD + ENDS + "obstacle: []\n", ["unknown key 'obstacle'", "'obstacles'"]),
    "unknown section, nothing near": (
        HEAD + ENDS + "xyz: 1\n",
        ["unknown key 'xyz'", "allowed: attached, from_request, goal, hdplan, job, limits, obstacles"],
    ),
    "no robot": ("hdplan: 1\n" + ENDS, ["'robot' is missing"]),
    "no start": (HEAD + "goal: {joints: [1]}\n", ["'start' is missing"]),
    "no goal": (HEAD + "start: {joints: [1]}\n", ["'goal' is missing"]),
    # robot
    "robot as text": ("hdplan: 1\nrobot: panda\n" + ENDS, ["robot: ", "must be a mapping", "'panda'"]),
    "robot without a name": (robot("locked: {}"), ["robot: ", "either 'name' or 'urdf'", "neither"]),
    "robot with name and urdf": (robot("name: panda, urdf: x"), ["robot: ", "either 'name' or 'urdf'", "both"]),
    "robot with name and srdf": (robot("name: panda, srdf: x"), ["robot.srdf: ", "goes with 'urdf'"]),
    "robot name a number": (robot("name: 5"), ["robot.name: ", "must be a text", "found 5"]),
    "robot name blank": (robot("name: ' '"), ["robot.name: ", "must be a text"]),
    "urdf missing": (robot("urdf: arm.urdf"), ["robot.urdf: ", "'arm.urdf' does not exist"]),
    "urdf a directory": (robot("urdf: ."), ["robot.urdf: ", "'.' is not a file"]),
    "package_dirs missing": (
        robot("urdf: scene.yaml, package_dirs: [away]"),
        ["robot.package_dirs[0]: ", "'away' does not exist"],
    ),
    "package_dirs a text": (robot("urdf: scene.yaml, package_dirs: away"), ["robot.package_dirs: ", "list"]),
    "misspelt robot key": (robot("name: panda, lockd: {}"), ["robot: ", "'lockd'", "'locked'"]),
    "locked to text": (robot("name: panda, locked: {finger: open}"), ["robot.locked.finger: ", "number", "'open'"]),
    "locked to nothing": (robot("name: panda, locked: {finger: }"), ["robot.locked.finger: ", "number", "nothing"]),
    "pair of three": (
        robot("name: panda, ignore_pairs: [[a, b, c]]"),
        ["robot.ignore_pairs[0]: ", "list of 2", "list of 3"],
    ),
    "pair of one link": (robot("name: panda, ignore_pairs: [[a, a]]"), ["robot.ignore_pairs[0]: ", "different", "'a'"]),
    # held objects
    "attached a mapping": (HEAD + ENDS + "attached: {a: 1}\n", ["attached: ", "list of held objects", "mapping"]),
    "held by nothing": (attached("{shape: {type: sphere, radius: 1}}"), ["attached[0]: ", "'link' is missing"]),
    "held without shape": (attached("{link: hand}"), ["attached[0]: ", "'shape' is missing"]),
    "held by a number": (attached(f"{{link: 7, {BALL}}}"), ["attached[0].link: ", "must be a text", "found 7"]),
    "held with a bad size": (
        attached("{link: hand, shape: {type: sphere, radius: -1}}"),
        ["attached[0].shape.radius: ", "greater than 0 [m]", "found -1"],
    ),
    "held object misspelt": (attached(f"{{lnk: hand, {BALL}}}"), ["attached[0]: ", "'lnk'", "'link'"]),
    "touch_links a text": (
        attached(f"{{link: hand, {BALL}, touch_links: finger}}"),
        ["attached[0].touch_links: ", "list of link names", "'finger'"],
    ),
    "held named as an obstacle": (attached(f"{{name: b, link: hand, {BALL}}}"), ["attached[0]: ", "'b'", "obstacle"]),
    "held names twice": (
        attached(f"{{name: c, link: hand, {BALL}}}, {{name: c, link: hand, {BALL}}}"),
        ["attached[1]: ", "'c'", "earlier held object", "differ"],
    ),
    # obstacles
    "obstacles a mapping": (HEAD + ENDS + "obstacles: {a: 1}\n", ["obstacles: ", "list of obstacles", "mapping"]),
    "obstacle without shape": (HEAD + ENDS + "obstacles: [{name: a}]\n", ["obstacles[0]: ", "'shape' is missing"]),
    "names twice": (
        shape("type: sphere, radius: 1").replace("name: b", "name: a"),
        ["obstacles[1]: ", "'a'", "differ"],
    ),
    "shape without type": (shape("radius: 1"), ["obstacles[1].shape: ", "'type' is missing"]),
    "misspelt type": (shape("type: sphre, radius: 1"), ["obstacles[1].shape.type: ", "'sphre'", "'sphere'"]),
    "type a number": (shape("type: 1, radius: 1"), ["obstacles[1].shape.type: ", "box, sphere", "found 1"]),
    "misspelt size": (shape("type: sphere, radus: 1"), ["obstacles[1].shape: ", "'radus'", "'radius'"]),
    "key of another shape": (
        shape("type: sphere, radius: 1, length: 1"),
        ["obstacles[1].shape: ", "'length'", "allowed"],
    ),
    "size missing": (shape("type: cylinder, radius: 1"), ["obstacles[1].shape: ", "'length' is missing"]),
    "negative radius": (
        shape("type: sphere, radius: -0.1"),
        ["obstacles[1].shape.radius: ", "greater than 0 [m]", "-0.1"],
    ),
    "zero radius": (shape("type: sphere, radius: 0"), ["obstacles[1].shape.radius: ", "greater than 0", "found 0"]),
    "zero size": (shape("type: box, size: [1, 0, 1]"), ["obstacles[1].shape.size[1]: ", "greater than 0", "found 0"]),
    "two sizes": (shape("type: box, size: [1, 1]"), ["obstacles[1].shape.size: ", "list of 3", "list of 2"]),
    "size a number": (shape("type: box, size: 1"), ["obstacles[1].shape.size: ", "list of 3", "found 1"]),
    "negative length": (
        shape("type: capsule, radius: 1, length: -1"),
        ["obstacles[1].shape.length: ", "at least 0", "-1"],
    ),
    "zero length": (shape("type: cylinder, radius: 1, length: 0"), ["obstacles[1].shape.length: ", "greater than 0"]),
    "truth value": (shape("type: sphere, radius: true"), ["obstacles[1].shape.radius: ", "number", "found true"]),
    "not a number": (shape("type: sphere, radius: .nan"), ["obstacles[1].shape.radius: ", "finite number", "nan"]),
    "infinite": (shape("type: sphere, radius: .inf"), ["obstacles[1].shape.radius: ", "finite number", "inf"]),
    "integer beyond floats": (
        shape(f"type: sphere, radius: {10**400}"),
        ["obstacles[1].shape.radius: ", "finite number"],
    ),
    "1e-3": (shape("type: sphere, radius: 1e-3"), ["obstacles[1].shape.radius: ", "'1e-3'", "write 1.0e-3"]),
    "1.5e3": (shape("type: sphere, radius: 1.5e3"), ["obstacles[1].shape.radius: ", "'1.5e3'", "write 1.5e+3"]),
    "number in quotes": (shape("type: sphere, radius: '0.5'"), ["obstacles[1].shape.radius: ", "0.5 without quotes"]),
    "no points": (shape("type: points, points: []"), ["obstacles[1].shape.points: ", "four or more", "found 0"]),
    "flat points": (
        shape("type: points, points: [[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]"),
        ["obstacles[1].shape.points: ", "one plane"],
    ),
    "one point, many times": (
        shape("type: points, points: [[1, 1, 1], [1, 1, 1], [1, 1, 1], [1, 1, 1]]"),
        ["one plane"],
    ),
    "point of two": (shape("type: points, points: [[0, 1]]"), ["obstacles[1].shape.points[0]: ", "list of 3"]),
    "mesh missing": (shape("type: mesh, file: part.obj"), ["obstacles[1].shape.file: ", "'part.obj' does not exist"]),
    "mesh mirrored": (
        shape("type: mesh, file: scene.yaml, scale: [1, -1, 1]"),
        ["obstacles[1].shape.scale[1]: ", "-1"],
    ),
    # poses
    "both rotations": (pose("rpy: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]"), ["obstacles[0].pose: ", "both"]),
    "far from unit": (
        pose("quaternion_xyzw: [0, 0, 0, 2]"),
        ["obstacles[0].pose.quaternion_xyzw: ", "unit", "length 2"],
    ),
    "just too far from unit": (pose("quaternion_xyzw: [0, 0, 0, 1.011]"), ["unit", "length 1.011"]),
    "zero quaternion": (pose("quaternion_xyzw: [0, 0, 0, 0]"), ["unit", "length 0"]),
    "quaternion of three": (pose("quaternion_xyzw: [0, 0, 1]"), ["obstacles[0].pose.quaternion_xyzw: ", "list of 4"]),
    "position not finite": (pose("position: [0, .inf, 0]"), ["obstacles[0].pose.position[1]: ", "finite", "inf"]),
    "misspelt pose key": (
        pose("quaternion: [0, 0, 0, 1]"),
        ["obstacles[0].pose: ", "'quaternion'", "'quaternion_xyzw'"],
    ),
    # start and goal
    "start a list": (start("[1, 2]"), ["start: ", "mapping", "list of 2"]),
    "start empty": (start("{}"), ["start: ", "either 'joints' or 'state'", "neither"]),
    "start both": (start("{joints: [1], state: a}"), ["start: ", "either 'joints' or 'state'", "both"]),
    "no joints": (start("{joints: []}"), ["start.joints: ", "list of joint values", "list of 0"]),
    "joint a text": (start("{joints: [0, a]}"), ["start.joints[1]: ", "number [rad or m]", "'a'"]),
    "named joint nothing": (start("{joints: {j1: }}"), ["start.joints.j1: ", "number", "nothing"]),
    "joints a number": (start("{joints: 1}"), ["start.joints: ", "list of joint values", "found 1"]),
    "state a number": (start("{state: 3}"), ["start.state: ", "text", "found 3"]),
    "goal empty": (goal("{}"), ["goal: ", "exactly one of the keys joints, state, pose, poses", "none"]),
    "goal twice": (goal("{state: a, pose: {link: b}}"), ["goal: ", "exactly one", "'state' and 'pose'"]),
    "misspelt pose of the goal": (goal("{pos: {}}"), ["goal: ", "'pos'", "did you mean 'pose'"]),
    "start as a pose": (start("{pose: {link: a}}"), ["start: ", "unknown key 'pose'"]),
    "no poses": (goal("{poses: []}"), ["goal.poses: ", "one or more", "list of 0"]),
    "poses as a mapping": (goal("{poses: {link: a}}"), ["goal.poses: ", "list of poses", "mapping"]),
    "one of several joint goals is none": (goal("{joints: [[0, 1], 3]}"), ["goal.joints[1]: ", "found 3"]),
    "no pose of all": (goal("{all: []}"), ["goal.all: ", "two or more", "list of 0"]),
    "one pose of all": (
        goal("{all: [{pose: {link: a, position: [0, 0, 0], free_rotation: all}}]}"),
        ["goal.all: ", "two or more", "list of 1"],
    ),
    "not a pose of all": (goal("{all: [{joints: [0]}, {joints: [0]}]}"), ["goal.all[0]: ", "'joints'"]),
    "a pose of all without a link": (
        goal(
            "{all: [{pose: {link: a, position: [0, 0, 0], free_rotation: all}}, "
            "{pose: {position: [0, 0, 0], free_rotation: all}}]}"
        ),
        ["goal.all[1].pose: ", "names no link"],
    ),
    "two poses of one link": (
        goal(
            "{all: [{pose: {link: a, position: [0, 0, 0], free_rotation: all}}, "
            "{pose: {link: a, position: [0, 0, 0], free_rotation: all}}]}"
        ),
        ["goal.all[1].pose: ", "'a' has a pose already"],
    ),
    "no position": (goal("{pose: {link: a}}"), ["goal.pose: ", "'position' is missing"]),
    "no orientation": (aim("position: [0, 0, 0]"), ["goal.pose: ", "no orientation", "free_rotation: all"]),
    "two orientations": (
        aim("position: [0, 0, 0], rpy: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]"),
        ["goal.pose: ", "both 'quaternion_xyzw' and 'rpy'"],
    ),
    "orientation of any turn": (
        aim("position: [0, 0, 0], rpy: [0, 0, 0], free_rotation: all"),
        ["goal.pose.rpy: ", "free_rotation: all", "leave it out"],
    ),
    "misspelt axis": (
        aim("position: [0, 0, 0], rpy: [0, 0, 0], free_rotation: zz"),
        ["goal.pose.free_rotation: ", "'zz'", "did you mean 'z'"],
    ),
    "misspelt tolerance": (
        aim("position: [0, 0, 0], rpy: [0, 0, 0], position_tolerence: 1"),
        ["goal.pose: ", "'position_tolerence'", "did you mean 'position_tolerance'"],
    ),
    "no tolerance at all": (
        aim("position: [0, 0, 0], rpy: [0, 0, 0], orientation_tolerance: 0"),
        ["goal.pose.orientation_tolerance: ", "greater than 0", "found 0"],
    ),
    "tolerance of a turn": (
        aim("position: [0, 0, 0], rpy: [0, 0, 0], orientation_tolerance: 4"),
        ["goal.pose.orientation_tolerance: ", "[rad]", "found 4"],
    ),
    # planner
    "misspelt setting": (planner("waypoint: 10"), ["planner: ", "'waypoint'", "'waypoints'"]),
    "too few waypoints": (planner("waypoints: 2"), ["planner.waypoints: ", "whole number 3 to 1000", "found 2"]),
    "waypoints not whole": (planner("waypoints: 10.0"), ["planner.waypoints: ", "whole number", "10.0"]),
    "waypoints true": (planner("waypoints: true"), ["planner.waypoints: ", "whole number", "true"]),
    "negative clearance": (planner("clearance: -0.01"), ["planner.clearance: ", "0 to 1", "-0.01"]),
    "clearance as text": (planner("clearance: 5mm"), ["planner.clearance: ", "number", "'5mm'"]),
    "long value": (planner(f"clearance: {'x' * 1000}"), ["planner.clearance: ", "..."]),
}


@pytest.mark.core
@pytest.mark.parametrize("case", CASES)
def test_refused_in_one_clear_line(tmp_path: Path, case: str) -> None:
    text, fragments = CASES[case]
    message = refused(tmp_path, text)
    for fragment in fragments:
        assert fragment in message


def test_missing_file(tmp_path: Path) -> None:
    assert error(tmp_path / "no.yaml").startswith(f"{tmp_path / 'no.yaml'}: no such file")


def test_directory(tmp_path: Path) -> None:
    assert error(tmp_path) == f"{tmp_path}: is a directory, not a file"


def test_not_utf8(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_bytes("hdplan: 1 # Größe".encode("latin-1"))
    assert "is not UTF-8 text (byte 14 is 0xf6)" in error(file)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="the superuser may read everything")
def test_unreadable(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.touch(mode=0o000)
    assert "cannot be read (Permission denied)" in error(file)


def test_request_goes_with_moveit_scenes_only(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(HEAD + ENDS, encoding="utf-8")
    assert "not a MoveIt planning scene" in error(file, request=file)


@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        ("name: panda\n", ["unknown key 'name'", "allowed: ", "robot"]),
        ("hdplan: 1\n", ["'robot' is missing"]),
        ("robot: {nme: panda}\n", ["robot: ", "'nme'", "'name'"]),
    ],
)
def test_robot_file(tmp_path: Path, text: str, fragments: list[str]) -> None:
    file, other = tmp_path / "scene.yaml", tmp_path / "robot.yaml"
    file.write_text(HEAD + ENDS, encoding="utf-8")
    other.write_text(text, encoding="utf-8")
    message = error(file, robot=other)
    assert message.startswith(f"{other}: ")
    for fragment in fragments:
        assert fragment in message


def test_robot_file_missing(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(HEAD + ENDS, encoding="utf-8")
    assert error(file, robot="no/robot.yaml") == "no/robot.yaml: no such file"
    assert error(file, robot="robot.yaml") == "robot.yaml: no such file"


@pytest.mark.parametrize("change", [str.upper, str.title, str.swapcase, lambda name: name[1:], lambda name: f"{name}s"])
def test_a_name_is_found_again_whatever_its_case(change: Callable[[str], str]) -> None:
    names = ("panda", "ur5", "xarm7", "Jaco", "KUKA")
    for name in names:
        assert nearest(change(name), names) == f" (did you mean '{name}'?)"


@pytest.mark.parametrize("array", [np.array(0.1), np.array([0.1]), np.zeros((2, 3))])
def test_an_array_where_a_number_belongs_is_called_one(array: Any) -> None:
    with pytest.raises(InputError, match=re.escape(f"found an array of shape {array.shape}")):
        Sphere(array)
