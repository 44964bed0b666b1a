"""MoveIt's .scene text: the same scene as its message, in the old form and the new; all else refused in one line."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from hdplan.scenes.errors import InputError
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Cylinder, Sphere
from hdplan.scenes.yaml_format.reader import load_scene

REQUEST = {
    "group_name": "panda_arm",
    "start_state": {"joint_state": {"name": ["panda_joint2", "panda_joint1"], "position": [0.2, 0.1]}},
    "goal_constraints": [{"joint_constraints": [{"joint_name": "panda_joint1", "position": 1.0}]}],
}
NEW = """\
(noname)+
* table top
0.5 0 0.1
0 0 0.70710678 0.70710678
2
box
0.1 0.2 0.3
1 0 0
0 0 0 1
0 0 0 0
cylinder
0.05 0.4
0 0 1
0 0 0 1
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
0.25
1e-05 -2.5 3
0 0 0 1
0 0 0 0
0
.
"""
OLD = """\

* table
2
box
0.1 0.2 0.3
1 0 0
0 0 0 1
0 0 0 0
sphere
0.25
0 0 1
0 0 0 1
0 0 0 0
* ball
1
sphere
0.5
0 2 0
0 0 0 1
0 0 0 0
.
"""


def load(folder: Path, scene: str | bytes | dict[str, Any]) -> Scene:
    request = folder / "request.yaml"
    request.write_text(yaml.safe_dump(REQUEST), encoding="utf-8")
    file = folder / ("world.yaml" if isinstance(scene, dict) else "world.scene")
    text = yaml.safe_dump(scene) if isinstance(scene, dict) else scene
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_scene(file, request=request, robot="panda")


def refusal(folder: Path, text: str | bytes) -> str:
    with pytest.raises(InputError) as caught:
        load(folder, text)
    message = str(caught.value)
    assert message.startswith(f"{folder / 'world.scene'}: ")
    assert "\n" not in message
    return message


@pytest.mark.core
def test_the_new_form(tmp_path: Path) -> None:
    scene = load(tmp_path, NEW)
    assert [obstacle.name for obstacle in scene.obstacles] == ["table top", "table top/1", "ball"]
    box, cylinder, ball = scene.obstacles
    assert (box.shape, cylinder.shape, ball.shape) == (Box((0.1, 0.2, 0.3)), Cylinder(0.05, 0.4), Sphere(0.25))
    np.testing.assert_allclose(box.pose.position, [0.5, 1.0, 0.1], atol=1e-8)  # turned with its object
    np.testing.assert_allclose(cylinder.pose.position, [0.5, 0.0, 1.1], atol=1e-8)
    assert ball.pose == Pose((1e-5, -2.5, 3.0))
    assert scene.from_request


def test_the_old_form_has_no_poses_of_objects(tmp_path: Path) -> None:
    scene = load(tmp_path, OLD)
    assert {obstacle.name: obstacle.pose.position for obstacle in scene.obstacles} == {
        "table": (1.0, 0.0, 0.0),
        "table/1": (0.0, 0.0, 1.0),
        "ball": (0.0, 2.0, 0.0),
    }


@pytest.mark.parametrize("seed", range(5))
def test_text_and_message_are_the_same_scene(tmp_path: Path, seed: int) -> None:
    """Random objects written in both ways."""
    rng = np.random.default_rng(seed)
    objects, lines = [], ["world"]
    for i in range(4):
        name = f"object {i} *.é"
        pose, poses, shapes = random_pose(rng), [], []
        lines += [f"* {name}", *pose_lines(pose)]
        count = int(rng.integers(1, 4))
        lines.append(str(count))
        for _ in range(count):
            kind = str(rng.choice(["sphere", "box", "cylinder"]))
            sizes = rng.uniform(0.1, 1.0, {"sphere": 1, "box": 3, "cylinder": 2}[kind]).tolist()
            shapes.append({"type": kind, "dimensions": sizes[::-1] if kind == "cylinder" else sizes})
            poses.append(random_pose(rng))
            lines += [kind, " ".join(map(repr, sizes)), *pose_lines(poses[-1]), "0 0 0 0"]
        lines.append("0")
        objects.append({"id": name, "pose": pose, "primitives": shapes, "primitive_poses": poses})
    lines += [".", ""]
    message = load(tmp_path, {"name": "", "world": {"collision_objects": objects}})
    for end in ("\n", "\r\n"):
        assert load(tmp_path, end.join(lines)) == message


def random_pose(rng: np.random.Generator) -> dict[str, list[float]]:
    turn = rng.normal(size=4)
    return {"position": rng.normal(size=3).tolist(), "orientation": (turn / np.linalg.norm(turn)).tolist()}


def pose_lines(pose: dict[str, list[float]]) -> list[str]:
    return [" ".join(map(repr, numbers)) for numbers in pose.values()]


@pytest.mark.parametrize("text", [NEW, OLD])
def test_a_file_that_was_cut_off_is_refused_wherever(tmp_path: Path, text: str) -> None:
    for size in range(text.rindex(".")):
        message = refusal(tmp_path, text[:size])
        assert "line " in message


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("box", "mesh", "line 6: a mesh in MoveIt scenes is not supported yet"),
        ("box", "plane", "line 6: a plane in MoveIt scenes is not supported yet"),
        ("cylinder", "cone", "a cone in MoveIt scenes is not supported yet"),
        ("sphere", "spere", r"line 24: unknown shape 'spere' of 'ball' \(did you mean 'sphere'"),
        ("0.25\n", "-0.25\n", "line 25: the sphere of 'ball' must have sizes greater than 0"),
        ("0.1 0.2 0.3", "0.1 0.2 nan", "line 7: found 'nan', but a number of the size of a box"),
        ("0.1 0.2 0.3", "0.1 0.2", "found 'cylinder', but a number of"),
        ("\n2\nbox", "\n-2\nbox", "line 5: found '-2', but the number of shapes"),
        ("\n2\nbox", "\n1\nbox", "found 'cylinder', but the number of subframes"),
        ("0.70710678", "0.9", "must be a unit quaternion"),
        ("* ball", "ball", "line 20: found 'ball', but an object"),
        ("* ball", "*", "line 20: the object has no name"),
        ("* ball", "* table top", "the name 'table top' is taken"),
        ("\n.\n", "\n.\n* more\n", "continues after its end"),
    ],
)
def test_faults_are_named_with_their_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    message = refusal(tmp_path, NEW.replace(old, new))
    assert re.search(words, message), message


def test_files_of_other_formats_are_refused(tmp_path: Path) -> None:
    for text in (b"", b"hdplan: 1\n", b"\xff\xfe", b"\x00" * 100):
        refusal(tmp_path, text)
    (tmp_path / "world.scene").write_text(NEW)
    with pytest.raises(InputError, match=r"world\.scene: is a MoveIt planning scene, which has no goal"):
        load_scene(tmp_path / "world.scene")
