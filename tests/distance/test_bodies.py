"""ConvexBody: right sets for every shape, hulls of any dimension, bad input refused by name."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.distance.bodies import PLATONIC, ConvexBody, unique_directions
from hdplan.scenes.errors import InputError

GRID = np.stack(np.meshgrid(*[np.linspace(0, 1, 5)] * 3), -1).reshape(-1, 3)
TURN = Rotation.from_rotvec([0.3, -0.7, 0.4]).as_matrix()


@pytest.mark.parametrize(
    ("name", "vertices", "faces", "edges"),
    [("tetrahedron", 4, 4, 6), ("cube", 8, 6, 3), ("octahedron", 6, 8, 6), ("icosahedron", 12, 20, 15)]
    + [("dodecahedron", 20, 12, 15)],
)
def test_platonic_solids(name, vertices, faces, edges, tolerance):
    body = ConvexBody.platonic(name, 2.0)
    assert (len(body.vertices), len(body.faces), len(body.edges)) == (vertices, faces, edges)
    np.testing.assert_allclose(np.linalg.norm(body.vertices, axis=1), 2.0, rtol=tolerance["exact"])
    heights = np.max(body.faces @ body.vertices.T, axis=1)
    np.testing.assert_allclose(heights, heights[0], rtol=tolerance["exact"])


def test_there_are_five_platonic_solids():
    assert len(PLATONIC) == 5
    with pytest.raises(InputError, match="did you mean 'icosahedron'"):
        ConvexBody.platonic("icosaedron")


def test_box_is_the_hull_of_its_corners():
    box = ConvexBody.box([1, 2, 3])
    hull = ConvexBody.from_points(box.vertices)
    assert len(hull.faces) == 6
    assert len(hull.edges) == 3
    assert np.allclose(np.sort(np.abs(hull.faces), axis=1)[:, -1], 1)


def test_directions_are_unit_and_outward(bodies, tolerance):
    for body in bodies.values():
        for directions in (body.faces, body.edges):
            np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=tolerance["exact"])
        centre = body.vertices.mean(0)
        assert np.all(
            body.faces @ (body.vertices - centre).T <= np.max(body.faces @ (body.vertices - centre).T, 1)[:, None]
        )
        assert len(unique_directions(body.edges)[0]) == len(body.edges)


def test_cylinder_contains_the_round_one_and_touches_it(tolerance):
    body = ConvexBody.cylinder(0.3, 0.7, sides=16)
    sides = body.faces[np.abs(body.faces[:, 2]) < 0.5]
    np.testing.assert_allclose(np.max(sides @ body.vertices.T, axis=1), 0.3, rtol=tolerance["exact"])
    assert (len(body.vertices), len(body.faces), len(body.edges)) == (32, 18, 9)


@pytest.mark.parametrize("size", [(1, 1, 1), (1e-6, 1, 1), (1e-6, 1e-6, 1), (1e-6, 1e-6, 1e-6), (1e6, 1e6, 1e6)])
@pytest.mark.parametrize("offset", [0.0, 5.0])
def test_points_in_faces_and_edges_are_no_vertices(size, offset):
    body = ConvexBody.from_points((GRID * size) @ TURN.T + offset)
    assert (len(body.vertices), len(body.faces), len(body.edges)) == (8, 6, 3)
    np.testing.assert_allclose(np.abs(body.faces @ TURN).max(1), 1.0, atol=1e-8)


def test_the_hull_contains_its_points():
    points = np.random.default_rng(0).normal(size=(200, 3))
    body = ConvexBody.from_points(points)
    heights = np.max(body.faces @ body.vertices.T, axis=1)
    assert np.all(body.faces @ points.T <= heights[:, None] + 1e-14)
    euler = len(body.vertices) + len(body.faces) - 2  # edges of a simple hull, no two parallel in a random one
    assert len(body.edges) == euler


def test_float32_faces_are_one_face():
    body = ConvexBody.from_points((GRID @ TURN.T).astype(np.float32))
    assert (len(body.faces), len(body.edges)) == (6, 3)


def test_degenerate_hulls():
    one = ConvexBody.from_points([[1, 2, 3]] * 4)
    assert (len(one.vertices), len(one.faces), len(one.edges)) == (1, 0, 0)
    line = ConvexBody.from_points(GRID[(GRID[:, 0] == 0) & (GRID[:, 1] == 1)] @ TURN.T)
    assert (len(line.vertices), len(line.faces), len(line.edges)) == (2, 0, 1)
    flat = ConvexBody.from_points(GRID[GRID[:, 2] == 1] @ TURN.T + 3)
    assert (len(flat.vertices), len(flat.faces), len(flat.edges)) == (4, 2, 2)
    np.testing.assert_allclose(np.abs(flat.faces @ TURN), [[0, 0, 1]] * 2, atol=1e-12)
    np.testing.assert_allclose(flat.faces.sum(0), 0, atol=1e-15)


def test_inflating_adds_to_the_radius_and_leaves_the_body_alone():
    sphere = ConvexBody.sphere(0.2)
    assert sphere.inflated(0.1).radius == pytest.approx(0.3)
    assert sphere.radius == 0.2
    with pytest.raises(ValueError, match="read-only"):
        sphere.vertices[0, 0] = 1


@pytest.mark.parametrize(
    ("points", "word"),
    [
        ([], "none"),
        ([[1, 2]], "shape"),
        ([1, 2, 3], "shape"),
        ([[0, 0, np.nan]], "finite"),
        ([[0, 0, np.inf]], "finite"),
    ]
    + [([["a", "b", "c"]], "numbers"), ([[0, 0, 0], [1]], "numbers")],
)
def test_bad_points_are_refused(points, word):
    with pytest.raises(InputError, match=word):
        ConvexBody.from_points(points)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: ConvexBody.box([1, 0, 1]), "box size"),
        (lambda: ConvexBody.box([1, 1]), "box size"),
        (lambda: ConvexBody.sphere(-1), "sphere radius"),
        (lambda: ConvexBody.capsule(0.1, np.nan), "capsule length"),
        (lambda: ConvexBody.cylinder(0.1, 0.1, sides=2), "cylinder sides"),
        (lambda: ConvexBody.box([1, 1, 1]).inflated(-0.1), "clearance"),
        (lambda: ConvexBody.from_points([[0, 0, 0]], radius=-1), "radius"),
    ],
)
def test_bad_sizes_are_refused(make, field):
    with pytest.raises(InputError, match=field):
        make()
