"""Laws of meshes and obstacles: bad files are named, pieces cover their meshes, inside differs from outside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from hdplan import InputError, Mesh, Obstacle, Sphere
from hdplan.planner.certificate.exact_proximity import MOST_PIECES, best_direction, mesh_pieces, obstacle_pieces
from hdplan.planner.certificate.part_distance import distance
from hdplan.planner.collision import convex_pieces as module
from hdplan.planner.collision.convex_pieces import convex_pieces
from hdplan.planner.collision.halfspace_bodies import from_obstacle
from hdplan.planner.geometry.meshes import TriangleMesh, connected, load_mesh
from hdplan.planner.geometry.opened import with_content


def read(mesh: trimesh.Trimesh, path: Path, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> TriangleMesh:
    mesh.export(path)
    return load_mesh(Mesh(path, scale), "obstacles.thing")


def l_shape() -> trimesh.Trimesh:
    """One solid that is not convex: an L of 1 m legs and 0.2 m thickness, extruded 0.3 m."""
    collision_model = np.array([[0, 0], [1, 0], [1, 0.2], [0.2, 0.2], [0.2, 1], [0, 1.0]])
    bottom, top = np.c_[collision_model, np.zeros(6)], np.c_[collision_model, np.full(6, 0.3)]
    caps = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    sides = [t for i in range(6) for j in [(i + 1) % 6] for t in ([i, j, 6 + j], [i, 6 + j, 6 + i])]
    faces = [t[::-1] for t in caps] + [[6 + i for i in t] for t in caps] + sides
    return trimesh.Trimesh(np.r_[bottom, top], faces, process=False)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "off", "glb"])
def test_every_format_reads_as_the_same_solid(tmp_path: Path, ending: str) -> None:
    mesh = read(trimesh.creation.box((0.2, 0.4, 0.6)), tmp_path / f"box.{ending}", (2.0, 1.0, 1.0))
    assert (mesh.vertices.shape, mesh.triangles.shape) == ((8, 3), (12, 3))
    assert mesh.closed
    assert mesh.convex
    assert mesh.volume == pytest.approx(0.4 * 0.4 * 0.6, rel=1e-6)


def test_bad_mesh_files_are_named(tmp_path: Path) -> None:
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    ply = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property double {axis}\n" for axis in "xyz")
    ply += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    ply += "0 0 0\n1 0 0\n0 1 0\n0 1e999 1\n3 0 1 2\n3 0 1 3\n"
    for name, content, words in [
        ("none.stl", None, "no such file"),
        ("words.txt", "hello", "not known"),
        ("words.stl", "hello", "is not an STL file"),
        ("words.glb", "hello", "is no JSON in UTF-8, or cut short"),
        ("empty.obj", "", "is empty"),
        ("points.obj", triangle, "is empty"),
        ("flat.obj", triangle + "v 1 1 0\nf 1 2 3\nf 2 3 4\n", "flat"),
        ("line.obj", triangle + "f 1 2 2\n", "flat"),
        ("nan.obj", triangle + "v 0 0 nan\nf 1 2 3\nf 1 2 4\n", "line 4: .* numbers are expected"),
        ("infinite.ply", ply, "not finite"),
        ("range.obj", triangle + "f 1 2 9\n", "has vertex 8"),
    ]:
        if content is not None:
            (tmp_path / name).write_text(content)
        with pytest.raises(InputError, match=words) as caught:
            load_mesh(Mesh(tmp_path / name), "obstacles.thing")
        assert "obstacles.thing" in str(caught.value)
        assert name in str(caught.value)
        assert "\n" not in str(caught.value)


def test_pieces_of_parts_are_exact_and_of_one_solid_cover_it(tmp_path: Path) -> None:
    parts = trimesh.util.concatenate([trimesh.creation.box((1, 1, 0.1)), trimesh.creation.icosphere(2, 0.3)])
    assert [len(piece) for piece in convex_pieces(read(parts, tmp_path / "parts.stl"))] == [8, 162]

    solid = read(l_shape(), tmp_path / "solid.stl")
    assert solid.closed
    assert not solid.convex
    pieces = convex_pieces(solid)
    assert 2 <= len(pieces) <= 4
    assert sum(trimesh.convex.convex_hull(piece).volume for piece in pieces) == pytest.approx(solid.volume, rel=0.1)
    bodies, notes = from_obstacle(with_content(Obstacle("thing", Mesh(tmp_path / "solid.stl")), "obstacles"))
    assert len(bodies) == len(pieces)
    assert f"split into {len(pieces)} convex pieces" in notes[0]


def test_winding_number_tells_inside_from_outside(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    mesh = read(l_shape(), tmp_path / "solid.stl")
    for x, y, z in rng.uniform(-0.2, 1.2, size=(200, 3)):
        inside = 0 < z < 0.3 and 0 < x < 1 and 0 < y < 1 and (x < 0.2 or y < 0.2)
        assert mesh.winding_number([x, y, z]) == pytest.approx(float(inside), abs=1e-9)
    room = trimesh.util.concatenate([trimesh.creation.box((2, 2, 2)), trimesh.creation.box((1, 1, 1))])
    room.faces[12:] = room.faces[12:, ::-1]  # the inner wall faces the cavity
    room = read(room, tmp_path / "room.stl")
    assert [part.volume for part in room.components()] == pytest.approx([8.0, -1.0])
    assert room.winding_number([0, 0, 0]) == pytest.approx(0.0, abs=1e-9)
    assert room.winding_number([0.7, 0, 0]) == pytest.approx(1.0)


def test_an_open_mesh_is_not_closed(tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 1, 1))
    box.faces = box.faces[1:]
    mesh = read(box, tmp_path / "open.stl")
    assert not mesh.closed
    assert not mesh.convex


def shells() -> list[TriangleMesh]:
    """Meshes that are open or hollow or full of corners, flat in places: none may be cut for ever."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.linspace(0, 1, 12), np.linspace(0, 1, 12))
    corners = np.arange(144).reshape(12, 12)
    a, b, c, d = (part.ravel() for part in (corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]))
    faces = np.r_[np.c_[a, b, c], np.c_[a, c, d]]
    fields = [0.2 * np.sin(6 * x) * np.cos(6 * y), 0.1 * np.hypot(x, y), np.maximum(x, y)]
    fields += [1e-3 * rng.normal(size=x.shape)]
    found = [TriangleMesh.merged(np.c_[x.ravel(), y.ravel(), z.ravel()], faces) for z in fields]
    found.append(TriangleMesh.merged([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3], [0, 2, 3]]))
    found += [TriangleMesh.merged(rng.normal(size=(3 * k, 3)), np.arange(3 * k).reshape(-1, 3)) for k in (2, 5, 40)]
    for sections in (12, 300):
        ring = trimesh.creation.annulus(0.4, 0.5, 0.2, sections=sections)
        found += [TriangleMesh.merged(ring.vertices, ring.faces), TriangleMesh.merged(ring.vertices, ring.faces[5:])]
    return found


