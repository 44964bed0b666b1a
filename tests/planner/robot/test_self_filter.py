"""Points near the robot at the start are its own image; nothing else is left out, and what is left out is counted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from scipy.spatial import ConvexHull

import hdplan
from hdplan import Attached, Box, Cloud, Ignored, InputError, Mesh, Obstacle, Pose, Robot, RobotSpec, Scene, Sphere
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.fixed_array import FixedArray

from ..urdf import joint_text, link_text, write_robot

START = [-0.5, 0.3, 0.0, -1.8, 0.0, 2.1, 0.785]
TURNED = Pose((0.1, -0.2, 0.05), (0.1, 0.3, -0.3, 0.9))


def scene_with(points: Array, *others: Obstacle, robot: Any = "panda", attached: Any = (), **cloud: Any) -> Scene:
    view = Obstacle("view", Cloud(points, 0.005, **cloud), TURNED)
    return Scene("scene", Path("scene.yaml"), robot, (view, *others), START, START, attached=attached)


def kept(setup: Setup) -> Array:
    shape = setup.scene.obstacles[0].shape
    assert isinstance(shape, Cloud)
    assert isinstance(shape.points, FixedArray)
    return shape.points.array


def distances(robot: Robot, world: Array) -> dict[str, Array]:
    """Of points (m, 3) in the world to each link at the start, negative inside: the Panda's links are convex."""
    data, geometry = robot.model.createData(), robot.collision.createData()
    pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry, robot.pin_q(np.array(START)))
    found = {}
    for link, own in robot.link_geometry.items():
        rows = []
        for i in own:
            shape, place = robot.collision.geometryObjects[i].geometry, geometry.oMg[i]
            here = coal.Transform3s(place.rotation, place.translation)
            for point in world:
                there = coal.Transform3s(np.eye(3), point)
                request, result = coal.DistanceRequest(), coal.DistanceResult()
                rows.append(coal.distance(shape, here, coal.Sphere(1e-9), there, request, result))
        found[link] = np.array(rows).reshape(len(own), -1).min(axis=0)
        for i in own:
            shape, place = robot.collision.geometryObjects[i].geometry, geometry.oMg[i]
            if isinstance(shape, coal.BVHModelBase):
                planes = ConvexHull(shape.vertices()).equations
                local = (world - place.translation) @ place.rotation
                found[link][(local @ planes[:, :3].T + planes[:, 3] < 0.0).all(axis=1)] = -1.0
    return found


def in_world(points: Array, pose: Pose = TURNED) -> Array:
    return np.asarray(points @ pose.matrix[:3, :3].T + pose.matrix[:3, 3])


@pytest.mark.parametrize("base", [Pose(), Pose((0.1, 0.2, 1.5), (1.0, 0.0, 0.0, 0.0))])
def test_exactly_the_points_within_the_margin_are_left_out(base: Pose) -> None:
    """The robot stands or hangs, with what it holds."""
    around = in_world(np.random.default_rng(0).uniform([-0.6, -0.6, -0.2], [0.8, 0.8, 1.2], size=(4000, 3)), base)
    points = (around - TURNED.matrix[:3, 3]) @ TURNED.matrix[:3, :3]
    held = Attached("bar", "panda_hand", Box((0.02, 0.4, 0.02)), Pose((0.0, 0.0, 0.15)))
    scene = scene_with(points, robot=RobotSpec("panda", base=base), attached=(held,), ignore_robot=0.03)
    setup = Setup.of(scene)
    away = distances(setup.robot, in_world(points))
    assert "bar" in away
    near = np.min(list(away.values()), axis=0)
    sure = np.abs(near - 0.03) > 1e-6
    left = kept(setup)
    np.testing.assert_array_equal(left, points[near > 0.03])
    assert sure.all()
    assert 30 < len(points) - len(left) < 2000
    count = len(points) - len(left)
    words = f"cloud 'view': of 4000 points left out: {count} within 30 mm of the robot"
    assert [note for note in setup.notes if "view" in note] == [words]


