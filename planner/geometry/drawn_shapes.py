"""Triangles of simple shapes for pictures, made without other libraries: a viewer shows them before it loads more."""

from __future__ import annotations

import itertools

import numpy as np

from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import read_only

SECTIONS = 48  # of a round body about its axis
HALVES = 12  # parts of a quarter turn from a pole to the equator

_UNIT = read_only(np.array(list(itertools.product((0.0, 1.0), repeat=3))))
_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))  # outward
_SIDES = read_only(np.array([row for a, b, c, d in _FACES for row in ((a, b, c), (a, c, d))]))


def boxes_mesh(low: Array, high: Array) -> tuple[Array, Rows]:
    """Return boxes between lower and upper corners (k, 3): vertices [m] and triangles, outward."""
    vertices = low[:, None] + _UNIT * (high - low)[:, None]
    triangles = _SIDES + 8 * np.arange(len(low))[:, None, None]
    return vertices.reshape(-1, 3), triangles.reshape(-1, 3)


def drawn_box(size: tuple[float, float, float]) -> TriangleMesh:
    """Return a box of edges `size` [m] about the origin."""
    half = 0.5 * np.array([size])
    return TriangleMesh(*boxes_mesh(-half, half))


def drawn_cylinder(radius: float, length: float) -> TriangleMesh:
    """Return a cylinder along z about the origin [m], its corners on the true one."""
    half = length / 2
    return _turned(np.array([[0.0, -half], [radius, -half], [radius, half], [0.0, half]]))


def drawn_capsule(radius: float, length: float) -> TriangleMesh:
    """Return a capsule along z about the origin [m], its corners on the true one; without a length, a ball."""
    angles = np.linspace(0.0, np.pi / 2, HALVES + 1)
    upper = np.stack([radius * np.cos(angles), length / 2 + radius * np.sin(angles)], axis=1)
    upper[-1, 0] = 0.0
    profile = np.concatenate([(upper * [1.0, -1.0])[::-1], upper if length else upper[1:]])
    return _turned(profile)


def _turned(profile: Array) -> TriangleMesh:
    """Return the surface of revolution of a profile (k, 2) of radii and heights [m] about the z axis, its ends on the
    axis, upward."""
    turns = 2 * np.pi * np.arange(SECTIONS) / SECTIONS
    rings = profile[1:-1]
    round_about = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    around = rings[:, :1, None] * round_about  # (k - 2, SECTIONS, 2)
    heights = np.broadcast_to(rings[:, 1:, None], (*around.shape[:2], 1))
    vertices = np.concatenate([np.concatenate([around, heights], axis=2).reshape(-1, 3), np.zeros((2, 3))])
    vertices[-2:, 2] = profile[[0, -1], 1]
    here: Rows = np.arange(SECTIONS)
    beside = np.roll(here, -1)
    first, last = len(vertices) - 2, len(vertices) - 1
    top = (len(rings) - 1) * SECTIONS
    found = [np.stack([np.full(SECTIONS, first), beside, here], 1)]
    found.append(np.stack([np.full(SECTIONS, last), top + here, top + beside], 1))
    for low in range(0, top, SECTIONS):
        high = low + SECTIONS
        found.append(np.stack([low + here, low + beside, high + here], 1))
        found.append(np.stack([low + beside, high + beside, high + here], 1))
    return TriangleMesh(vertices, np.concatenate(found))
