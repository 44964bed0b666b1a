"""The part of a link's geometry in each of its outer bodies: planes around it that are tighter than around the body.

A robot's link -> for each of its bodies the corners of the hull of its part. Every triangle of the geometry, or each of
its parts, lies in one of the bodies; it is halved until it does. So the parts' hulls together contain the link, as the
bodies do, and each lies in its body.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hdplan.distance.compiled.cache import content_key, finite, load, store
from hdplan.planner.collision.hull_distance import distance_to_hull
from hdplan.planner.collision.link_bodies import enclosed, in_joint, link_key, link_triangles
from hdplan.planner.collision.link_fit import hull_points
from hdplan.planner.collision.sphere_swept_fit import Swept
from hdplan.planner.geometry.division import halved
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy

VERSION = "1"  # to be changed with anything that changes the parts, so that old cache entries are not used
DEPTH = 60  # times that a triangle is halved, at most


def link_parts(robot: Robot, link: str, geometry: str = "fitted") -> tuple[Array, ...]:
    """Return the corners (m, 3) of the part that each body of a link (`link_bodies`) encloses, in the joint's frame
    [m]; from the cache, or found now. Empty where that cannot be shown: then the bodies alone contain the link."""
    bodies = enclosed(robot, link, geometry)
    numbers = [number for body in bodies for number in (body.vertices.tobytes(), repr(body.radius))]
    key = content_key(VERSION, link_key(robot, link), *numbers)
    parts = load("link_parts", key, lambda value: _kept(value, len(bodies)))
    if parts is None:
        parts = _parts(bodies, link_triangles(robot, link))
        store("link_parts", key, [part.tolist() for part in parts])
    return tuple(in_joint(robot, link, part) for part in parts)


def _kept(value: Any, count: int) -> list[Array]:
    """Return the parts of an entry: `count`, or none."""
    if len(value) not in (0, count):
        raise ValueError("of another link")
    return [finite(part).reshape(-1, 3) for part in value]


def _parts(bodies: tuple[Swept, ...], triangles: Array) -> list[Array]:
    if len(bodies) == 1:
        return [_corners(np.unique(triangles.reshape(-1, 3), axis=0))]
    found: list[list[Array]] = [[] for _ in bodies]
    for _ in range(DEPTH):
        corners, which = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)  # triangles share them
        within = [distance_to_hull(corners, body.vertices)[0] <= body.radius for body in bodies]
        corner = np.array(within)[:, which.ravel()].reshape(len(bodies), -1, 3)
        if not corner.any(axis=0).all():  # one sticks out: halving would continue for ever
            return []
        inside = corner.all(axis=2)  # (bodies, T)
        first = np.where(inside.any(axis=0), inside.argmax(axis=0), -1)
        for row, points in enumerate(found):
            points.append(triangles[first == row].reshape(-1, 3))
        triangles = triangles[first == -1]
        if len(triangles) == 0:
            return [_corners(np.unique(np.concatenate(points), axis=0)) for points in found]
        triangles = halved(triangles)
    return []


def _corners(points: Array) -> Array:
    """The corners of the hull of points (m, 3); all points of a flat part, or an empty one."""
    try:
        return hull_points(points)
    except (scipy.spatial.QhullError, ValueError):
        return points
