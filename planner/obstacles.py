"""Obstacles for the planner: a scene's shape → convex bodies in the obstacle's frame.

A box, sphere, capsule and point set stay what they are; a cylinder becomes the prism around it; a convex mesh its hull;
any other mesh is taken apart into convex pieces. The pieces follow the mesh closely but not exactly: they are for the
planner alone, the certificate works with the triangles themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import coacd
import numpy as np
from numpy.typing import NDArray

from hdplan.distance.bodies import ConvexBody
from hdplan.planner.meshes import TriangleMesh, load_mesh
from hdplan.scenes.model import Box, Capsule, Cylinder, Mesh, Obstacle, Points, Sphere

CONCAVITY = 0.03  # how deep a dent a convex piece may bridge, as part of the mesh's size (coacd's threshold)


@dataclass(frozen=True, eq=False)
class ObstacleBodies:
    """What an obstacle is to the planner."""

    name: str
    bodies: tuple[ConvexBody, ...]  # in the obstacle's frame
    pose: NDArray[np.float64]  # (4, 4) of that frame in the world
    notes: tuple[str, ...] = ()  # what was made of its shape, in words


def obstacle_bodies(obstacle: Obstacle) -> ObstacleBodies:
    """Return the convex bodies of `obstacle`. Raises InputError for a mesh file that cannot be used."""
    notes: tuple[str, ...] = ()
    match obstacle.shape:
        case Box(size):
            bodies: tuple[ConvexBody, ...] = (ConvexBody.box(size),)
        case Sphere(radius):
            bodies = (ConvexBody.sphere(radius),)
        case Cylinder(radius, length):
            bodies = (ConvexBody.cylinder(radius, length),)
        case Capsule(radius, length):
            bodies = (ConvexBody.capsule(radius, length),)
        case Points(points):
            bodies = (ConvexBody.from_points(points),)
        case Mesh() as shape:
            pieces = convex_pieces(load_mesh(shape, f"obstacles.{obstacle.name}"))
            bodies = tuple(ConvexBody.from_points(piece) for piece in pieces)
            if len(pieces) > 1:
                notes = (f"obstacle '{obstacle.name}': mesh {shape.file.name} split into {len(pieces)} convex pieces",)
    return ObstacleBodies(obstacle.name, bodies, obstacle.pose.matrix, notes)


def convex_pieces(mesh: TriangleMesh) -> tuple[NDArray[np.float64], ...]:
    """Return point sets (m, 3) whose convex hulls together stand for `mesh`: exactly, if its loose parts are convex."""
    parts = mesh.components()
    if all(part.convex and part.volume > 0 for part in parts):
        return tuple(part.vertices for part in parts)
    coacd.set_log_level("error")
    pieces = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.triangles), threshold=CONCAVITY, seed=0)
    return tuple(np.array(vertices, dtype=np.float64) for vertices, _ in pieces)
