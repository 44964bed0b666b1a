"""A good scene file says what its author meant."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.planner_settings import PlannerSettings
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Mesh, Points, Sphere
from hdplan.scenes.yaml_format.reader import load_scene

SAMPLE = """
hdplan: 1
robot:
  name: panda                      # or urdf: path, srdf: path, package_dirs: [..]
  base: {position: [0, 0, 0], rpy: [0, 0, 0]}
  locked: {panda_finger_joint1: 0.04, panda_finger_joint2: 0.04}
  ignore_pairs: []                 # link pairs, beside the SRDF's
obstacles:
  - {name: floor, shape: {type: box, size: [2, 2, 0.1]}, pose: {position: [0, 0, -0.1]}}
  - {name: can, shape: {type: cylinder, radius: 0.03, length: 0.14}, pose: {position: [0.5, 0, 0.3], quaternion_xyzw: [0, 0, 0, 1]}}
start: {joints: [0, -0.785, 0, -2.356, 0, 1.571, 0.785]}     # or {state: default}, a named state of the SRDF
goal: {joints: [0.5, 0.4, 0, -1.9, 0, 2.3, 0.8]}
planner: {waypoints: 40, clearance: 0.005}                    # optional
"""  # noqa: E501 (as the README shows it)

SHORT = """
hdplan: 1
robot: {name: panda}
start: {state: default}
goal: {joints: {panda_joint1: 1, panda_joint4: -2.0}}
"""

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def write(folder: Path, text: str, name: str = "scene.yaml") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def obstacles(folder: Path, *entries: str) -> tuple[Obstacle, ...]:
    return load_scene(write(folder, SHORT + "obstacles:\n" + "".join(f"  - {entry}\n" for entry in entries))).obstacles


def test_sample_is_read_whole(tmp_path: Path) -> None:
    file = write(tmp_path, SAMPLE)
    scene = load_scene(file)
    assert (scene.name, scene.source, scene.from_request, scene.notes) == ("scene", file, False, ())
    fingers = {"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04}
    assert scene.robot == RobotSpec(name="panda", locked=fingers)
    floor = Obstacle("floor", Box((2.0, 2.0, 0.1)), Pose((0.0, 0.0, -0.1)))
    can = Obstacle("can", Cylinder(radius=0.03, length=0.14), Pose((0.5, 0.0, 0.3)))
    assert scene.obstacles == (floor, can)
    assert scene.start.positions == (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
    assert scene.goal.positions == (0.5, 0.4, 0.0, -1.9, 0.0, 2.3, 0.8)
    assert (scene.start.field, scene.goal.field) == ("start", "goal")
    assert scene.planner == PlannerSettings(waypoints=40, clearance=0.005)


def test_absent_sections_have_defaults(tmp_path: Path) -> None:
    scene = load_scene(write(tmp_path, SHORT))
    assert scene.robot == RobotSpec(name="panda")
    assert scene.obstacles == ()
    assert scene.planner == PlannerSettings()
    assert scene.start.state == "default"
    assert scene.goal.by_name == {"panda_joint1": 1.0, "panda_joint4": -2.0}


def test_sections_with_nothing_behind_them_are_defaults(tmp_path: Path) -> None:
    assert load_scene(write(tmp_path, SHORT + "obstacles:\nplanner:\n")) == load_scene(write(tmp_path, SHORT))


@pytest.mark.parametrize(
    ("text", "shape"),
    [
        ("{type: box, size: [1, 2, 3]}", Box((1.0, 2.0, 3.0))),
        ("{type: sphere, radius: 1}", Sphere(1.0)),
        ("{type: cylinder, radius: 1, length: 2}", Cylinder(1.0, 2.0)),
        ("{type: capsule, radius: 1, length: 0}", Capsule(1.0, 0.0)),
        ("{type: ellipsoid, radii: [1, 2, 3]}", Ellipsoid((1.0, 2.0, 3.0))),
        ("{type: box, size: [1.0e-3, 1, 1]}", Box((0.001, 1.0, 1.0))),
        (
            "{type: points, points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}",
            Points(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
        ),
    ],
)
def test_shapes(tmp_path: Path, text: str, shape: object) -> None:
    assert obstacles(tmp_path, f"{{shape: {text}}}") == (Obstacle("obstacle0", shape, Pose()),)


@pytest.mark.parametrize(
    ("scale", "read"), [("", (1, 1, 1)), (", scale: 2", (2, 2, 2)), (", scale: [1, 2, 3]", (1, 2, 3))]
)
def test_mesh_stands_beside_the_scene(tmp_path: Path, scale: str, read: tuple[int, int, int]) -> None:
    (tmp_path / "meshes").mkdir()
    write(tmp_path, TRIANGLE, "meshes/part.obj")
    (obstacle,) = obstacles(tmp_path, f"{{name: part, shape: {{type: mesh, file: meshes/part.obj{scale}}}}}")
    assert obstacle.shape == Mesh(tmp_path / "meshes/part.obj", read)


def test_obstacles_without_a_name_are_counted(tmp_path: Path) -> None:
    sphere = "shape: {type: sphere, radius: 1}"
    named = obstacles(tmp_path, f"{{{sphere}}}", f"{{name: ball, {sphere}}}", f"{{{sphere}}}")
    assert [obstacle.name for obstacle in named] == ["obstacle0", "ball", "obstacle2"]


@pytest.mark.parametrize(("part", "noted"), [(0.7071068, False), (0.707, True)])
def test_quaternions_near_unit_length_are_normalized_and_noted_beyond_rounding(
    tmp_path: Path, part: float, noted: bool
) -> None:
    robot = f"{{name: panda, base: {{quaternion_xyzw: [0, 0, {part}, {part}]}}}}"
    scene = load_scene(write(tmp_path, SHORT.replace("{name: panda}", robot)))
    assert len(scene.notes) == noted
    assert all("robot.base.quaternion_xyzw" in note and "normalized" in note for note in scene.notes)
    assert sum(value**2 for value in scene.robot.base.quaternion_xyzw) == pytest.approx(1.0, abs=1e-15)


def test_own_robot_stands_beside_the_scene(tmp_path: Path) -> None:
    (tmp_path / "packages").mkdir()
    for name in ("arm.urdf", "arm.srdf"):
        write(tmp_path, "<robot/>", name)
    robot = "{urdf: arm.urdf, srdf: arm.srdf, package_dirs: [packages], ignore_pairs: [[a, b]], locked: {grip: 0.1}}"
    scene = load_scene(write(tmp_path, SHORT.replace("{name: panda}", robot)))
    assert scene.robot == RobotSpec(
        urdf=tmp_path / "arm.urdf",
        srdf=tmp_path / "arm.srdf",
        package_dirs=(tmp_path / "packages",),
        locked={"grip": 0.1},
        ignore_pairs=(("a", "b"),),
    )


def test_robot_given_beside_the_scene_replaces_its_own(tmp_path: Path) -> None:
    file = write(tmp_path, SAMPLE)
    assert load_scene(file, robot="ur5").robot == RobotSpec(name="ur5")
    other = write(tmp_path, "robot: {name: ur5, base: {position: [0, 0, 1]}}", "robot.yaml")
    assert load_scene(file, robot=other).robot == RobotSpec(name="ur5", base=Pose((0.0, 0.0, 1.0)))


def test_words_about_a_robot_file_reach_the_user(tmp_path: Path) -> None:
    other = write(tmp_path, "robot: {name: ur5, base: {quaternion_xyzw: [0, 0, 0, 1.001]}}", "robot.yaml")
    (note,) = load_scene(write(tmp_path, SHORT), robot=other).notes
    assert note.startswith("robot.yaml: robot.base.quaternion_xyzw: ")


def test_robot_given_beside_the_scene_may_stand_in_for_a_missing_one(tmp_path: Path) -> None:
    file = write(tmp_path, SHORT.replace("robot: {name: panda}\n", ""))
    assert load_scene(file, robot="panda").robot == RobotSpec(name="panda")


def test_byte_order_mark_and_anchors_are_plain_yaml(tmp_path: Path) -> None:
    text = SHORT + "obstacles:\n  - &ball {name: a, shape: {type: sphere, radius: 1}}\n  - {<<: *ball, name: b}\n"
    file = tmp_path / "scene.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert [obstacle.name for obstacle in load_scene(file).obstacles] == ["a", "b"]


def test_order_of_sections_does_not_matter(tmp_path: Path) -> None:
    content = yaml.safe_load(SAMPLE)
    turned = yaml.safe_dump(dict(reversed(content.items())), sort_keys=False)
    assert load_scene(write(tmp_path, turned)) == load_scene(write(tmp_path, SAMPLE))
