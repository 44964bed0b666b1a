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
FREE = "position: [0, 0, 0], free_rotation: all"
ENDS = "start: {state: default}\ngoal: {joints: [1, 2]}\n"


def error(file: Path, **also: Path | str) -> str:
    with pytest.raises(InputError) as caught:
        load_scene(file, **also)
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 400 + len(str(file)) * 2
    return text


Case = tuple[str, ...]  # a scene file, and parts of its message


def scene(section: str, field: str, *parts: str) -> Case:
    """A scene with one section changed, whose name begins the field."""
    name = section.partition(":")[0]
    usual = {"robot": "robot: {name: panda}", "start": "start: {state: default}", "goal": "goal: {joints: [1, 2]}"}
    text = "".join(f"{line}\n" for line in ({**usual, name: section}).values())
    return f"hdplan: 1\n{text}", name + field, *parts


def shape(text: str, field: str, *parts: str) -> Case:
    obstacles = f"obstacles: [{{name: a, {BALL}}}, {{name: b, shape: {{{text}}}}}]"
    return scene(obstacles, f"[1].shape{field}", *parts)


def pose(text: str, field: str, *parts: str) -> Case:
    return scene(f"obstacles: [{{{BALL}, pose: {{{text}}}}}]", f"[0].pose{field}", *parts)


def attached(text: str, *parts: str) -> Case:
    return scene(f"attached: [{text}]\nobstacles: [{{{BALL}}}, {{name: b, {BALL}}}]", *parts)


def robot(text: str, *parts: str) -> Case:
    return scene(f"robot: {{{text}}}", *parts)


def aim(text: str, field: str, *parts: str) -> Case:
    return scene(f"goal: {{pose: {{link: hand, position: [0, 0, 0], {text}}}}}", f".pose{field}", *parts)


