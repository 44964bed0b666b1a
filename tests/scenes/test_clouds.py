"""Clouds in scenes, from files and from Python: compared by their numbers, and refused in one line."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.geometry.clouds import balls_in, read_cloud
from hdplan.scenes.clouds import MOST_POINTS, Cloud, Ignored
from hdplan.scenes.errors import InputError
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.yaml_format.reader import load_scene

POINTS = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])


def read(folder: Path, entry: str) -> Scene:
    file = folder / "scene.yaml"
    (folder / "scan.xyz").write_text("0 0 1\n")
    ends = "start: {state: default}\ngoal: {state: default}\n"
    file.write_text(f"hdplan: 1\nrobot: {{name: panda}}\nobstacles: [{entry}]\n{ends}")
    return load_scene(file)


def test_clouds_with_the_same_numbers_are_equal_and_hash_alike() -> None:
    ours, same, other = Cloud(POINTS, 0.01), Cloud(POINTS.tolist(), 0.01), Cloud(POINTS + 1e-12, 0.01)
    assert ours == same
    assert hash(ours) == hash(same)
    assert ours != other
    assert Cloud(POINTS, 0.02) != ours
    assert FixedArray(np.zeros((2, 3))) != FixedArray(np.zeros((3, 2)))
    copy = pickle.loads(pickle.dumps(ours))
    assert copy == ours
    assert not copy.points.array.flags.writeable


def test_a_cloud_keeps_its_own_copy() -> None:
    points = POINTS.copy()
    cloud = Cloud(points, 0.01)
    points[:] = 7.0
    assert isinstance(cloud.points, FixedArray)
    np.testing.assert_array_equal(cloud.points.array, POINTS)
    with pytest.raises(ValueError, match="read-only"):
        cloud.points.array[0] = 1.0


def test_in_a_list_of_obstacles_it_may_carry_its_name_and_pose() -> None:
    scene = Scene(
        robot="panda",
        obstacles=[Cloud(POINTS, 0.01, name="view", pose=[0.0, 0.0, 1.0]), Box([1, 1, 1])],
        start="default",
        goal="default",
    )
    assert [each.name for each in scene.obstacles] == ["view", "obstacle1"]
    assert scene.obstacles[0].pose.position == (0.0, 0.0, 1.0)
    assert scene.obstacles[0].shape == Cloud(POINTS, 0.01)


def test_points_that_are_not_finite_are_dropped_if_that_is_requested() -> None:
    holes = np.vstack([POINTS, [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]])
    assert Cloud(holes, 0.01, drop_nan=True) == Cloud(POINTS, 0.01, drop_nan=True)
    with pytest.raises(InputError, match=r"Cloud.points: 2 of 4 points are not finite"):
        Cloud(holes, 0.01)


def test_each_point_may_have_its_own_radius(tmp_path: Path) -> None:
    cloud = Cloud(np.vstack([POINTS, [np.nan, 0.0, 0.0]]), [0.01, 0.02, 0.03], drop_nan=True)
    assert cloud.radius == FixedArray(np.array([0.01, 0.02]))
    scene = Scene(robot="panda", obstacles=[Cloud(POINTS, [0.01, 0.02])], start="default", goal="default")
    scene.save(tmp_path / "saved.yaml")
    assert load_scene(tmp_path / "saved.yaml") == scene
    np.testing.assert_array_equal(balls_in(read_cloud(Cloud(POINTS, [0.01, 0.02]), "")).array[:, 3], [0.01, 0.02])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"points": []}, "Cloud.points: must be a file, points"),
        ({"points": np.empty((0, 3))}, "Cloud.points: holds no points"),
        ({"points": [[1, 2]]}, "points .m, 3.*found a list of 1"),
        ({"points": [[1, 2, 3], [1, 2]]}, "points .m, 3"),
        ({"points": np.zeros((3, 4))}, r"found an array of shape \(3, 4\)"),
        ({"points": [["a", "b", "c"]]}, "points .m, 3"),
        ({"points": [[1e7, 0, 0]]}, "reaches as far as 1e.07 m"),
        ({"points": np.full((2, 3), np.nan), "drop_nan": True}, "holds no points"),
        ({"points": np.broadcast_to([0.0, 0.0, 0.0], (MOST_POINTS + 1, 3))}, f"has {MOST_POINTS + 1} points; at most"),
        ({"radius": 0.0}, "Cloud.radius: is needed"),
        ({"radius": 2.0}, "Cloud.radius: must be a finite number 0 to 1"),
        ({"radius": np.nan}, "Cloud.radius"),
        ({"radius": [0.1]}, "Cloud.radius: must be one number, or as many as the 2 points, found 1"),
        ({"radius": [0.1, -1.0]}, "Cloud.radius: must be greater than 0 and at most 1 .m., found -1.0"),
        ({"radius": [[0.1], [0.1, 0.2]]}, "Cloud.radius: must be a number, or one for each point"),
        ({"voxel": -1.0}, "Cloud.voxel"),
        ({"ignore_robot": -1.0}, "Cloud.ignore_robot"),
        ({"ignore": "cup"}, "Cloud.ignore: must be of the class Ignored"),
        ({"ignore": [1.0]}, r"Cloud.ignore\[0\]"),
    ],
)
def test_refused_in_one_clear_line(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        Cloud(**{"points": POINTS, "radius": 0.01, **arguments})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("{cloud: {radius: 0.1}}", r"obstacles\[0\].cloud: needs either file or points"),
        ("{cloud: {file: scan.xyz, points: [[0, 0, 0]], radius: 0.1}}", "needs either file or points"),
        ("{cloud: {file: scan.xyz}}", "the key 'radius' is missing"),
        ("{cloud: {file: none.ply, radius: 0.1}}", r"obstacles\[0\].cloud.file: must be a file, but 'none.ply'"),
        ("{cloud: {points: scan.xyz, radius: 0.1}}", r"cloud.points: must be a list"),
        ("{cloud: {file: scan.xyz, radus: 0.1}}", "unknown key 'radus' .did you mean 'radius'"),
        (
            "{cloud: {file: scan.xyz, radius: 0.1}, shape: {type: sphere, radius: 1}}",
            "has more than one of shape, cloud",
        ),
        ("{name: a}", "the key 'shape' is missing"),
        ("{cloud: {points: [[.nan, 0, 0]], radius: 0.1}}", "1 of 1 points are not finite"),
        ("{cloud: {file: scan.xyz, radius: 0.1, ignore: {margin: 0.1}}}", "needs either a link or an obstacle"),
        ("{cloud: {file: scan.xyz, radius: 0.1, ignore: {link: a, obstacle: b, margin: 0.1}}}", "either a link or"),
        ("{cloud: {file: scan.xyz, radius: 0.1, ignore: [{link: a}]}}", r"ignore\[0\]: the key 'margin' is missing"),
        ("{cloud: {file: scan.xyz, radius: 0.1, ignore: {obstacle: cap, margin: 0.1}}}", "unknown obstacle 'cap'"),
        ("{cloud: {file: scan.xyz, radius: 0.1}, link: a}", "unknown key 'link'"),
    ],
)
def test_a_file_is_refused_in_one_clear_line(tmp_path: Path, entry: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read(tmp_path, entry)
    assert "\n" not in str(caught.value)
    assert "scene.yaml" in str(caught.value)


def test_ignored_bodies_are_read(tmp_path: Path) -> None:
    cup = "{name: cup, shape: {type: sphere, radius: 0.1}}"
    ignored = "[{obstacle: cup, margin: 0.1}, {link: l, margin: 0}]"
    entry = f"{{name: view, cloud: {{file: scan.xyz, radius: 0.1, ignore: {ignored}}}}}"
    scene = read(tmp_path, f"{entry}, {cup}")
    assert isinstance(scene.obstacles[0], Obstacle)
    shape = scene.obstacles[0].shape
    assert isinstance(shape, Cloud)
    assert shape.points == (tmp_path / "scan.xyz").absolute()
    assert shape.ignore == (Ignored(0.1, obstacle="cup"), Ignored(0.0, link="l"))
    once = read(tmp_path, f"{entry.replace(ignored, '{obstacle: cup, margin: 0.1}')}, {cup}").obstacles[0]
    assert isinstance(once.shape, Cloud)
    assert once.shape.ignore == shape.ignore[:1]
