"""The planner's boxes around a cloud contain every ball, and the planner sees what the certificate sees."""

from __future__ import annotations

import dataclasses
import itertools
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hdplan
from hdplan.planner.collision import cell_bodies, convex_pieces
from hdplan.planner.collision.cell_bodies import SMALL_CELL, cell_boxes, from_balls, from_cloud, from_surface
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.geometry.opened import opened
from hdplan.planner.problem.assemble import more_closely
from hdplan.planner.solvers.solution import SolverStatus
from hdplan.planner.view.drawing.skins import obstacle_mesh
from hdplan.scenes.array_types import Array
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import InputError
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Mesh
from hdplan.scenes.yaml_format.reader import load_scene

TURNED = Pose((0.1, -0.2, 0.05), (0.1, 0.3, -0.3, 0.9))


@pytest.mark.parametrize("planes", ["box", "faces", "sphere"])
@pytest.mark.parametrize(("closely", "edge"), [(False, 0.08), (True, 0.04)])
@pytest.mark.parametrize("flat", [[1, 1, 1], [1, 1, 0], [1, 0, 0], [0, 0, 0]])
def test_every_ball_is_inside_one_body(planes: str, closely: bool, edge: float, flat: list[int]) -> None:
    rng = np.random.default_rng(0)
    balls = np.column_stack([rng.uniform(-0.2, 0.2, size=(800, 3)) * flat, rng.uniform(0.001, 0.01, 800)])
    bodies = from_balls("view", FixedArray(balls), TURNED, planes, closely)
    world = balls[:, :3] @ TURNED.matrix[:3, :3].T + TURNED.matrix[:3, 3]
    within = np.full((len(balls), len(bodies)), np.inf)
    boxed = np.zeros_like(within, dtype=bool)
    for b, body in enumerate(bodies):
        within[:, b] = (world @ body.normals.T - body.supports).max(axis=1) + balls[:, 3]
        local = np.abs((world - body.box[:3, 3]) @ body.box[:3, :3])
        boxed[:, b] = (local + balls[:, 3:] <= body.half_size + 1e-12).all(axis=1)
    assert (within.min(axis=1) <= 1e-12).all()
    assert (boxed & (within <= 1e-12)).any(axis=1).all()
    assert all((body.half_size <= 0.5 * np.sqrt(3.0) * edge + 0.0101).all() for body in bodies)


def test_merging_is_reported_and_contains_the_points() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.2, 0.2, size=(5000, 3)) * [1, 1, 0]
    few, notes = from_cloud("view", Cloud(points, 0.005, voxel=0.02), Pose(), "box")
    assert len(notes) == 1
    assert notes[0].startswith("cloud 'view': 5000 points planned around as ")
    reach = np.min([(points @ body.normals.T - body.supports).max(axis=1) for body in few], axis=0)
    assert (reach <= -0.005 + 1e-12).all()
    assert from_cloud("view", Cloud(points, 0.005), Pose(), "box")[1] == ()


def test_a_cloud_in_millimetres_is_reported() -> None:
    points = np.random.default_rng(0).uniform(-2000.0, 2000.0, size=(100, 3))
    _, (note,) = from_cloud("view", Cloud(points, 0.005), Pose(), "box")
    assert "is it in millimetres? hdplan takes metres" in note


def large_and_small() -> tuple[Array, TriangleMesh]:
    """The corners (12, 3, 3) of triangles, and a mesh of them."""
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(12, 1, 3)) * 0.2 + rng.normal(size=(12, 3, 3)) * rng.choice([0.01, 0.3], (12, 1, 1))
    return corners, TriangleMesh.merged(corners.reshape(-1, 3), np.arange(36).reshape(-1, 3))


