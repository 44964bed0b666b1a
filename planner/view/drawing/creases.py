"""Meshes as browsers light them: light is smoothed across vertices that faces share, so that these are doubled along
sharp edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.geometry.meshes import connected
from hdplan.scenes.array_types import Array, Rows

FLAT = 1e-3  # [rad] up to which neighbouring faces are one flat face
LARGE = 0.1  # of a mesh's area, of a flat face that is not smoothed into its neighbours
SHARP = 0.6  # [rad] edges between faces that turn more than this are drawn sharp
SAME_PLACE = 1e-8  # in units of the mesh: about as far apart are vertices that are one


def creased(vertices: Array, triangles: Rows) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return vertices (m, 3) and triangles (F, 3) with the vertices doubled along sharp edges."""
    vertices, faces = _merged(vertices, triangles)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    length = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    areas = 0.5 * length
    normals /= np.maximum(length, np.finfo(float).tiny)[:, None]
    one, other = _beside(faces, len(vertices))
    turn = np.arccos(np.clip(np.einsum("ij,ij->i", normals[one], normals[other]), -1.0, 1.0))
    even = turn < FLAT
    flat = connected(one[even], other[even], len(faces))
    large = np.bincount(flat, areas)[flat] > LARGE * areas.sum()  # flat faces whose light stays even
    group = np.where(large, flat, -1)
    smooth = (turn < SHARP) & (group[one] == group[other])
    corners = connected(one[smooth], other[smooth], len(faces))[:, None].astype(np.int64) * len(vertices) + faces
    found, own = np.unique(corners, return_inverse=True)
    return vertices[found % len(vertices)].astype(np.float32), own.reshape(faces.shape).astype(np.uint32)


def _merged(vertices: Array, triangles: Rows) -> tuple[Array, Rows]:
    """Return vertices and triangles, those that are in one place merged."""
    steps = np.round(vertices / SAME_PLACE)
    order = np.lexsort(steps.T)
    new = np.ones(len(order), dtype=bool)
    new[1:] = (steps[order[1:]] != steps[order[:-1]]).any(axis=1)
    index = np.empty(len(order), dtype=np.int64)
    index[order] = np.cumsum(new) - 1
    return vertices[order[new]], index[triangles]


def _beside(faces: Rows, count: int) -> tuple[Rows, Rows]:
    """Return the pairs of faces that share an edge which no third one has, of `count` vertices."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    edges = ends.min(axis=1) * count + ends.max(axis=1)
    order = np.argsort(edges, kind="stable")
    edges = np.concatenate([[-1], edges[order], [-1]])
    twice = np.flatnonzero((edges[1:-2] == edges[2:-1]) & (edges[:-3] != edges[1:-2]) & (edges[3:] != edges[2:-1]))
    return order[twice] // 3, order[twice + 1] // 3
