"""Second opinions on mesh files: what other readers make of them, and when two readings are one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from hdplan import InputError
from hdplan.planner.geometry.mesh_files import read_mesh_file

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

from sieges.meshes_files import by_assimp as by_assimp

SAME = 5e-5  # of the largest coordinate: Assimp calculates in single precision, and turns by angles in degrees


def read(path: Path) -> np.ndarray:
    """The triangles (F, 3, 3) that hdplan reads."""
    vertices, corners = read_mesh_file(path)
    return vertices[corners]


def judged(path: Path, before: np.ndarray, others: Callable[[], list[np.ndarray]]) -> str:
    """The fate of a spoilt file: refused in one line, the same, or as others (who may not mirror parts) have it."""
    try:
        ours = read(path)
    except InputError as error:
        assert str(error).isprintable()  # noqa: PT017
        return "refused"
    if ours.shape == before.shape and np.abs(ours - before).max() < 1e-9:
        return "the same"
    assert min(apart(ours, turned) for each in others() for turned in (each, each[:, ::-1])) <= SAME
    return "as others have it"


def apart(ours: np.ndarray, theirs: np.ndarray) -> float:
    """How far two readings are apart, by their largest coordinate: their triangles (F, 3, 3), in any order and turned
    in themselves, or, where flat polygons are cut otherwise, their surfaces' moments."""
    if not len(ours) or not len(theirs) or not np.isfinite(theirs).all():
        return 0.0 if len(ours) == len(theirs) == 0 else np.inf
    size = max(float(np.abs(ours).max()), float(np.abs(theirs).max()))
    ours, theirs = ours / size, theirs / size
    if len(ours) == len(theirs):
        turns = cKDTree(np.concatenate([np.roll(theirs, k, axis=1).reshape(-1, 9) for k in range(3)]))
        far, which = turns.query(ours.reshape(-1, 9))
        if len(set((which % len(theirs)).tolist())) == len(ours) and far.max() <= SAME:
            return float(far.max())
    one, other = moments(ours), moments(theirs)
    return float(np.abs(one - other).max() / max(one[-1, 0], other[-1, 0]))


def moments(triangles: np.ndarray) -> np.ndarray:
    """Integrals of 1, x, and x xᵀ over a surface, by the three parts of its normal and by its area (4, 13)."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a) / 2.0
    weights = np.column_stack([normal, np.linalg.norm(normal, axis=1)])
    total = a + b + c
    squares = (np.einsum("fki,fkj->fij", triangles, triangles) + np.einsum("fi,fj->fij", total, total)) / 12.0
    return weights.T @ np.column_stack([np.ones(len(a)), total / 3.0, squares.reshape(-1, 9)])


def by_trimesh(path: Path) -> np.ndarray | None:
    """The triangles (F, 3, 3) that trimesh reads, those of mirrored parts turned; None where it refuses the file."""
    try:
        scene = trimesh.load_scene(path, process=False)
        parts = [(place, scene.geometry[name]) for place, name in map(scene.graph.get, scene.graph.nodes_geometry)]
    except Exception:  # each reader behind it fails in its own way
        return None
    found = [np.empty((0, 3, 3))]
    for place, part in parts:
        if isinstance(part, trimesh.Trimesh):
            placed = part.vertices[part.faces] @ place[:3, :3].T + place[:3, 3]
            found.append(placed[:, ::-1] if np.linalg.det(place[:3, :3]) < 0 else placed)
    return np.concatenate(found)