CASES = {
    # the file as YAML
    "empty": ("", "is empty"),
    "only comments": ("# nothing\n", "is empty"),
    "a list": ("- 1\n", "mapping of sections", "a list of 1"),
    "a text": ("hello", "mapping of sections", "'hello'"),
    "syntax": ("hdplan: 1\nrobot: {name: panda\nstart: [\n", "line 3", "YAML syntax"),
    "tab": ("hdplan: 1\nrobot:\n\tname: panda\n", "line 3", "YAML syntax"),
    "unknown tag": ("hdplan: !what 1\n", "line 1", "YAML syntax", "!what"),
    "control character": ("hdplan: 1\nrobot: \x07\n", "YAML syntax", "line 2"),
    "two documents": ("hdplan: 1\n---\nhdplan: 1\n", "line 2", "second document"),
    "two documents, the second cut off": ("hdplan: 1\n---\n#", "line 2", "second document"),
    "no such day": ("hdplan: 2026-99-99\n", "YAML syntax", "month"),
    "key twice": (HEAD + ENDS + "start: {state: x}\n", "line 5", "'start'", "twice"),
    "key twice inside": (HEAD + ENDS + f"attached: [{{{BALL}, {BALL}}}]\n", "line 5", "'shape'", "twice"),
    "key that is no name": (HEAD + ENDS + "1: 2\n", "keys must be names", "1"),
    # version and sections
    "no version": ("robot: {name: panda}\n" + ENDS, "'hdplan: 1' is missing"),
    "other version": ("hdplan: 2\nrobot: {name: panda}\n" + ENDS, "hdplan: ", "must be 1", "found 2"),
    "version as text": ("hdplan: '1'\n" + ENDS, "hdplan: ", "must be 1", "'1'"),
    "version true": ("hdplan: true\n" + ENDS, "hdplan: ", "must be 1", "true"),
    "unknown section": (HEAD + ENDS + "obstacle: []\n", "unknown key 'obstacle'", "'obstacles'"),
    "unknown section, nothing near": (
        HEAD + ENDS + "xyz: 1\n",
        "unknown key 'xyz'",
        "allowed: attached, from_request, goal, hdplan, job, limits, obstacles",
    ),
    "no robot": ("hdplan: 1\n" + ENDS, "'robot' is missing"),
    "no start": (HEAD + "goal: {joints: [1]}\n", "'start' is missing"),
    "no goal": (HEAD + "start: {joints: [1]}\n", "'goal' is missing"),
    # robot
    "robot as text": ("hdplan: 1\nrobot: panda\n" + ENDS, "robot: ", "must be a mapping", "'panda'"),
    "robot without a name": robot("locked: {}", ": ", "either 'name' or 'urdf'", "neither"),
    "robot with name and urdf": robot("name: panda, urdf: x", ": ", "either 'name' or 'urdf'", "both"),
    "robot with name and srdf": robot("name: panda, srdf: x", ".srdf: ", "goes with 'urdf'"),
    "robot name a number": robot("name: 5", ".name: ", "must be a text", "found 5"),
    "robot name blank": robot("name: ' '", ".name: ", "must be a text"),
    "urdf missing": robot("urdf: arm.urdf", ".urdf: ", "'arm.urdf' does not exist"),
    "urdf a directory": robot("urdf: .", ".urdf: ", "'.' is not a file"),
    "package_dirs missing": robot(
        "urdf: scene.yaml, package_dirs: [away]", ".package_dirs[0]: ", "'away' does not exist"
    ),
    "package_dirs a text": robot("urdf: scene.yaml, package_dirs: away", ".package_dirs: ", "list"),
    "misspelt robot key": robot("name: panda, lockd: {}", ": ", "'lockd'", "'locked'"),
    "locked to text": robot("name: panda, locked: {finger: open}", ".locked.finger: ", "number", "'open'"),
    "locked to nothing": robot("name: panda, locked: {finger: }", ".locked.finger: ", "number", "nothing"),
    "pair of three": robot("name: panda, ignore_pairs: [[a, b, c]]", ".ignore_pairs[0]: ", "list of 2", "list of 3"),
    "pair of one link": robot("name: panda, ignore_pairs: [[a, a]]", ".ignore_pairs[0]: ", "different", "'a'"),
    # held objects
    "attached a mapping": scene("attached: {a: 1}", ": ", "list of held objects", "mapping"),
    "held by nothing": attached("{shape: {type: sphere, radius: 1}}", "[0]: ", "'link' is missing"),
    "held without shape": attached("{link: hand}", "[0]: ", "'shape' is missing"),
    "held by a number": attached(f"{{link: 7, {BALL}}}", "[0].link: ", "must be a text", "found 7"),
    "held with a bad size": attached(
        "{link: hand, shape: {type: sphere, radius: -1}}", "[0].shape.radius: ", "greater than 0 [m]", "found -1"
    ),
    "held object misspelt": attached(f"{{lnk: hand, {BALL}}}", "[0]: ", "'lnk'", "'link'"),
    "touch_links a text": attached(
        f"{{link: hand, {BALL}, touch_links: finger}}", "[0].touch_links: ", "list of link names", "'finger'"
    ),
    "held named as an obstacle": attached(f"{{name: b, link: hand, {BALL}}}", "[0]: ", "'b'", "obstacle"),
    "held names twice": attached(
        f"{{name: c, link: hand, {BALL}}}, {{name: c, link: hand, {BALL}}}",
        "[1]: ",
        "'c'",
        "earlier held object",
        "differ",
    ),
    # obstacles
    "obstacles a mapping": scene("obstacles: {a: 1}", ": ", "list of obstacles", "mapping"),
    "obstacle without shape": scene("obstacles: [{name: a}]", "[0]: ", "'shape' is missing"),
    "names twice": scene(f"obstacles: [{{name: a, {BALL}}}, {{name: a, {BALL}}}]", "[1]: ", "'a'", "differ"),
    "shape without type": shape("radius: 1", ": ", "'type' is missing"),
    "misspelt type": shape("type: sphre, radius: 1", ".type: ", "'sphre'", "'sphere'"),
    "type a number": shape("type: 1, radius: 1", ".type: ", "box, sphere", "found 1"),
    "misspelt size": shape("type: sphere, radus: 1", ": ", "'radus'", "'radius'"),
    "key of another shape": shape("type: sphere, radius: 1, length: 1", ": ", "'length'", "allowed"),
    "size missing": shape("type: cylinder, radius: 1", ": ", "'length' is missing"),
    "negative radius": shape("type: sphere, radius: -0.1", ".radius: ", "greater than 0 [m]", "-0.1"),
    "zero radius": shape("type: sphere, radius: 0", ".radius: ", "greater than 0", "found 0"),
    "zero size": shape("type: box, size: [1, 0, 1]", ".size[1]: ", "greater than 0", "found 0"),
    "two sizes": shape("type: box, size: [1, 1]", ".size: ", "list of 3", "list of 2"),
    "size a number": shape("type: box, size: 1", ".size: ", "list of 3", "found 1"),
    "negative length": shape("type: capsule, radius: 1, length: -1", ".length: ", "at least 0", "-1"),
    "zero length": shape("type: cylinder, radius: 1, length: 0", ".length: ", "greater than 0"),
    "truth value": shape("type: sphere, radius: true", ".radius: ", "number", "found true"),
    "not a number": shape("type: sphere, radius: .nan", ".radius: ", "finite number", "nan"),
    "infinite": shape("type: sphere, radius: .inf", ".radius: ", "finite number", "inf"),
    "integer beyond floats": shape(f"type: sphere, radius: {10**400}", ".radius: ", "finite number"),
    "1e-3": shape("type: sphere, radius: 1e-3", ".radius: ", "'1e-3'", "write 1.0e-3"),
    "1.5e3": shape("type: sphere, radius: 1.5e3", ".radius: ", "'1.5e3'", "write 1.5e+3"),
    "number in quotes": shape("type: sphere, radius: '0.5'", ".radius: ", "0.5 without quotes"),
    "no points": shape("type: points, points: []", ".points: ", "four or more", "found 0"),
    "flat points": shape(
        "type: points, points: [[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]", ".points: ", "one plane"
    ),
    "one point, many times": shape(
        "type: points, points: [[1, 1, 1], [1, 1, 1], [1, 1, 1], [1, 1, 1]]", ".points: ", "one plane"
    ),
    "point of two": shape("type: points, points: [[0, 1]]", ".points[0]: ", "list of 3"),
    "mesh missing": shape("type: mesh, file: part.obj", ".file: ", "'part.obj' does not exist"),
    "mesh mirrored": shape("type: mesh, file: scene.yaml, scale: [1, -1, 1]", ".scale[1]: ", "-1"),
    # poses
    "both rotations": pose("rpy: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]", ": ", "both"),
    "far from unit": pose("quaternion_xyzw: [0, 0, 0, 2]", ".quaternion_xyzw: ", "unit", "length 2"),
    "just too far from unit": pose("quaternion_xyzw: [0, 0, 0, 1.011]", ".quaternion_xyzw: ", "unit", "length 1.011"),
    "zero quaternion": pose("quaternion_xyzw: [0, 0, 0, 0]", ".quaternion_xyzw: ", "unit", "length 0"),
    "quaternion of three": pose("quaternion_xyzw: [0, 0, 1]", ".quaternion_xyzw: ", "list of 4"),
    "position not finite": pose("position: [0, .inf, 0]", ".position[1]: ", "finite", "inf"),
    "misspelt pose key": pose("quaternion: [0, 0, 0, 1]", ": ", "'quaternion'", "'quaternion_xyzw'"),
    # start and goal
    "start a list": scene("start: [1, 2]", ": ", "mapping", "list of 2"),
    "start empty": scene("start: {}", ": ", "either 'joints' or 'state'", "neither"),
    "start both": scene("start: {joints: [1], state: a}", ": ", "either 'joints' or 'state'", "both"),
    "no joints": scene("start: {joints: []}", ".joints: ", "list of joint values", "list of 0"),
    "joint a text": scene("start: {joints: [0, a]}", ".joints[1]: ", "number [rad or m]", "'a'"),
    "named joint nothing": scene("start: {joints: {j1: }}", ".joints.j1: ", "number", "nothing"),
    "joints a number": scene("start: {joints: 1}", ".joints: ", "list of joint values", "found 1"),
    "state a number": scene("start: {state: 3}", ".state: ", "text", "found 3"),
    "goal empty": scene("goal: {}", ": ", "exactly one of the keys joints, state, pose, poses", "none"),
    "goal twice": scene("goal: {state: a, pose: {link: b}}", ": ", "exactly one", "'state' and 'pose'"),
    "misspelt pose of the goal": scene("goal: {pos: {}}", ": ", "'pos'", "did you mean 'pose'"),
    "start as a pose": scene("start: {pose: {link: a}}", ": ", "unknown key 'pose'"),
    "no poses": scene("goal: {poses: []}", ".poses: ", "one or more", "list of 0"),
    "poses as a mapping": scene("goal: {poses: {link: a}}", ".poses: ", "list of poses", "mapping"),
    "one of several joint goals is none": scene("goal: {joints: [[0, 1], 3]}", ".joints[1]: ", "found 3"),
    "no pose of all": scene("goal: {all: []}", ".all: ", "two or more", "list of 0"),
    "one pose of all": scene(f"goal: {{all: [{{pose: {{link: a, {FREE}}}}}]}}", ".all: ", "two or more", "list of 1"),
    "not a pose of all": scene("goal: {all: [{joints: [0]}, {joints: [0]}]}", ".all[0]: ", "'joints'"),
    "a pose of all without a link": scene(
        f"goal: {{all: [{{pose: {{link: a, {FREE}}}}}, {{pose: {{{FREE}}}}}]}}", ".all[1].pose: ", "names no link"
    ),
    "two poses of one link": scene(
        f"goal: {{all: [{', '.join([f'{{pose: {{link: a, {FREE}}}}}'] * 2)}]}}", ".all[1].pose: ", "has a pose already"
    ),
    "no position": scene("goal: {pose: {link: a}}", ".pose: ", "'position' is missing"),
    "no orientation": aim("", ": ", "no orientation", "free_rotation: all"),
    "two orientations": aim("rpy: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]", ": ", "both 'quaternion_xyzw' and 'rpy'"),
    "orientation of any turn": aim(
        "rpy: [0, 0, 0], free_rotation: all", ".rpy: ", "free_rotation: all", "leave it out"
    ),
    "misspelt axis": aim("rpy: [0, 0, 0], free_rotation: zz", ".free_rotation: ", "'zz'", "did you mean 'z'"),
    "misspelt tolerance": aim(
        "rpy: [0, 0, 0], position_tolerence: 1", ": ", "'position_tolerence'", "did you mean 'position_tolerance'"
    ),
    "no tolerance at all": aim(
        "rpy: [0, 0, 0], orientation_tolerance: 0", ".orientation_tolerance: ", "greater than 0", "found 0"
    ),
    "tolerance of a turn": aim(
        "rpy: [0, 0, 0], orientation_tolerance: 4", ".orientation_tolerance: ", "[rad]", "found 4"
    ),
    # planner
    "misspelt setting": scene("planner: {waypoint: 10}", ": ", "'waypoint'", "'waypoints'"),
    "too few waypoints": scene("planner: {waypoints: 2}", ".waypoints: ", "whole number 3 to 1000", "found 2"),
    "waypoints not whole": scene("planner: {waypoints: 10.0}", ".waypoints: ", "whole number", "10.0"),
    "waypoints true": scene("planner: {waypoints: true}", ".waypoints: ", "whole number", "true"),
    "negative clearance": scene("planner: {clearance: -0.01}", ".clearance: ", "0 to 1", "-0.01"),
    "clearance as text": scene("planner: {clearance: 5mm}", ".clearance: ", "number", "'5mm'"),
    "long value": scene(f"planner: {{clearance: {'x' * 1000}}}", ".clearance: ", "..."),
}


@pytest.mark.core
@pytest.mark.parametrize("case", CASES)
def test_refused_in_one_clear_line(tmp_path: Path, case: str) -> None:
    text, *parts = CASES[case]
    file = tmp_path / "scene.yaml"
    file.write_text(text, encoding="utf-8")
    named, _, message = error(file).partition(f"{file}: ")
    assert not named
    for part in parts:
        assert part in message


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
