"""Numbers, frames and shapes as a world writes them: plain lists, each group of worked-out numbers with its bound.

The bound: hdplan takes quaternions within 1e-12 (`poses.EXACT`) of unit length as they are, so that a rotation is off
by 4e-12 at most, a robot on a base by as much times its distance from there, an inertia turned twice by 8e-12 of it;
urdfdom, Pinocchio and trimesh add some hundreds of roundings of 1.1e-16. So a group is within BOUND times 1 + its
largest number, where what it was made from was not far larger.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from hdplan.planner.geometry.clouds import balls_in
from hdplan.planner.geometry.meshes import ReadMesh, TriangleMesh
from hdplan.planner.geometry.shape_table import operations, shape_of
from hdplan.planner.geometry.voxel_grids import boxes_in
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.obstacles import Seen
from hdplan.scenes.once import read_only
from hdplan.scenes.poses import IDENTITY, Pose
from hdplan.scenes.shapes import Points, Shape
from hdplan.scenes.voxel_grids import OctoMap, Voxels

Plain = dict[str, Any]

BOUND = 2e-11  # of the error of computed numbers, `off` in docs/world.md
CORNERS = read_only(np.array(list(itertools.product((-1.0, 1.0), repeat=3))))  # of a box


def numbers(values: Any) -> Any:
    """Return an array or a row of numbers, or a number, as plain lists."""
    return np.asarray(values, dtype=np.float64).tolist()


def bounds(values: Iterable[float]) -> list[float | None]:
    """Return numbers of which infinite ones bound nothing, and are None."""
    return [None if math.isinf(value) else float(value) for value in values]


def off(*values: Any) -> float:
    """Return the bound on the error of a group's numbers."""
    return BOUND * (1.0 + max(float(np.abs(each).max()) for each in values))


def frame(rotation: Array, position: Array, *others: Any) -> Plain:
    """Return a frame that was worked out, in one group with `others`."""
    return {
        "rotation": numbers(np.ravel(rotation)),
        "position": numbers(position),
        "off": off(rotation, position, *others),
    }


def frame_of(pose: Pose) -> Plain:
    """Return a scene's pose: exact if it is not turned."""
    turned = pose.quaternion_xyzw != IDENTITY.quaternion_xyzw
    found = frame(pose.matrix[:3, :3], np.array(pose.position))
    return found if turned else {**found, "off": 0.0}


def plain_shape(shape: Shape | Seen) -> Plain:
    """Return the shape of an obstacle or a held object whose file was read."""
    if isinstance(shape, Cloud):
        balls = balls_in(shape).array
        found = _swept(balls[:, :3], np.repeat(balls[:, 3:], 3, axis=1), np.arange(len(balls))[:, None])
        return {**found, "off": off(balls)}  # as those of a depth image are worked out
    if isinstance(shape, Voxels | OctoMap):
        boxes = boxes_in(shape).array
        corners = np.where(CORNERS > 0, boxes[:, None, 3:], boxes[:, None, :3])
        found = _swept(corners.reshape(-1, 3), np.zeros((1, 3)), np.arange(8 * len(boxes)).reshape(-1, 8))
        return {**found, "off": off(corners)}
    outline = operations(shape).outline  # refuses what it does not know
    if isinstance(shape, ReadMesh):
        return plain_mesh(ordered(shape.mesh))
    if isinstance(shape, Points):
        return _swept(np.array(shape.points))
    if outline is None:
        raise TypeError(f"no world can hold a {type(shape).__name__}")
    body = outline.swept(shape)
    sweeps = np.array([[body.disc, body.disc, 0.0], body.radii, [body.ball] * 3])
    if sweeps.any(axis=1).sum() > 1:  # of which the sum is no ellipsoid
        raise TypeError(f"no world can hold a {type(shape).__name__}, which two solids sweep")
    return _swept(body.vertices, sweeps.max(axis=0)[None])


def _swept(points: Array, sweep: Array | None = None, parts: Rows | None = None) -> Plain:
    """Return the hulls of parts of points (F, c), or of all points, swept by ellipsoids (F, 3), or by one."""
    return {"points": points, "parts": parts, "sweep": np.zeros((1, 3)) if sweep is None else sweep, "off": 0.0}


def plain_geometry(geometry: Any) -> Plain:
    """Return the collision geometry of a link that is no hierarchy of triangles."""
    shape = shape_of(geometry)
    if shape is None:
        raise TypeError(f"unknown geometry of coal: {type(geometry).__name__}")
    return plain_shape(shape)


def ordered(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh with its points in the order in which its triangles name them first, without others."""
    used, first, corner = np.unique(mesh.triangles, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return TriangleMesh(mesh.vertices[used[order]], place[corner.reshape(-1, 3)])


def plain_mesh(mesh: TriangleMesh) -> Plain:
    """Return a mesh whose points are `ordered`."""
    return {**_swept(mesh.vertices, parts=mesh.triangles), "off": off(mesh.vertices)}