@pytest.mark.parametrize("planes", ["box", "faces", "sphere"])
def test_every_triangle_of_a_surface_is_inside_bodies(planes: str) -> None:
    """Large triangles and small ones: every point of them is in a body, and no body is larger than a cell."""
    corners, mesh = large_and_small()
    bodies = from_surface("thing", mesh, TURNED, planes, closely=True)
    share = np.random.default_rng(1).dirichlet(np.ones(3), size=(12, 100))
    points = np.einsum("fsc,fci->fsi", share, corners).reshape(-1, 3)
    world = points @ TURNED.matrix[:3, :3].T + TURNED.matrix[:3, 3]
    beyond = np.min([(world @ body.normals.T - body.supports).max(axis=1) for body in bodies], axis=0)
    assert beyond.max() <= 1e-9
    assert max(body.half_size.max() for body in bodies) <= np.sqrt(3.0) * 0.04 + 0.04
    assert len(from_surface("thing", mesh, TURNED, planes)) < len(bodies)


@pytest.mark.parametrize("stretched", [[1e4, 1e4, 1e4], pytest.param([1e6, 1e-3, 1e-3], marks=pytest.mark.slow)])
def test_a_huge_surface_has_no_more_bodies(stretched: list[float]) -> None:
    _, mesh = large_and_small()
    huge = TriangleMesh(stretched * mesh.vertices, mesh.triangles)
    assert len(from_surface("thing", huge, Pose(), "faces")) < 60_000


