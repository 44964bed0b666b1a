"""A robot of the user's own on the command line: its files, and what is refused in them."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh
import yaml

from tests.commands import Command, arm_scene, obstacle, refused

URDF = """<robot name="mine">
 <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
 <link name="rail"><collision><origin xyz="0 0 0.15"/><geometry><cylinder radius="0.04" length="0.3"/></geometry>
 </collision></link>
 <link name="arm"><collision><origin xyz="0 0 0.2"/><geometry><mesh filename="package://my_arm/bar.obj"/></geometry>
 </collision></link>
 <link name="tip"><collision><origin xyz="0 0 0.1"/><geometry><mesh filename="bar.obj" scale="1 1 0.3"/></geometry>
 </collision></link>
 <joint name="slide" type="prismatic"><parent link="base"/><child link="rail"/><axis xyz="0 0 1"/>
  <origin xyz="0 0 0.1"/><limit lower="0" upper="0.4" effort="1" velocity="1"/></joint>
 <joint name="turn" type="continuous"><parent link="rail"/><child link="arm"/><axis xyz="0 1 0"/>
  <origin xyz="0 0.12 0.3"/></joint>
 <joint name="wrist" type="revolute"><parent link="arm"/><child link="tip"/><axis xyz="1 0 0"/>
  <origin xyz="0 0 0.4"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
