"""The drawing agrees with Pinocchio and the scene: same places, same sizes, read once."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import trimesh
from numpy.typing import NDArray

from hdplan.planner.certificate.exact_proximity import link_pieces, obstacle_pieces
from hdplan.planner.geometry.mesh_files import mesh_stamps
from hdplan.planner.geometry.opened import opened
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.view.drawing import mesh_parts as parts_module
from hdplan.planner.view.drawing.ground import ground_of
from hdplan.planner.view.drawing.mesh_parts import Part, mesh_parts
from hdplan.planner.view.drawing.skins import Skin, collision_skins, obstacle_mesh, outer_skins, visual_skins
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_files.library import description_of
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes

DIRECTIONS = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)], dtype=np.float64)


def corners(skins: tuple[Skin, ...], joint: int) -> NDArray[np.float64]:
    own = [skin.vertices[skin.triangles.ravel()] for skin in skins if skin.joint == joint]
    whole = np.concatenate(own).astype(np.float64)
    return np.stack([whole.min(axis=0), whole.max(axis=0)])


def spec_of(robot: str) -> tuple[RobotSpec, Robot]:
    scene = load_scene("empty")
    spec = RobotSpec(name=robot, base=scene.robot.base)
    return spec, load_scene_robot(type(scene)(**{**vars(scene), "robot": spec}))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["panda", "ur5", "xarm7", "kinova"])
def test_visual_meshes_stand_where_pinocchio_has_them(name: str) -> None:
    """trimesh reads their colours, assimp their places: both see the same box around each joint's meshes."""
    spec, robot = spec_of(name)
    skins, left_out = visual_skins(robot, spec)
    assert left_out == ()
    _, urdf, _, folders = description_of(spec)
    boxes: dict[int, list[NDArray[np.float64]]] = {}
    model = pin.buildModelFromUrdf(str(urdf))
    pictures = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.VISUAL, package_dirs=list(map(str, folders)))
    for item in pictures.geometryObjects:
        named = model.frames[item.parentFrame]
        frame = robot.model.frames[robot.model.getFrameId(named.name, pin.FrameType.BODY)]
        place = frame.placement * named.placement.inverse() * item.placement
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
    first, _ = visual_skins(robot, spec)
    monkeypatch.setattr(parts_module, "read_file", lambda *_: pytest.fail("read again"))
    assert visual_skins(robot, spec)[0] is first
    moved, other = spec_of("xarm7")
    assert visual_skins(other, moved)[0] is first


OBJ = "mtllib looks.mtl\nusemtl paint\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_parts_come_from_the_disk_as_long_as_all_that_they_were_read_from_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Colours of an OBJ file stand in a file beside it, which may change, be another's, or go."""
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    mesh, paint = tmp_path / "looks.obj", tmp_path / "looks.mtl"
    mesh.write_text(OBJ, encoding="utf-8")

    def read() -> tuple[Part, ...]:
        mesh_parts.cache_clear()  # as another process
        return mesh_parts(mesh, mesh_stamps([mesh]))

    colors = []
    for kd in ("1 0 0", "0 0 1", None, "1 0 0"):
        paint.unlink() if kd is None else paint.write_text(f"newmtl paint\nKd {kd}\n", encoding="utf-8")
        (fresh,), (again,) = read(), read()
        for one, other in ((fresh.vertices, again.vertices), (fresh.triangles, again.triangles)):
            assert one.dtype == other.dtype
            assert np.array_equal(one, other)
        assert fresh.color == again.color
        colors.append(fresh.color)
    assert colors[:2] == [(255, 0, 0), (0, 0, 255)]
    assert colors[3] == colors[0] != colors[2]
    with monkeypatch.context() as patch:
        patch.setattr(parts_module, "read_mesh_file", lambda *_: pytest.fail("read again"))
        read()
    for entry in (tmp_path / "cache/mesh_parts").iterdir():  # damaged: read again
        entry.write_bytes(entry.read_bytes()[:-9])
    assert read()[0].color == colors[0]
    mesh.write_text(OBJ.replace("1 0 0", "2 0 0"), encoding="utf-8")
    assert read()[0].vertices.max() == 2.0
    mesh.write_text(OBJ.replace("f 2 3 4", "f 2 3 9"), encoding="utf-8")
    with pytest.raises(InputError, match="vertex"):
        read()


