"""Drawn simple shapes: closed, outward, inside the true shape and nearly as large."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.planner.geometry.coal_shapes import hull_triangles
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.view.drawing.creases import creased
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Shape, Sphere

RNG = np.random.default_rng(38)
A, B, C = (RNG.uniform(0.01, 2.0, 20).tolist() for _ in range(3))


@pytest.mark.parametrize(
    ("kind", "volume"),
    [
        (lambda a, b, c: Box((a, b, c)), lambda a, b, c: a * b * c),
        (lambda a, b, c: Sphere(a), lambda a, b, c: 4 / 3 * np.pi * a**3),
        (lambda a, b, c: Ellipsoid((a, b, c)), lambda a, b, c: 4 / 3 * np.pi * a * b * c),
        (lambda a, b, c: Cylinder(a, b), lambda a, b, c: np.pi * a * a * b),
        (lambda a, b, c: Capsule(a, b), lambda a, b, c: np.pi * a * a * b + 4 / 3 * np.pi * a**3),
    ],
    ids=["box", "sphere", "ellipsoid", "cylinder", "capsule"],
)
def test_drawn_shapes_are_closed_outward_and_as_large_as_the_true_ones(kind, volume) -> None:
    directions = RNG.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for sizes in zip(A, B, C, strict=True):
        shape: Shape = kind(*sizes)
        row = operations(shape)
        mesh = row.triangles(shape)
        assert mesh.closed
        assert 0.98 * volume(*sizes) <= mesh.volume <= (1.0 + 1e-9) * volume(*sizes)
        outline = row.outline
        reach = (mesh.vertices @ directions.T).max(axis=0)
        true = outline.support(shape, directions)
        assert (reach <= true * (1.0 + 1e-9)).all()
        assert (reach >= 0.98 * true).all()


def test_hulls_of_points_are_closed_outward_and_as_large_as_they_are() -> None:
    for count in (4, 8, 30, 400):
        points = RNG.normal(size=(count, 3)) * RNG.uniform(0.1, 2.0, 3) + RNG.uniform(-3.0, 3.0, 3)
        mesh = hull_triangles(points)
        assert mesh.closed
        assert mesh.volume == pytest.approx(TriangleMesh.hull(points).volume, rel=1e-9)
    fan = np.linspace(0.0, 2 * np.pi, 300, endpoint=False)  # a tip with more neighbours than coal can count
    cone = np.concatenate([np.stack([np.cos(fan), np.sin(fan), 0 * fan], 1), [[0.0, 0.0, 1.0]]])
    assert hull_triangles(cone).volume == pytest.approx(np.pi / 3, rel=1e-3)


def test_vertices_are_doubled_along_sharp_edges_alone() -> None:
    """Each triangle stays where it is; a box has three vertices in each corner, a ball one in each place."""
    for shape, vertices in ((Box((1.0, 2.0, 3.0)), 24), (Sphere(0.4), 48 * 23 + 2), (Cylinder(0.3, 1.0), 4 * 48 + 2)):
        mesh = operations(shape).triangles(shape)
        points, corners = creased(mesh.vertices, mesh.triangles)
        assert len(points) == vertices
        np.testing.assert_allclose(points[corners], mesh.vertices[mesh.triangles], rtol=0, atol=1e-6)
        again = creased(mesh.vertices[mesh.triangles].reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        assert len(again[0]) == vertices  # also where every triangle has vertices of its own
