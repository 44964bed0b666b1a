"""The robot's own image in a camera: points of clouds that are near it at the start are left out, and counted.

So are points in links whose meshes have holes, as the certificate takes them for contact: those that a mesh surrounds
by more than half. Points in an obstacle with holes, such as an open box, stay: something may lie in it.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.cells import grouped
from hdplan.planner.geometry.clouds import balls_in, left_out_words
from hdplan.planner.geometry.coal_shapes import mesh_of
from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.geometry.solids import Solid
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.clouds import Cloud, Ignored
from hdplan.scenes.deadline import check_time
from hdplan.scenes.errors import InputError, naming, nearest
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.obstacles import Obstacle, Seen
from hdplan.scenes.scene import Scene, derived

CUBE_SHARE = 0.75  # of the margin: edge of the cubes whose points are settled together
# [m] coal's distance and that of its own witness points differ by more only where coal is wrong
DOUBTFUL_DIFFERENCE = 1e-5

Placed = tuple[Any, Array]  # coal's geometry, and its placement in the world (4, 4)


class Around(NamedTuple):
    """Bodies around which points are ignored."""

    about: str  # in words
    margin: float  # [m]
    solids: Sequence[Placed]
    links: bool  # of the robot: not an obstacle


@dataclass(frozen=True, eq=False)
class Ignoring:
    """A scene without the points that its clouds ignore."""

    scene: Scene
    notes: tuple[str, ...] = ()  # that count what was left out, also in reading
    points: Array = field(default_factory=lambda: np.empty((0, 3)))  # (m, 3) left out, in the world [m]


def self_filtered(requested: Scene, scene: Scene, robot: Robot) -> Ignoring:
    """Leave the points out that the clouds of a scene, as its file has it and with its files read, ignore.
    Raises InputError for a cloud of which nothing is left, and for unknown links."""
    obstacles, notes, points = [], [], []
    for written, obstacle in zip(requested.obstacles, scene.obstacles, strict=True):
        kept, words, near = obstacle, [], np.empty((0, 3))
        if isinstance(cloud := obstacle.shape, Cloud):
            unread = left_out_words(written.shape, cloud) if isinstance(written.shape, Cloud) else ""
            words = [f"cloud '{obstacle.name}': left out in reading: {unread}"] if unread else []
            if cloud.ignore_robot > 0.0 or cloud.ignore:
                with naming(scene.source):
                    kept, text, near = _left(obstacle, cloud, scene, robot)
                words += [text] if text else []
        obstacles.append(kept)
        points.append(near)
        notes += words
    if not notes:
        return Ignoring(scene)
    return Ignoring(derived(scene, obstacles=tuple(obstacles)), tuple(notes), np.concatenate(points))


def _left(obstacle: Obstacle, cloud: Cloud, scene: Scene, robot: Robot) -> tuple[Obstacle, str, Array]:
    """Return an obstacle without the points to be ignored, a note on them, and where they are in the world (m, 3)."""
    where = f"obstacles.{obstacle.name}"
    balls = balls_in(cloud)
    placement = obstacle.pose.matrix
    world = balls.array[:, :3] @ placement[:3, :3].T + placement[:3, 3]
    near, words, stay = np.zeros(len(world), dtype=bool), [], []
    for each in _ignored(cloud, scene, robot, where):
        found, held = np.zeros(len(world), dtype=bool), np.zeros(len(world), dtype=bool)
        for geometry, pose in each.solids:
            check_time("leaving out the robot's own image")
            found |= _within(geometry, pose, world, each.margin, ~(near | found))
            held |= _half_surrounded(geometry, pose, world, ~(near | found | held))
        held &= ~found
        text = f"{np.count_nonzero((found | held if each.links else found) & ~near)} within "
        text += f"{1e3 * each.margin:g} mm of {each.about}"
        if held.any() and each.links:
            found |= held
            text += f" ({np.count_nonzero(held)} of them in meshes with holes)"
        elif held.any():
            stay.append(f"; {np.count_nonzero(held)} in {each.about}, whose mesh has holes, stay")
        words.append(text)
        near |= found
    if near.all():
        raise InputError(f"{where}.cloud: all of its {len(near)} points would be ignored")
    if not near.any() and not stay:
        return obstacle, "", np.empty((0, 3))
    radius = FixedArray(balls.array[~near, 3]) if isinstance(cloud.radius, FixedArray) else cloud.radius
    kept = replace(cloud, points=FixedArray(balls.array[~near, :3]), radius=radius)
    note = f"cloud '{obstacle.name}': of {len(near)} points left out: {', '.join(words)}{''.join(stay)}"
    return replace(obstacle, shape=kept), note, world[near]


def _ignored(cloud: Cloud, scene: Scene, robot: Robot, field: str) -> Iterator[Around]:
    """Yield what points are ignored around."""
    if cloud.ignore_robot > 0.0:
        solids = _robot_at_start(robot, scene, tuple(robot.link_geometry))
        yield Around("the robot", cloud.ignore_robot, solids, links=True)
    for i, each in enumerate(cloud.ignore):
        solids = _solids(each, scene, robot, f"{field}.cloud.ignore[{i}]")
        yield Around(each.link or each.obstacle or "", each.margin, solids, links=each.link is not None)


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


def _within(geometry: Any, pose: Array, points: Array, margin: float, candidates: Mask) -> Mask:
    """Return a mask of the points (m, 3) that are within `margin` [m] of a solid, or in it. A doubtful point is not: it
    stays an obstacle.

    A distance changes by no more than one moves: that of the middle of a small cube settles most of the points in it.
    """
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    geometry.computeLocalAABB()
    box = geometry.aabb_local
    found: Mask = candidates & ((local >= box.min_ - margin) & (local <= box.max_ + margin)).all(axis=1)
    rows = np.flatnonzero(found)
    if len(rows) and margin > 0.0:
        order, first = grouped(local[rows], CUBE_SHARE * margin)
        rows, count = rows[order], np.diff(np.append(first, len(rows)))
        low, high = np.minimum.reduceat(local[rows], first), np.maximum.reduceat(local[rows], first)
        middle = 0.5 * (low + high)
        away = np.linalg.norm(local[rows] - np.repeat(middle, count, axis=0), axis=1)
        least, most = (np.repeat(each, count) for each in _distances(geometry, middle))
        found[rows] = most + away <= margin
        rows = rows[(most + away > margin) & (least - away <= margin)]
    _, distance = _distances(geometry, local[rows])
    found[rows] = distance <= margin
    if isinstance(geometry, coal.BVHModelBase):  # whose distances are those of its surface
        rows = np.flatnonzero(candidates & ~found & ((local >= box.min_) & (local <= box.max_)).all(axis=1))
        if len(rows) and not (solid := _solid(geometry)).open:
            found[rows] = [solid.holds(point) for point in local[rows]]
    return found


def _half_surrounded(geometry: Any, pose: Array, points: Array, candidates: Mask) -> Mask:
    """Return a mask of the points (m, 3) that a mesh with holes surrounds by more than half; none for other solids, and
    for one-sided meshes, which have no inside."""
    found = np.zeros(len(points), dtype=bool)
    if not isinstance(geometry, coal.BVHModelBase) or not (solid := _solid(geometry)).open:
        return found
    if not solid.shells.one_sided.any():
        low, high = solid.box
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        rows = np.flatnonzero(candidates & ((local >= low) & (local <= high)).all(axis=1))
        found[rows] = [solid.holds(point) for point in local[rows]]
    return found


@functools.lru_cache(maxsize=64)
def _solid(geometry: Any) -> Solid:
    """Return the solid that a mesh bounds."""
    return Solid(mesh_of(geometry))


def _distances(geometry: Any, points: Array) -> tuple[Array, Array]:
    """Return bounds (k,) [m] of the distances of points (k, 3) from a solid, 0 inside: those of coal, and where it
    contradicts itself 0 and infinity."""
    point, request, result = coal.Sphere(0.0), coal.DistanceRequest(), coal.DistanceResult()
    here, least, most = coal.Transform3s(np.eye(3), np.zeros(3)), np.zeros(len(points)), np.zeros(len(points))
    for row, place in enumerate(points):
        result.clear()
        value = coal.distance(geometry, here, point, coal.Transform3s(np.eye(3), place), request, result)
        away = float(np.linalg.norm(result.getNearestPoint1() - place))
        sure = abs(away - abs(value)) <= DOUBTFUL_DIFFERENCE  # false for what is not a number, too
        least[row], most[row] = (max(value, 0.0), max(value, 0.0)) if sure else (0.0, np.inf)
    return least, most