LOOKS = """<robot name="looks">
<link name="base"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
<link name="tip"><visual><geometry><mesh filename="ball.{ending}" scale="{scale}"/></geometry></visual>
<collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_a_link_whose_visual_mesh_cannot_be_read_is_drawn_by_its_collision_geometry(tmp_path: Path) -> None:
    """Cut short anywhere or with bytes changed: never a signal, and never a link that is missing; the file is named,
    and one that changes is read again."""
    ball, rng = trimesh.creation.icosphere(1, 0.05), np.random.default_rng(0)
    urdf, spec = tmp_path / "looks.urdf", RobotSpec(urdf=tmp_path / "looks.urdf")
    for ending, kind in (("stl", "stl_ascii"), ("stl", "stl"), ("obj", "obj"), ("ply", "ply"), ("dae", "dae")):
        mesh = tmp_path / f"ball.{ending}"
        urdf.write_text(LOOKS.format(ending=ending, scale="1 2 1"), encoding="utf-8")
        robot = load_robot(spec)
        whole = ball.export(file_type=kind)
        whole = whole.encode() if isinstance(whole, str) else whole
        for _ in range(2):  # whole, and whole again
            mesh.write_bytes(whole)
            skins, left_out = visual_skins(robot, spec)
            assert left_out == ()
            np.testing.assert_allclose(np.ptp(corners(skins, 1), axis=0), [0.1, 0.2, 0.1], atol=1e-6)
            for cut in rng.integers(0, len(whole) // 2, 6):  # no OBJ file says how much it holds
                mesh.write_bytes(whole[:cut])
                assert _replaced(spec, robot, mesh)
        for _ in range(20):
            wild = bytearray(whole)
            for at in rng.integers(0, len(whole), 3):
                wild[at] = rng.integers(256)
            mesh.write_bytes(wild)
            _replaced(spec, robot, mesh)
        mesh.unlink()
        assert _replaced(spec, robot, mesh)
        os.mkfifo(mesh)
        assert _replaced(spec, robot, mesh)
        mesh.unlink()


def _replaced(spec: RobotSpec, robot: Robot, mesh: Path) -> bool:
    """True if the tip is drawn by its collision geometry, a sphere; the file is named then."""
    skins, left_out = visual_skins(robot, spec)
    assert {skin.link for skin in skins} == {"base", "tip"}
    if not left_out:
        return False
    assert mesh.name in left_out[0]
    assert left_out[1:] == ("drawn by their collision geometry: tip",)
    np.testing.assert_allclose(np.ptp(corners(skins, 1), axis=0), [0.1, 0.1, 0.1], atol=1e-3)
    return True


@pytest.mark.parametrize("scale", ["a", "1 1", "0 1 1", "nan 1 1", "1 1 1e300"])
def test_a_visual_mesh_of_a_wrong_scale_is_left_out_or_refused(tmp_path: Path, scale: str) -> None:
    trimesh.creation.icosphere(1, 0.05).export(tmp_path / "ball.stl")
    (tmp_path / "looks.urdf").write_text(LOOKS.format(ending="stl", scale=scale), encoding="utf-8")
    spec = RobotSpec(urdf=tmp_path / "looks.urdf")
    try:
        skins, left_out = visual_skins(load_robot(spec), spec)
    except InputError:
        return
    assert {skin.link for skin in skins} == {"base", "tip"}
    assert "tip" in left_out[0]
    assert left_out[1:] == ("drawn by their collision geometry: tip",)


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


@pytest.mark.parametrize("name", [name for name in shipped_scenes() if name not in ("empty", "panda_camera")])
def test_obstacles_are_drawn_in_their_true_shapes(name: str) -> None:
    for obstacle in opened(load_scene(name)).obstacles:
        mesh = obstacle_mesh(obstacle)
        support = np.max([piece.support(DIRECTIONS) for piece in obstacle_pieces(obstacle)], axis=0)
        seen = (np.asarray(mesh.vertices) @ DIRECTIONS.T).max(axis=0)
        assert (seen <= support + 1e-9).all(), obstacle.name
        np.testing.assert_allclose(seen, support, rtol=0.01, atol=1e-9, err_msg=obstacle.name)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", ["ur5_ceiling", "baxter_bimanual_carry", "panda_cage", "empty"])
def test_the_ground_lies_below_all_that_stands_and_no_lower_than_its_lowest_point(name: str) -> None:
    """Of a robot that hangs, too, and of one whose feet are below its base."""
    scene = opened(load_scene(name))
    robot = load_scene_robot(scene)
    feet = [skin.vertices[:, 2] for skin in visual_skins(robot, scene.robot)[0] if skin.joint == 0]
    obstacles = [
        (each.pose.matrix @ np.insert(obstacle_mesh(each).vertices, 3, 1.0, 1).T)[2] for each in scene.obstacles
    ]
    *across, height = ground_of(robot, scene.robot, scene.obstacles)
    assert tuple(across) == scene.robot.base.position[:2]
    assert height == pytest.approx(min([scene.robot.base.position[2], *map(np.min, feet + obstacles)]), abs=1e-6)
