"""Volumes of hulls kept on disk: those that are computed; and no proof rests on them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hdplan.planner.certificate import exact_proximity
from hdplan.planner.certificate.exact_proximity import mesh_pieces
from hdplan.planner.certificate.hull_volumes import hull_volume, is_convex
from hdplan.planner.geometry.meshes import TriangleMesh


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HDPLAN_CACHE", str(tmp_path))
    return tmp_path


def hull(seed: int) -> TriangleMesh:
    return TriangleMesh.hull(np.random.default_rng(seed).normal(size=(40, 3)))


def two_corners() -> TriangleMesh:
    """A closed mesh that is not convex: a tetrahedron with one dented face."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.15, 0.15, 0.15]], dtype=float)
    return TriangleMesh(points, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [3, 1, 4]]))


def test_cached_results_equal_computed_ones(cache: Path) -> None:
    meshes = [hull(seed) for seed in range(3)] + [two_corners()]
    first = [hull_volume(mesh) for mesh in meshes]
    assert [hull_volume(mesh) for mesh in meshes] == first == [mesh.hull_volume for mesh in meshes]
    assert [is_convex(mesh) for mesh in meshes] == [True, True, True, False]
    for file in (cache / "hull_volumes").glob("*.json"):
        file.write_text(file.read_text()[:-3])
    assert [hull_volume(mesh) for mesh in meshes] == first


@pytest.mark.parametrize("factor", [0.0, 0.3, 1.0, 3.0])
def test_a_wrong_volume_makes_no_piece_smaller(factor: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every point of the mesh lies in the pieces, and every piece is the mesh's triangles or contains them."""
    mesh = two_corners()
    monkeypatch.setattr(exact_proximity, "hull_volume", lambda part: factor * part.hull_volume)
    monkeypatch.setattr(exact_proximity, "is_convex", lambda part: part.fills(factor * part.hull_volume))
    pieces = mesh_pieces(mesh)
    directions = np.random.default_rng(0).normal(size=(200, 3))
    reach = np.max([piece.support(directions) for piece in pieces], axis=0)
    assert np.all(reach >= (directions @ mesh.vertices.T).max(axis=1) - 1e-12)
    if len(pieces) == 1 and pieces[0].surface is None:
        return  # its hull, which contains it
    areas = [
        np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        for piece in pieces
        if piece.surface is not None
        for a, b, c in [piece.surface.mesh.vertices[piece.surface.mesh.triangles].transpose(1, 0, 2)]
    ]
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    assert sum(areas) == pytest.approx(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum(), rel=1e-9)