def area(mesh: TriangleMesh) -> float:
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_pieces_of_any_mesh_are_few_and_hold_all_of_its_surface() -> None:
    for mesh in shells():
        pieces = mesh_pieces(mesh)
        assert len(pieces) <= MOST_PIECES
        surfaces = [piece.surface.mesh for piece in pieces if piece.surface]
        assert sum(map(area, surfaces)) == pytest.approx(area(mesh))
        for piece in pieces:
            assert np.abs(piece.surface.mesh.vertices - piece.center).max() < piece.radius * (1 + 1e-9)


@pytest.mark.parametrize("sections", [200, 400])
def test_a_hull_with_a_corner_of_many_neighbours_is_as_far_away_as_it_is(sections: int) -> None:
    """Coal counts neighbours in a byte: beyond, the triangles tell the distance."""
    cone = trimesh.creation.cone(0.1, 0.3, sections=sections)
    (piece,) = mesh_pieces(TriangleMesh.merged(cone.vertices, cone.faces))
    assert (piece.surface is None) == (sections < 256)
    (ball,) = obstacle_pieces(Obstacle("ball", Sphere(0.05)))
    here, there = np.eye(4), np.eye(4)
    rng = np.random.default_rng(0)
    for angle, height in zip(rng.uniform(-np.pi, np.pi, 50), rng.uniform(0, 0.3, 50), strict=True):
        there[:3, 3] = 0.4 * np.cos(angle), 0.4 * np.sin(angle), height
        slope = np.array([0.3, 0.1]) / np.hypot(0.3, 0.1)  # the cone is the set of points within its slope
        radius, along = slope @ [0.4 - 0.1, height], np.array([-0.1, 0.3]) @ [0.3, height]
        expected = radius - 0.05 if 0 <= along <= 0.1 else np.hypot(0.3, height) - 0.05
        assert distance(piece, here, ball, there) == pytest.approx(expected, abs=2e-4)
        _, gap = best_direction(piece, here, ball, there)
        assert gap <= expected + 2e-4
        assert gap == pytest.approx(expected, abs=2e-3)


def rings(count: int) -> TriangleMesh:
    """Rings, one in the other, each with triangles missing: nothing that can be cut into convex pieces at once."""
    parts = [trimesh.creation.torus(0.3, 0.1, major_sections=40, minor_sections=20) for _ in range(count)]
    for i, part in enumerate(parts):
        part.apply_translation([0.3 * i, 0, 0])
        part.update_faces(np.arange(len(part.faces)) % 7 > 0)
    whole = trimesh.util.concatenate(parts)
    return TriangleMesh.merged(whole.vertices, whole.faces)


def test_a_mesh_that_takes_too_long_to_split_is_planned_around_by_its_surface(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """That it took too long is remembered, but not that there was too little time."""
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path / "cache"))
    mesh = rings(3)
    assert convex_pieces(mesh, 0.5) is None
    trimesh.Trimesh(mesh.vertices, mesh.triangles).export(tmp_path / "rings.obj")
    thing = with_content(Obstacle("thing", Mesh(tmp_path / "rings.obj")), "obstacles")
    bodies, (note,) = from_obstacle(thing, seconds=0.5)
    assert f"rings.obj is planned around as {len(bodies)} boxes that contain its surface" in note
    beyond = np.min([(mesh.vertices @ body.normals.T - body.supports).max(axis=1) for body in bodies], axis=0)
    assert beyond.max() <= 1e-6
    assert not list((tmp_path / "cache").glob("convex_pieces/*"))
    monkeypatch.setattr(module, "MOST_SECONDS", 0.5)
    assert convex_pieces(mesh) is None
    monkeypatch.setattr(module, "_taken_apart", lambda *_: pytest.fail("it was split again"))
    assert convex_pieces(mesh) is None


def test_connected_parts_are_those_of_a_graph_library() -> None:
    random = np.random.default_rng(0)
    for count, links in ((1, 0), (5, 0), (5, 20), (40, 25), (300, 200), (300, 299), (2000, 1900)):
        one, other = random.integers(count, size=(2, links))
        graph = coo_matrix((np.ones(links), (one, other)), shape=(count, count))
        np.testing.assert_array_equal(connected(one, other, count), connected_components(graph, directed=False)[1])
    chain = random.permutation(5000)  # the longest way from one node to another
    assert np.unique(connected(chain[1:], chain[:-1], 5000)).tolist() == [0]