def test_points_deep_inside_a_thick_mesh_are_in_it(tmp_path: Path) -> None:
    """A bowl with a thick wall: what is in its wall is left out, what is in its hollow is not."""
    outline = np.array([[0.0, -0.3], [0.3, -0.3], [0.3, 0.3], [0.1, 0.3], [0.1, -0.1], [0.0, -0.1]])
    trimesh.creation.revolve(outline, sections=128).export(tmp_path / "bowl.stl")
    pose = Pose((1.0, 0.5, 0.3))
    local = np.random.default_rng(0).uniform(-0.4, 0.4, size=(4000, 3))
    section = np.column_stack([np.linalg.norm(local[:, :2], axis=1), local[:, 2]])
    begin, way = outline[:-1], np.diff(outline, axis=0)
    along = np.clip(((section[:, None] - begin) * way).sum(axis=2) / (way**2).sum(axis=1), 0.0, 1.0)
    surface = np.linalg.norm(section[:, None] - begin - along[..., None] * way, axis=2).min(axis=1)
    local = local[sure := np.abs(surface - 0.005) > 2e-4]  # [m] by which the mesh may be off the bowl
    points = (in_world(local, pose) - TURNED.matrix[:3, 3]) @ TURNED.matrix[:3, :3]
    there = Obstacle("bowl", Mesh(tmp_path / "bowl.stl"), pose)
    setup = Setup.of(scene_with(points, there, ignore=Ignored(obstacle="bowl", margin=0.005)))
    away, height = np.linalg.norm(local[:, :2], axis=1), local[:, 2]
    inside = (away < 0.3) & (np.abs(height) < 0.3) & ~((away < 0.1) & (height > -0.1))
    near = surface[sure] <= 0.005
    assert (inside & ~near).sum() > 300
    np.testing.assert_array_equal(kept(setup), points[~(inside | near)])


def test_nothing_is_left_out_without_a_request() -> None:
    points = np.random.default_rng(0).uniform(-1.0, 1.0, size=(1000, 3))
    scene = scene_with(points)
    assert Setup.of(scene).scene is scene


def test_around_one_link_and_one_obstacle() -> None:
    points = np.random.default_rng(1).uniform([-0.6, -0.6, -0.2], [0.8, 0.8, 1.2], size=(4000, 3))
    cup = Obstacle("cup", Sphere(0.1), Pose((0.4, 0.3, 0.5)))
    around = (Ignored(0.05, link="panda_hand"), Ignored(0.02, obstacle="cup"))
    setup = Setup.of(scene_with(points, cup, ignore=around))
    hand = distances(setup.robot, in_world(points))["panda_hand"] <= 0.05
    near = np.linalg.norm(in_world(points) - [0.4, 0.3, 0.5], axis=1) <= 0.12
    np.testing.assert_array_equal(kept(setup), points[~(hand | near)])
    assert hand.any()
    assert near.any()
    (note,) = (note for note in setup.notes if "view" in note)
    counts = re.findall(r"(\d+) within (\d+) mm of (\w+)", note)
    assert counts == [(str(hand.sum()), "50", "panda_hand"), (str((near & ~hand).sum()), "20", "cup")]


def test_the_motion_is_certified_with_the_points_that_are_kept() -> None:
    """The robot's own image stands in its way unless it is left out."""
    points = np.random.default_rng(2).uniform([-0.6, -0.6, 0.0], [0.8, 0.8, 1.2], size=(2000, 3))
    robot = Setup.of(scene_with(points)).robot
    near = np.min(list(distances(robot, points).values()), axis=0) <= 0.01
    own = points[near]
    seen = Obstacle("view", Cloud(own, 1e-4))
    goal = [START[0] + 0.02, *START[1:]]
    scene = Scene(robot="panda", obstacles=(seen,), start=START, goal=goal)
    with pytest.raises(InputError, match="start"):
        hdplan.plan(scene)
    far = Cloud(np.vstack([own, [[2.0, 2.0, 2.0]]]), 1e-4, ignore_robot=0.011)
    result = hdplan.plan(Scene(robot="panda", obstacles=(Obstacle("view", far),), start=START, goal=goal))
    assert result.certified
    assert any(f"{len(own)} within 11 mm of the robot" in note for note in result.notes)