</robot>"""
SRDF = """<robot name="mine"><group_state name="home" group="all"><joint name="slide" value="0.1"/>
<joint name="turn" value="0"/><joint name="wrist" value="0"/></group_state>
<disable_collisions link1="base" link2="arm" reason="far"/></robot>"""


def own_robot(folder: Path, urdf: str = URDF, srdf: str = SRDF, **changes: object) -> Path:
    """Write a robot with its meshes, and a scene beside it."""
    (folder / "packages" / "my_arm").mkdir(parents=True, exist_ok=True)
    for file in (folder / "packages" / "my_arm" / "bar.obj", folder / "bar.obj"):
        trimesh.creation.box((0.1, 0.1, 0.3)).export(file)
    (folder / "mine.urdf").write_text(urdf, encoding="utf-8")
    (folder / "mine.srdf").write_text(srdf, encoding="utf-8")
    robot = {"urdf": "mine.urdf", "srdf": "mine.srdf", "package_dirs": ["packages"]}
    content = {"hdplan": 1, "robot": robot, "start": {"state": "home"}, "goal": {"joints": [0.3, 2.5, 1]}, **changes}
    file = folder / "own.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


def test_a_robot_of_ones_own(hdplan: Command, tmp_path: Path) -> None:
    done = hdplan("plan", own_robot(tmp_path), "-o", "motion.json")
    assert (done.code, done.err) == (0, "")
    assert hdplan("check", "own.yaml", "motion.json").code == 0
    explained = hdplan("explain", "own.yaml").out
    assert "turns freely" in explained
    assert "2 joints kept within limits; 1 joint without" in explained


def test_a_base_upside_down(hdplan: Command, tmp_path: Path) -> None:
    scene = own_robot(tmp_path)
    robot = {**yaml.safe_load(scene.read_text())["robot"], "base": {"position": [0, 0, 2], "rpy": [3.14159265, 0, 0]}}
    below = obstacle("type: box, size: [3, 3, 0.1]", "[0, 0, 0.2]")
    assert hdplan("plan", own_robot(tmp_path, robot=robot, obstacles=below)).code == 0
    above = obstacle("type: box, size: [3, 3, 0.1]", "[0, 0, 1.6]")
    assert "rail and thing overlap" in hdplan("plan", own_robot(tmp_path, robot=robot, obstacles=above)).err


BAD_URDF = {
    "empty": ("", ["not well-formed XML"]),
    "another document": ("<html/>", ["<html>", "expected <robot>"]),
    "no link": ('<robot name="a"/>', ["holds no <link>"]),
    "no joint": ('<robot name="a"><link name="l"/></robot>', ["no joint left to plan"]),
    "mesh missing": (URDF.replace('"bar.obj"', '"nope.obj"'), ["link 'tip': mesh ", "nope.obj: no such file"]),
    "package missing": (URDF.replace("my_arm", "no_arm"), ["package 'no_arm' is not found"]),
    "mesh a folder": (URDF.replace('"bar.obj"', '"packages"'), ["packages"]),
    "size text": (URDF.replace("0.2 0.2 0.1", "big 1 1"), ["link 'base'", "size must be 3 finite", "'big 1 1'"]),
    "size nan": (URDF.replace("0.2 0.2 0.1", "nan 1 1"), ["link 'base'", "size must be 3 finite numbers"]),
    "size negative": (URDF.replace("0.2 0.2 0.1", "1 -1 1"), ["link 'base'", "greater than 0 [m]", "'1 -1 1'"]),
    "size huge": (URDF.replace("0.2 0.2 0.1", "1e308 1 1"), ["link 'base'", "at most 1e+06"]),
    "no shape": (URDF.replace('<box size="0.2 0.2 0.1"/>', ""), ["link 'base'", "one shape, found 0"]),
    "unknown shape": (URDF.replace("<cylinder", "<cylindr"), ["link 'rail'", "'cylindr'", "'cylinder'"]),
    "origin text": (URDF.replace('xyz="0 0 0.15"', 'xyz="0 0 a"'), ["link 'rail'", "origin: xyz", "'0 0 a'"]),
    "scale zero": (URDF.replace("1 1 0.3", "1 1 0"), ["link 'tip'", "scale must not be 0"]),
    "limits turned": (URDF.replace('upper="0.4"', 'upper="-1"'), ["joint 'slide'", "lower must not exceed upper"]),
    "limit text": (URDF.replace('upper="0.4"', 'upper="a"'), ["joint 'slide'", "upper must be a finite number", "'a'"]),
    "axis zero": (URDF.replace('xyz="0 1 0"', 'xyz="0 0 0"'), ["joint 'turn'", "axis", "'0 0 0'"]),
    "link unknown": (URDF.replace('parent link="arm"', 'parent link="amr"'), ["joint 'wrist'", "'amr'", "'arm'"]),
    "circle": (URDF.replace('parent link="base"', 'parent link="tip"'), ["'rail' is not connected to the root"]),
    "joint type": (URDF.replace("continuous", "continuos"), ["turn", "continuos"]),
    "floating": (URDF.replace("continuous", "floating"), ["'turn'", "6 coordinates"]),
    "follows itself": (URDF.replace('<axis xyz="1', '<mimic joint="wrist"/><axis xyz="1'), ["'wrist'", "itself"]),
    "factor text": (
        URDF.replace('<axis xyz="1', '<mimic joint="turn" multiplier="x"/><axis xyz="1'),
        ["joint 'wrist'", "multiplier", "'x'"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_URDF)
def test_bad_urdf(hdplan: Command, tmp_path: Path, case: str) -> None:
    urdf, words = BAD_URDF[case]
    refused(hdplan("plan", own_robot(tmp_path, urdf=urdf), "-o", "motion.json"), "own.yaml: robot", *words)
    assert not Path("motion.json").exists()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "is empty"),
        ("hello", "'hello' is not known"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "is flat"),
        ("v 0 0 0\nv nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n", "numbers are expected"),
        ("v 0 0 0\nv 1e9 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n", "farther than 1e+06 m"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a face has vertex 8"),
        (b"\xff\xfe\x00v 1 2 3", "mesh.obj: "),  # unreadable, or empty where a library guesses its encoding
    ],
    ids=["empty", "text", "flat", "nan", "huge", "index", "binary"],
)
def test_bad_meshes(hdplan: Command, tmp_path: Path, content: str | bytes, words: str) -> None:
    mesh = tmp_path / "mesh.obj"
    mesh.write_bytes(content if isinstance(content, bytes) else str(content).encode())
    scene = arm_scene(tmp_path, obstacles=obstacle("type: mesh, file: mesh.obj"))
    refused(hdplan("plan", scene), f"{scene}: obstacles.thing: mesh", words)
    refused(hdplan("explain", scene), f"{scene}: obstacles.thing: mesh", words)
