"""Distances by which bodies stand out of a convex hull: mean and 95th percentile over their surface, by seeded
samples."""

from __future__ import annotations

from functools import cache

import numpy as np

from hdplan.planner.collision.hull_distance import distance_to_hull
from hdplan.planner.collision.sphere_swept_fit import Swept
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy


def outside(bodies: tuple[Swept, ...], hull_points: Array, samples: int = 400) -> tuple[float, float]:
    """Return mean and 95th percentile [m] of how far the surface of a union of bodies lies outside a convex hull.

    Seeded, area-weighted samples of each body's surface, those inside another body left out; 0 where inside the hull.
    """
    random = np.random.default_rng(0)
    points, weights = [], []
    for index, body in enumerate(bodies):
        surface, area = _surface(body, samples, random)
        free = np.ones(samples, dtype=np.bool_)
        for other in bodies[:index] + bodies[index + 1 :]:
            free &= distance_to_hull(surface, other.vertices)[0] >= other.radius
        points.append(surface[free])
        weights.append(np.full(int(free.sum()), area / samples))
    weight = np.concatenate(weights)
    distance = _distance_to_polytope(np.concatenate(points), hull_points)
    order = np.argsort(distance)
    rank = np.searchsorted(np.cumsum(weight[order]), 0.95 * weight.sum())
    return float(weight @ distance / weight.sum()), float(distance[order][min(rank, len(order) - 1)])


@cache
def _directions() -> Array:
    """Return 162 directions, evenly spread (Fibonacci)."""
    k = np.arange(162)
    z, angle = 1.0 - (2 * k + 1) / 162, k * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def _surface(body: Swept, samples: int, random: np.random.Generator) -> tuple[Array, float]:
    """Return area-weighted random points on a body's surface and its area."""
    cloud = (body.vertices[:, None] + body.radius * _directions()).reshape(-1, 3)
    hull = scipy.spatial.ConvexHull(cloud)
    a, b, c = (cloud[hull.simplices[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    pick = random.choice(len(areas), samples, p=areas / areas.sum())
    u, v = random.random((2, samples, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[pick] + u * (b - a)[pick] + v * (c - a)[pick]
    distance, weights = distance_to_hull(points, body.vertices)
    core = weights @ body.vertices
    return core + body.radius * (points - core) / distance[:, None], float(areas.sum())


def _distance_to_polytope(points: Array, hull_points: Array) -> Array:
    """Return distances (N,) to the convex hull of points (M, 3), 0 inside: the nearest over all its triangles."""
    hull = scipy.spatial.ConvexHull(hull_points)
    distance = np.zeros(len(points))
    height = hull.equations[:, :3] @ points.T + hull.equations[:, 3:]
    rows = np.nonzero(height.max(0) > 0)[0]
    triangles = hull_points[hull.simplices]
    middles = triangles.mean(1)
    reach = np.linalg.norm(triangles - middles[:, None], axis=2).max(1)
    away = scipy.spatial.distance.cdist(points[rows], middles)
    near = (away - reach <= away.min(1, keepdims=True)) & (height[:, rows].T > 0)  # the others are farther, or behind
    point, triangle = np.nonzero(near)
    import trimesh

    nearest = trimesh.triangles.closest_point(triangles[triangle], points[rows[point]])
    distance[rows] = np.inf
    np.minimum.at(distance, rows[point], np.linalg.norm(nearest - points[rows[point]], axis=1))
    return distance
