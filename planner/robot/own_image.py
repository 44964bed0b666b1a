"""What a camera sees of the robot itself: points of clouds that are near it at the start are left out, and counted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.clouds import load_balls
from hdplan.planner.geometry.shapes import operations
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.clouds import Cloud, Ignored
from hdplan.scenes.deadline import check_time
from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.obstacles import Obstacle, Seen
from hdplan.scenes.scene import Scene

DOUBTFUL = 1e-6  # [m] coal's distance and that of its own witness points differ by more only where coal is wrong

Placed = tuple[Any, Array]  # coal's geometry, and its placement in the world (4, 4)


def without_own_image(scene: Scene, robot: Robot) -> tuple[Scene, tuple[str, ...]]:
    """Return the scene with the points left out that its clouds ask to ignore, and notes that count them. Raises
    InputError for a cloud that cannot be read, or of which nothing is left, and for unknown links."""
    obstacles, notes = [], []
    for obstacle in scene.obstacles:
        kept, words = obstacle, ""
        if isinstance(obstacle.shape, Cloud) and (obstacle.shape.ignore_robot > 0.0 or obstacle.shape.ignore):
            with naming(scene.source):
                kept, words = _left(obstacle, obstacle.shape, scene, robot)
        obstacles.append(kept)
        notes += [words] if words else []
    return (replace(scene, obstacles=tuple(obstacles)), tuple(notes)) if notes else (scene, ())


def _left(obstacle: Obstacle, cloud: Cloud, scene: Scene, robot: Robot) -> tuple[Obstacle, str]:
    """Return an obstacle without the points to be ignored, and a note on them."""
    field = f"obstacles.{obstacle.name}"
    balls = load_balls(cloud, field)
    placement = obstacle.pose.matrix
    world = balls.array[:, :3] @ placement[:3, :3].T + placement[:3, 3]
    near, words = np.zeros(len(world), dtype=bool), []
    for about, margin, solids in _ignored(cloud, scene, robot, field):
        found = np.zeros(len(world), dtype=bool)
        for geometry, pose in solids:
            check_time("leaving out the robot's own image")
            found |= _within(geometry, pose, world, margin, ~(near | found))
        words.append(f"{np.count_nonzero(found & ~near)} within {1e3 * margin:g} mm of {about}")
        near |= found
    if near.all():
        raise InputError(f"{field}.cloud: all of its {len(near)} points are to be ignored")
    if not near.any():
        return obstacle, ""
    kept = replace(cloud, points=FixedArray(balls.array[~near, :3]), radius=_radius(cloud, balls.array[~near, 3]))
    return replace(obstacle, shape=kept), f"cloud '{obstacle.name}': of {len(near)} points left out: {', '.join(words)}"


def _radius(cloud: Cloud, left: Array) -> float | FixedArray:
    """Return the radii (m,) that are left, as the cloud has them."""
    several = isinstance(cloud.radius, FixedArray) or isinstance(cloud.points, DepthImage)
    return FixedArray(left) if several else cloud.radius


def _ignored(cloud: Cloud, scene: Scene, robot: Robot, field: str) -> Iterator[tuple[str, float, Sequence[Placed]]]:
    """Yield what points are ignored around: words, the margin [m], and geometries."""
    if cloud.ignore_robot > 0.0:
        yield "the robot", cloud.ignore_robot, _robot_at_start(robot, scene, tuple(robot.link_geometry))
    for i, each in enumerate(cloud.ignore):
        yield each.link or each.obstacle or "", each.margin, _solids(each, scene, robot, f"{field}.cloud.ignore[{i}]")


def _solids(ignored: Ignored, scene: Scene, robot: Robot, field: str) -> Sequence[Placed]:
    if ignored.link is not None:
        if ignored.link not in robot.link_geometry:
            allowed = nearest(ignored.link, robot.link_geometry)
            raise InputError(f"{field}.link: unknown link '{ignored.link}'{allowed}")
        return _robot_at_start(robot, scene, (ignored.link,))
    other = next(other for other in scene.obstacles if other.name == ignored.obstacle)
    if isinstance(other.shape, Seen):
        raise InputError(f"{field}.obstacle: '{other.name}' has no shape itself; name an obstacle with one")
    return [(operations(other.shape).coal(other.shape, f"obstacles.{other.name}"), other.pose.matrix)]


def _robot_at_start(robot: Robot, scene: Scene, links: tuple[str, ...]) -> Sequence[Placed]:
    """Return the geometry of links and held objects where the scene's motion starts."""
    data, geometry = robot.model.createData(), robot.collision.createData()
    q = robot.pin_q(robot.configuration(scene.start, scene.from_request))
    pin.updateGeometryPlacements(robot.model, data, robot.collision, geometry, q)
    return [
        (robot.collision.geometryObjects[i].geometry, geometry.oMg[i].homogeneous)
        for link in links
        for i in robot.link_geometry[link]
    ]


def _within(geometry: Any, pose: Array, points: Array, margin: float, asked: Mask) -> Mask:
    """Tell which of the points (m, 3) are within `margin` [m] of a solid. A doubtful point is not: it stays an
    obstacle."""
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    found: Mask = asked & ((local >= box.min_ - margin) & (local <= box.max_ + margin)).all(axis=1)
    point, request, result = coal.Sphere(0.0), coal.DistanceRequest(), coal.DistanceResult()
    here = coal.Transform3s(np.eye(3), np.zeros(3))
    for row in np.flatnonzero(found).tolist():
        result.clear()
        value = coal.distance(geometry, here, point, coal.Transform3s(np.eye(3), local[row]), request, result)
        away = float(np.linalg.norm(result.getNearestPoint1() - local[row]))
        found[row] = value <= margin and (value <= 0.0 or abs(away - value) <= DOUBTFUL)
    return found