def test_a_mesh_that_is_not_split_is_planned_through(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cage whose bars are joined to one mesh; its hull holds the robot. What was not split is not split again."""
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    scene = load_scene("panda_cage")
    bars = [drawn(each).apply_transform(each.pose.matrix) for each in opened(scene).obstacles]
    whole = trimesh.util.concatenate(bars)
    first = np.cumsum([0, *(len(bar.vertices) for bar in bars[:-1])])
    joints = [[a, a + 1, b] for a, b in itertools.pairwise(first.tolist())]
    trimesh.Trimesh(whole.vertices, [*whole.faces, *joints], process=False).export(tmp_path / "cage.obj")
    monkeypatch.setattr(convex_pieces, "MOST_SECONDS", 0.0)
    cage = Obstacle("cage", Mesh(tmp_path / "cage.obj"))
    problem = hdplan.build(dataclasses.replace(scene, obstacles=(cage,)))
    monkeypatch.setattr(convex_pieces, "MOST_SECONDS", 60.0)
    began = time.process_time()
    closer = more_closely(problem)
    assert time.process_time() - began < 5.0
    assert any("boxes that contain its surface" in note for note in problem.notes)
    assert len(closer.halfspace_bodies) > len(problem.halfspace_bodies) > 50
    for each in (problem, closer):
        assert each.depth(problem.start[None])[0] < 0.05
    assert more_closely(closer) is closer


def drawn(obstacle: Obstacle) -> trimesh.Trimesh:
    mesh = obstacle_mesh(obstacle)
    return trimesh.Trimesh(mesh.vertices, mesh.triangles)


def scan_of(scene: Scene, seed: int) -> Scene:
    """Return a scene whose obstacles are only known as points."""
    seen = []
    for i, obstacle in enumerate(opened(scene).obstacles):
        mesh = drawn(obstacle)
        points, _ = trimesh.sample.sample_surface(mesh, int(mesh.area / 0.01**2) + 20, seed=seed + i)
        pose = obstacle.pose.matrix
        seen.append(points @ pose[:3, :3].T + pose[:3, 3])
    return Scene(
        "scan", Path("scan.yaml"), scene.robot, (Obstacle("view", Cloud(np.concatenate(seen), 0.005)),),
        scene.start, scene.goal,
    )  # fmt: skip


def test_small_boxes_leave_a_way_that_large_ones_close(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell_bodies, "CELL", 1.0)
    scene = scan_of(load_scene("panda_cage"), 100)
    problem = hdplan.build(scene)
    closer = more_closely(problem)
    assert len(closer.halfspace_bodies) > 5 * len(problem.halfspace_bodies)
    assert more_closely(closer) is closer
    assert hdplan.solve(problem).status is not SolverStatus.CLEAR
    result = hdplan.plan(scene)
    assert result.certified
    assert result.attempts > 1
    plain = hdplan.build(load_scene("panda_cage"))
    assert more_closely(plain) is plain


def test_a_scene_and_its_scan_are_both_planned_and_certified() -> None:
    """The same motion is free of both, by nearly as much: the balls reach out by their radius."""
    scene = load_scene("panda_bookshelf")
    scan = scan_of(scene, 0)
    result = hdplan.plan(scan)
    assert result.certified
    assert result.certificate.clearance is not None
    of_solids = hdplan.certify(scene, result.trajectory, check_ends=False)
    assert of_solids.clearance is not None
    assert result.certificate.clearance <= of_solids.clearance + 1e-3
    assert result.certificate.clearance >= 0.9 * of_solids.clearance - 0.0055


def test_other_points_in_a_built_problem_are_as_if_it_was_built_with_them() -> None:
    rng, scene = np.random.default_rng(0), load_scene("panda_cage")
    first, second = (rng.uniform([0.3, -0.4, 0.0], [0.8, 0.4, 0.4], size=(2000, 3)) for _ in range(2))

    def scene_of(points: Array) -> Scene:
        view = Obstacle("view", Cloud(points, 0.005, voxel=0.01), Pose((0.0, 0.0, 0.2)))
        return dataclasses.replace(scene, obstacles=(*scene.obstacles, view))

    built, swapped = hdplan.build(scene_of(second)), hdplan.build(scene_of(first)).with_cloud(second)
    guess = built.polyline()
    for name in ("cost", "smoothness", "depth"):
        np.testing.assert_array_equal(
            getattr(swapped.evaluate(guess, 1e3), name), getattr(built.evaluate(guess, 1e3), name)
        )
    assert swapped.scene == built.scene
    assert swapped.notes == built.notes
    assert swapped.evaluate(guess, 1e3).cost != hdplan.build(scene_of(first)).evaluate(guess, 1e3).cost
    with pytest.raises(InputError, match=r"no cloud is named 'vew' .did you mean 'view'"):
        built.with_cloud(first, "vew")
    with pytest.raises(InputError, match="holds no points"):
        built.with_cloud(np.empty((0, 3)))
    with pytest.raises(InputError, match="needed unless there is exactly one cloud; there are 0"):
        hdplan.build(scene).with_cloud(first)


@pytest.mark.parametrize("kind", ["volume", "surface", "line", "grid", "one"])
def test_small_cells_contain_all_that_is_in_reach(kind: str) -> None:
    """Every ball that touches one of the others is in a box along right-handed axes of unit length; surfaces and lines
    are in thin ones."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-1.0, 1.0, (1 if kind == "one" else 3000, 3))
    if kind == "surface":
        points[:, 2] = 0.3 * points[:, 0] - 0.5 * points[:, 1]
    elif kind == "line":
        points = points[:, :1] * [0.3, -0.5, 0.7]
    elif kind == "grid":
        points = np.round(points, 1)
    radii, reached = rng.uniform(0.001, 0.01, len(points)), np.array([[0.3, 0.0, 0.1, 0.5], [-0.4, 0.2, 0.0, 0.3]])
    boxes = cell_boxes(points, radii, SMALL_CELL, reached)
    axes = boxes.rotation
    np.testing.assert_allclose(axes.transpose(0, 2, 1) @ axes, np.broadcast_to(np.eye(3), axes.shape), atol=1e-12)
    assert (np.linalg.det(axes) > 0.0).all()
    away = np.linalg.norm(points[:, None] - reached[:, :3], axis=2) - reached[:, 3]
    near = (away <= radii[:, None]).any(axis=1)
    local = np.einsum("mi,cij->mcj", points[near], axes)
    short = np.maximum(local - boxes.high, boxes.low - local).max(axis=2)
    inside = (short <= 1e-12) & (boxes.radius >= radii[near][:, None])
    assert inside.any(axis=1).all()
    thin = {"surface": 1, "line": 2}.get(kind, 0)
    assert np.sort(boxes.high - boxes.low, axis=1)[:, :thin].max(initial=0.0) < 1e-9
