"""What is drawn is what Pinocchio and the scene say: same places, same sizes, read once."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from hdplan.planner.pin_model import read_visuals
from hdplan.planner.proximity import link_pieces, obstacle_pieces
from hdplan.planner.robot import Robot
from hdplan.planner.scene_robot import load_scene_robot
from hdplan.planner.view import skins as module
from hdplan.planner.view.skins import Skin, collision_skins, obstacle_mesh, outer_skins, visual_skins
from hdplan.scenes.model import RobotSpec
from hdplan.scenes.reader import load_scene, shipped_scenes
from hdplan.scenes.robot_library import description_of

DIRECTIONS = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)], dtype=np.float64)


def corners(skins: tuple[Skin, ...], joint: int) -> NDArray[np.float64]:
    own = [skin.vertices[skin.triangles.ravel()] for skin in skins if skin.joint == joint]
    whole = np.concatenate(own).astype(np.float64)
    return np.stack([whole.min(axis=0), whole.max(axis=0)])


def spec_of(robot: str) -> tuple[RobotSpec, Robot]:
    scene = load_scene("empty")
    spec = RobotSpec(name=robot, base=scene.robot.base)
    return spec, load_scene_robot(type(scene)(**{**vars(scene), "robot": spec}))


@pytest.mark.parametrize("name", ["panda", "ur5", "xarm7", "kinova"])
def test_visual_meshes_stand_where_pinocchio_has_them(name: str) -> None:
    """trimesh reads their colours, assimp their places: both see the same box around each joint's meshes."""
    spec, robot = spec_of(name)
    skins = visual_skins(robot, spec)
    _, urdf, _, folders = description_of(spec)
    boxes: dict[int, list[NDArray[np.float64]]] = {}
    for link, placement, item in read_visuals(urdf, folders):
        frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
        place = frame.placement * placement
        points = np.asarray(item.geometry.vertices()) @ place.rotation.T + place.translation
        boxes.setdefault(int(frame.parentJoint), []).append(points)
    assert {skin.joint for skin in skins} == set(boxes)
    for joint, points in boxes.items():
        whole = np.concatenate(points)
        np.testing.assert_allclose(
            corners(skins, joint), [whole.min(axis=0), whole.max(axis=0)], rtol=0, atol=1e-4, err_msg=f"joint {joint}"
        )


def test_meshes_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    spec, robot = spec_of("xarm7")
    first = visual_skins(robot, spec)
    monkeypatch.setattr(module, "read_visuals", lambda *_: pytest.fail("read again"))
    assert visual_skins(robot, spec) is first
    moved, other = spec_of("xarm7")
    assert visual_skins(other, moved) is first


@pytest.mark.parametrize("name", ["panda_cage", "planar_arm"])
def test_collision_and_outer_bodies_are_the_planners_and_the_certificates(name: str) -> None:
    robot = load_scene_robot(load_scene(name))
    drawn, outer = collision_skins(robot), outer_skins(robot, "fitted")
    assert {skin.link for skin in drawn} == {skin.link for skin in outer} == set(robot.links)
    for skin, item in zip(drawn, robot.collision.geometryObjects, strict=True):
        rotation, origin = item.placement.rotation, item.placement.translation
        support = np.max(
            [piece.support(DIRECTIONS @ rotation) for piece in link_pieces(item.geometry, item.name)], axis=0
        )
        seen = (skin.vertices.astype(np.float64) @ DIRECTIONS.T).max(axis=0)
        np.testing.assert_allclose(seen, support + DIRECTIONS @ origin, rtol=0, atol=2e-3)
    for link in robot.links:
        inner = np.concatenate([skin.vertices for skin in drawn if skin.link == link])
        around = np.concatenate([skin.vertices for skin in outer if skin.link == link])
        assert ((around @ DIRECTIONS.T).max(axis=0) >= (inner @ DIRECTIONS.T).max(axis=0) - 1e-3).all()


@pytest.mark.parametrize("name", [name for name in shipped_scenes() if name != "empty"])
def test_obstacles_are_drawn_in_their_true_shapes(name: str) -> None:
    for obstacle in load_scene(name).obstacles:
        mesh = obstacle_mesh(obstacle)
        support = np.max([piece.support(DIRECTIONS) for piece in obstacle_pieces(obstacle)], axis=0)
        seen = (np.asarray(mesh.vertices) @ DIRECTIONS.T).max(axis=0)
        assert (seen <= support + 1e-9).all(), obstacle.name
        np.testing.assert_allclose(seen, support, rtol=0.01, atol=1e-9, err_msg=obstacle.name)
