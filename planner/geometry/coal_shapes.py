"""Points and triangles as coal's geometries: convex hulls, and bounding volume hierarchies of meshes."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import coal
import numpy as np

from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.once import ForkSafeLock, read_only

KEPT_MESHES = 64  # whose corners stay in memory
_read: OrderedDict[bytes, tuple[tuple[Any, Rows], ...]] = OrderedDict()  # by vertices: copies, and their corners
_reading = ForkSafeLock()


def convex_hull(points: Array) -> Any | None:
    """Return coal's hull of points (m, 3) that are not flat; None where a corner has more than 255 neighbours, such as
    a cone's tip or the centre of a round face: coal stores their number in a byte."""
    try:
        return coal.Convex.convexHull(_points(points), True, "Qt")
    except RuntimeError as error:
        if "Too many neighbors" in str(error):
            return None
        raise


def hull_triangles(points: Array) -> TriangleMesh:
    """Return the triangles of the hull of points (m, 3) that are not flat, outward."""
    hull = convex_hull(points)
    return TriangleMesh.hull(points) if hull is None else sides_of(hull)


def sides_of(hull: Any) -> TriangleMesh:
    """Return the triangles of one of coal's hulls, outward."""
    corners = np.array([[t[0], t[1], t[2]] for t in map(hull.polygons, range(hull.num_polygons))], dtype=np.int64)
    points = np.array(hull.points())
    a, b, c = np.moveaxis(points[corners], 1, 0)
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a - points.mean(axis=0)) > 0
    return TriangleMesh(points, np.where(outward[:, None], corners, corners[:, ::-1])).trimmed()


def triangle(corners: Array) -> Any:
    """Return one triangle (3, 3) as a flat hull: coal measures its own triangles against few other shapes."""
    sides = coal.StdVec_Triangle()
    sides.extend([coal.Triangle(0, 1, 2), coal.Triangle(0, 2, 1)])
    return coal.Convex(_points(corners), sides)


def triangle_tree(mesh: TriangleMesh) -> Any:
    """Return coal's bounding volume hierarchy of a mesh's triangles."""
    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(mesh.triangles), len(mesh.vertices))
    tree.addVertices(mesh.vertices)
    tree.addTriangles(mesh.triangles)
    tree.endModel()
    return tree


def mesh_of(tree: Any) -> TriangleMesh:
    """Return the triangles of a hierarchy as coal or Pinocchio made it, with those vertices that they use."""
    return TriangleMesh.merged(tree.vertices(), corners_of(tree)).trimmed()


def corners_of(tree: Any) -> Rows:
    """Return the corners (F, 3) of a hierarchy's triangles, as rows of its vertices: read once for all equal ones, as
    coal tells them one by one."""
    key = np.array(tree.vertices()).tobytes()
    for kept, corners in _read.get(key, ()):
        if kept == tree:
            return corners
    corners = read_only(np.array([[t[0], t[1], t[2]] for t in map(tree.tri_indices, range(tree.num_tris))], np.int64))
    with _reading:
        _read[key] = (*_read.get(key, ()), (tree.clone(), corners))
        while len(_read) > KEPT_MESHES:
            _read.popitem(last=False)
    return corners


def _points(rows: Array) -> Any:
    points = coal.StdVec_Vec3s()
    points.extend(list(rows))
    return points
