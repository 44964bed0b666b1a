"""Laws of the one door: files are read where scene and robot become a Setup, and nothing behind it opens them again."""

from __future__ import annotations

import ast
import functools
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hdplan
from hdplan import Attached, Cloud, HdplanError, InputError, Mesh, Obstacle, Pose, RobotSpec, Scene, Timing, Voxels
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.exact_proximity import obstacle_pieces
from hdplan.planner.certificate.solids import obstacle_bodies
from hdplan.planner.collision.halfspace_bodies import from_obstacle
from hdplan.planner.geometry.coal_shapes import mesh_of
from hdplan.planner.geometry.meshes import ReadMesh, TriangleMesh, load_mesh
from hdplan.planner.geometry.opened import opened, with_content
from hdplan.planner.page.recorded_page import page_of
from hdplan.planner.problem.assemble import assemble
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.yaml_format.writer import scene_text

from ..urdf import joint_text, link_text, write_robot

MASS = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def write_arm(file: Path, mesh: str = "bar.stl") -> Path:
    bar = link_text("bar", mesh=mesh, at="0.5 0 0", inertial=MASS)
    return write_robot(file, link_text("base"), bar, joint_text("turn", "base", "bar", limits=(-3, 3), effort=9))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Files of every kind that a scene may name."""
    place = tmp_path / "files"
    place.mkdir()
    write_arm(place / "arm.urdf")
    trimesh.creation.box((1.0, 0.1, 0.1)).export(place / "bar.stl")
    ring = trimesh.creation.annulus(0.05, 0.1, 0.05, sections=12)  # not convex
    ring.export(place / "ring.stl")
    np.save(place / "points.npy", np.random.default_rng(0).uniform(-0.05, 0.05, (50, 3)))
    np.save(place / "image.npy", np.full((4, 5), 1.0))
    grid = np.zeros((3, 3, 3), dtype=bool)
    grid[1, 1] = True
    np.save(place / "grid.npy", grid)
    return place


def scene_of(folder: Path) -> Scene:
    image = hdplan.DepthImage(folder / "image.npy", (50.0, 50.0, 2.0, 2.0), scale=1.0)
    coming = {"pose": Pose((0.0, 2.0, 0.0)), "motion": hdplan.SteadyMotion((0.01, 0, 0))}
    obstacles = (
        Obstacle("ring", Mesh(folder / "ring.stl"), Pose((0.0, 1.5, 0.0))),
        Obstacle("cloud", Cloud(folder / "points.npy", 0.01, ignore_robot=0.001), Pose((0.0, -1.5, 0.0))),
        Obstacle("view", Cloud(image), Pose((-1.5, 0.0, -2.0))),
        Obstacle("grid", Voxels(folder / "grid.npy", 0.05), Pose((0.0, 1.5, 0.5))),
        Obstacle("comes", Mesh(folder / "bar.stl", 0.5), **coming),
    )
    held = Attached("held", "bar", Mesh(folder / "ring.stl"), Pose((1.1, 0.0, 0.0)))
    more = {"timing": Timing(duration=2.0), "planner": hdplan.PlannerSettings(link_bodies="box"), "attached": (held,)}
    return Scene("all", folder / "all.yaml", RobotSpec(urdf=folder / "arm.urdf"), obstacles, [-0.4], [0.4], **more)


def test_a_setup_needs_no_file_after_it_is_built(folder: Path) -> None:
    """The files are deleted once the Setup stands: planner, certificate and pictures say the same as with them."""
    from hdplan.planner.pictures.scene import Picture

    scene = scene_of(folder)
    motion = hdplan.Trajectory(("turn",), np.linspace(-0.4, 0.4, 5)[:, None], times=np.linspace(0.0, 2.0, 5))
    before = Certifier(Setup.of(scene)).certify(motion, check_ends=False)
    setup = Setup.of(replace(scene, name="again"))
    shutil.rmtree(folder)
    certificate = Certifier(setup).certify(motion, check_ends=False)
    assert certificate.clearance == before.clearance is not None
    assert certificate.text == before.text
    problem = assemble(setup, setup.query)
    assert {body.name for body in problem.halfspace_bodies} == {each.name for each in scene.obstacles}
    assert Picture.of(setup, motion).obstacle_points
    assert page_of(setup, [ShownMotion.of("swept", motion, Certifier(setup), certificate)])
    aimed = setup.aiming_at(JointTarget("goal", (0.3,)))
    assert Certifier(aimed).nearest(np.array([0.3])) == Certifier(setup).nearest(np.array([0.3]))
    assert setup.requested.obstacles[0] == scene.obstacles[0]  # by its file, to be shown and saved


def test_a_file_is_read_once_and_again_when_it_changes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, events = scene_of(folder), list[Path]()

    def counted(shape: Mesh, where: str, upright: bool) -> TriangleMesh:
        events.append(shape.file)
        return load_mesh(shape, where, upright)

    monkeypatch.setattr("hdplan.planner.geometry.opened.load_mesh", counted)
    first = Setup.of(scene)
    count = len(events)
    assert Setup.of(replace(scene, name="again")).scene.obstacles == first.scene.obstacles
    assert len(events) == count
    trimesh.creation.box((0.1, 0.1, 0.3)).export(folder / "ring.stl")
    changed = Setup.of(scene)
    assert len(events) > count
    assert changed.scene.obstacles[0] != first.scene.obstacles[0]
    assert changed.robot is not first.robot


def test_a_file_of_the_same_size_and_time_is_another_one(folder: Path) -> None:
    """Archives, copies and links may differ in nothing but their content: of a link's mesh, and of an obstacle's."""

    def box(file: Path, length: float) -> None:
        trimesh.creation.box((length, 0.1, 0.1)).export(file)
        os.utime(file, ns=(1, 1))

    def lengths() -> list[float]:
        setup = Setup.of(scene)
        (bar,) = setup.robot.link_geometry["bar"]
        solid, shape = setup.robot.collision.geometryObjects[bar].geometry, setup.scene.obstacles[0].shape
        assert isinstance(shape, ReadMesh)
        return [round(float(np.ptp(each.vertices[:, 0])), 6) for each in (shape.mesh, mesh_of(solid))]

    thing = Obstacle("thing", Mesh(folder / "bar.stl"), Pose((0.0, 2.0, 0.0)))
    scene = replace(scene_of(folder), obstacles=(thing,), attached=())
    for length in (1.0, 0.9):
        box(folder / "bar.stl", length)
        assert lengths() == [length, length]
    for length in (0.8, 0.7):
        box(folder / f"{length}.stl", length)
        (folder / "bar.stl").unlink()
        (folder / "bar.stl").symlink_to(folder / f"{length}.stl")
        assert lengths() == [length, length]


def test_an_unread_obstacle_is_refused(folder: Path) -> None:
    for obstacle in scene_of(folder).obstacles:
        with pytest.raises((TypeError, HdplanError), match=r"read before|is not supported|no map"):
            obstacle_bodies(obstacle)
        with pytest.raises(TypeError):
            from_obstacle(obstacle)
    with pytest.raises(HdplanError, match="Mesh is not supported by the certificate"):
        obstacle_pieces(scene_of(folder).obstacles[0])


def test_a_scene_that_was_read_is_written_by_its_files(folder: Path) -> None:
    scene = replace(scene_of(folder), obstacles=scene_of(folder).obstacles[:1])
    assert scene_text(opened(scene)) == scene_text(scene)


def test_reading_keeps_what_is_in_memory(folder: Path) -> None:
    read = opened(scene_of(folder))
    assert opened(read) is read
    assert isinstance(read.obstacles[0].shape, ReadMesh)
    assert with_content(read.attached[0], "attached") is read.attached[0]
    (folder / "ring.stl").write_bytes((folder / "ring.stl").read_bytes()[:200])
    with pytest.raises(InputError, match=r"all.yaml: obstacles.ring: mesh .*ring.stl: "):
        opened(scene_of(folder))


ROOT = Path(__file__).parents[3]


@functools.cache
def calls() -> set[tuple[str, str]]:
    """Each function that a module of the planner calls by its bare name, with the module."""
    return {
        (getattr(node.func, "id", ""), ".".join(file.relative_to(ROOT).with_suffix("").parts))
        for file in (ROOT / "planner").rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
    }


TRIANGLES = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
<technique_common><accessor source="#f" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><instance_geometry url="#g"/></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>"""


