"""Bodies as the planner's distance wants them on its second side: planes with exact supports, in a tight box's frame.

In: scene shapes or outer link bodies. Out: PlaneBody: unit normals n_k and supports h(n_k) = max_{b in B} n_k·b, exact for the
shape itself (a true cylinder, not a polygon). What the planes enclose is slightly more than the shape (an outer body).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.halfspaces import FAR, box_directions
from hdplan.scenes.model import Box, Capsule, Cylinder, Points, Shape, Sphere

Floats = NDArray[np.float64]

FEW, MANY = 26, 48  # plane slots: box-like bodies and everything else; one compiled kernel each


@dataclass(frozen=True)
class PlaneBody:
    """The intersection of half-spaces n_k · y ≤ h_k around a convex body."""

    name: str  # of the obstacle or link
    parent: int  # joint that carries it; -1 if it stands in the world
    placement: Floats  # (4, 4) of the body's own frame in its parent's frame [m]
    normals: Floats  # (K, 3) unit normals in the body's frame, K = FEW or MANY
    supports: Floats  # (K,) [m]
    half_size: Floats  # (3,) of the body's box, which is centred in its frame [m]


def from_shape(name: str, shape: Shape, placement: Floats) -> PlaneBody:
    """Enclose a scene shape that stands at `placement` in the world. Meshes come as the convex Points of their pieces."""
    match shape:
        case Box(size):
            half = np.array(size) / 2
            normals = box_directions()
            return PlaneBody(name, -1, placement, normals, np.abs(normals) @ half, half)
        case Sphere(radius):
            normals = _fibonacci(MANY)
            return PlaneBody(name, -1, placement, normals, np.full(len(normals), radius), np.full(3, radius))
        case Cylinder(radius, length):
            normals = _ring_directions()
            supports = radius * np.hypot(normals[:, 0], normals[:, 1]) + length / 2 * np.abs(normals[:, 2])
            return PlaneBody(name, -1, placement, normals, supports, np.array([radius, radius, length / 2]))
        case Capsule(radius, length):
            normals = _ring_directions()
            supports = radius + length / 2 * np.abs(normals[:, 2])
            return PlaneBody(name, -1, placement, normals, supports, np.array([radius, radius, length / 2 + radius]))
        case Points(points):
            return from_points(name, -1, placement, np.array(points), 0.0)
    raise TypeError(f"{name}: a {type(shape).__name__} has to be split into convex pieces first")


def from_points(name: str, parent: int, placement: Floats, points: Floats, radius: float) -> PlaneBody:
    """Enclose the hull of points (m, 3), swept by a ball of `radius`: the hull's box directions and, where the hull is not a box,
    its largest faces."""
    frame = _box_frame(points)
    local = (points - frame[:3, 3]) @ frame[:3, :3]
    normals = np.vstack([box_directions(), _face_normals(local)])
    supports = (normals @ local.T).max(axis=1) + radius
    slots = FEW if len(normals) <= FEW else MANY
    normals, supports = _fill(normals[:slots], supports[:slots], slots)
    return PlaneBody(name, parent, placement @ frame, normals, supports, np.abs(local).max(axis=0) + radius)


def from_link_body(link: str, joint: int, body: ConvexBody) -> PlaneBody:
    """Enclose an outer link body by the 26 directions of its box; its frame moves with `joint`."""
    frame = _box_frame(body.vertices)
    local = (body.vertices - frame[:3, 3]) @ frame[:3, :3]
    normals = box_directions()
    supports = (normals @ local.T).max(axis=1) + body.radius
    return PlaneBody(link, joint, frame, normals, supports, np.abs(local).max(axis=0) + body.radius)


def _fill(normals: Floats, supports: Floats, slots: int) -> tuple[Floats, Floats]:
    """Fill unused slots with a plane so far behind that it never decides."""
    spare = slots - len(normals)
    return np.vstack([normals, np.tile([0.0, 0.0, 1.0], (spare, 1))]), np.append(supports, np.full(spare, FAR))


def _box_frame(points: Floats) -> Floats:
    """A frame (4, 4) in which the points' box is centred and aligned with their principal axes."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2].T
    if np.linalg.det(axes) < 0:
        axes[:, 2] = -axes[:, 2]
    local = points @ axes
    frame = np.eye(4)
    frame[:3, :3] = axes
    frame[:3, 3] = axes @ ((local.min(axis=0) + local.max(axis=0)) / 2)
    return frame


def _face_normals(points: Floats) -> Floats:
    """Normals of the hull's faces (F, 3), largest area first, none that a box direction already gives; empty for flat hulls."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return np.empty((0, 3))
    triangles = points[hull.simplices]
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    kept: list[Floats] = []
    known = box_directions()
    for index in np.argsort(-areas, kind="stable"):
        normal = hull.equations[index, :3]
        if (known @ normal).max() < 1 - 1e-9:
            kept.append(normal)
            known = np.vstack([known, normal])
    return np.array(kept).reshape(-1, 3)


def _ring_directions() -> Floats:
    """26 directions around the z axis: both ends, 12 sideways, 6 slanted up and 6 down at 45 degrees."""
    around = np.arange(12) * np.pi / 6
    sideways = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    slanted = np.stack([np.cos(around[::2]), np.sin(around[::2]), np.ones(6)], axis=1) / np.sqrt(2)
    return np.vstack([[[0, 0, 1.0], [0, 0, -1.0]], sideways, slanted, slanted * [1, 1, -1]])


def _fibonacci(count: int) -> Floats:
    """Evenly spread unit directions (count, 3)."""
    index = np.arange(count) + 0.5
    height, around = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    return np.stack([ring * np.cos(around), ring * np.sin(around), height], axis=1)