def open_cube(file: Path) -> None:
    """A cube of 0.4 m without its upper side."""
    cube = trimesh.creation.box((0.4, 0.4, 0.4))
    sides = cube.face_normals[:, 2] < 0.5
    trimesh.Trimesh(cube.vertices, cube.faces[sides]).export(file)


def test_points_in_an_open_link_are_left_out_and_in_an_open_box_they_stay(tmp_path: Path) -> None:
    """The certificate takes what an open link surrounds by more than half for contact; in an open box something may
    lie."""
    open_cube(tmp_path / "arm.stl")
    turn = joint_text("a", "base", "arm", limits=(-3, 3))
    write_robot(tmp_path / "one.urdf", link_text("base"), link_text("arm", mesh="arm.stl"), turn)
    local = np.random.default_rng(4).uniform(-0.15, 0.15, size=(40, 3))
    local[:, 2] -= 0.03  # below the opening: in the mesh by more than half, and far from it
    far = np.array([[2.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    there = np.array([5.0, 0.0, 0.0])
    points = np.vstack([local, local + there, far])
    box = Obstacle("box", Mesh(tmp_path / "arm.stl"), Pose(tuple(there.tolist())))
    around = Ignored(0.01, obstacle="box")
    cloud = Cloud(points, 0.001, drop_nan=True, ignore_robot=0.01, ignore=around)
    obstacles = Obstacle("view", cloud), box
    scene = Scene(robot=RobotSpec(urdf=tmp_path / "one.urdf"), obstacles=obstacles, start=[0.0], goal=[1.0])
    setup = Setup.of(scene)
    np.testing.assert_array_equal(kept(setup), np.vstack([local + there, far[:1]]))
    notes = [
        "cloud 'view': left out in reading: 1 that are not finite",
        "cloud 'view': of 81 points left out: 40 within 10 mm of the robot (40 of them in meshes with holes), "
        "0 within 10 mm of box; 40 in box, whose mesh has holes, stay",
    ]
    assert [note for note in setup.notes if "view" in note] == notes
    certificate = hdplan.certify(scene, hdplan.Trajectory(setup.robot.joint_names, np.array([[0.0], [1.0]])))
    assert certificate.certified
    assert [note for note in certificate.notes if "view" in note] == notes


def test_pixels_out_of_range_are_counted() -> None:
    image = np.full((6, 8), 2.0)
    image[0, :5], image[1, 0], image[2, 0] = 9.0, 0.0, np.nan
    view = Obstacle("view", Cloud(hdplan.DepthImage(image, [10, 10, 4, 3], scale=1.0)), TURNED)
    setup = Setup.of(Scene(robot="panda", obstacles=[view], start=START, goal=START))
    words = "left out in reading: 5 pixels that saw something nearer than 0.1 m or farther than 3 m"
    assert [note for note in setup.notes if "view" in note] == [f"cloud 'view': {words}"]


@pytest.mark.parametrize(
    ("cloud", "words"),
    [
        ({"ignore_robot": 1.0}, "obstacles.view.cloud: all of its 1 points would be ignored"),
        ({"ignore": Ignored(0.1, link="panda_hund")}, r"cloud.ignore\[0\].link: unknown link .*mean 'panda_hand'"),
        ({"ignore": Ignored(0.1, obstacle="view")}, "'view' has no shape itself"),
    ],
)
def test_refused_in_one_clear_line(cloud: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        Setup.of(scene_with(np.zeros((1, 3)), **cloud))
    assert str(caught.value).startswith("scene.yaml: ")