def test_a_scenes_mesh_in_which_z_is_not_up_is_refused_a_links_stands_as_it_is(tmp_path: Path) -> None:
    for up in ("Z_UP", "Y_UP", "X_UP"):
        file = tmp_path / f"{up}.dae"
        file.write_text(TRIANGLES.format(up=up))
        robot = hdplan.load_robot(RobotSpec(urdf=write_arm(tmp_path / "arm.urdf", file.name)))
        assert robot.collision.geometryObjects[0].geometry.num_vertices == 4
        obstacle = Obstacle("part", Mesh(file))
        if up == "Z_UP":
            assert isinstance(with_content(obstacle, "obstacles").shape, ReadMesh)
        else:
            with pytest.raises(InputError, match=f"obstacles.part: mesh .*: up_axis is '{up}', and readers disagree"):
                with_content(obstacle, "obstacles")


DOORS = {  # what opens files of geometry, and who may call it
    "read_mesh_file": {"planner.geometry.meshes", "planner.view.drawing.mesh_parts"},  # the latter: looks alone
    "load_mesh": {"planner.geometry.opened", "planner.robot.pin_model"},
    "read_cloud": {"planner.geometry.opened"},
    "read_map": {"planner.geometry.opened"},
    "read_points": {"planner.geometry.clouds"},
    "read_image": {"planner.geometry.depth_images"},
    "balls_of": {"planner.geometry.clouds"},
}


@pytest.mark.parametrize("reader", DOORS)
def test_only_the_door_reads(reader: str) -> None:
    assert {user for called, user in calls() if called == reader} == DOORS[reader]
