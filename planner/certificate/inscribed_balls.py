"""Balls inside the links, which no obstacle may enter.

A ball lies inside a solid if its centre does and no triangle of the solid's surface is closer than its radius. The
centre is a proposal, the deepest point of a grid, moved on to where it is deeper; the radius is a proven lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.exact_proximity import KEPT_MESHES, PIECES, Piece, Surface, hull_piece
from hdplan.planner.certificate.part_distance import distance
from hdplan.planner.certificate.solids import link_bodies
from hdplan.planner.geometry.division import divided
from hdplan.planner.geometry.meshes import FLAT_RATIO, TriangleMesh, thinness
from hdplan.planner.geometry.solids import Solid
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.once import ReadOnly, made_once
from hdplan.scenes.shapes import Sphere

FINENESS = 16  # edges of the surface's triangles after division, over the size of the mesh
GRID_SIDE = 9  # points a side, in the bounding box
DEEPENING_STEPS = 16  # moves to deeper points, each shorter by STEP_FACTOR than the last
STEP_FACTOR = 0.75
GRID_POINTS = 150  # points of the grid of which one must be inside
SMALLEST_RADIUS = 1e-3  # [m] smaller balls are of no use
RADIUS_ROUNDING = 1e-9  # [m] by which a ball is smaller


@dataclass(frozen=True, eq=False)
class InscribedBall(ReadOnly):
    """A ball inside the collision geometry of a link."""

    body: int  # row of the robot's bodies
    center: Array  # (3,) in the frame of the joint that carries it
    radius: float  # [m]


@made_once(8)
def inscribed_balls(robot: Robot) -> tuple[InscribedBall, ...]:
    """Return the largest ball that was found on each joint, the largest first; once per robot."""
    largest: dict[int, InscribedBall] = {}
    for row, body in enumerate(link_bodies(robot)):
        if body.joint == 0 or (found := inscribed_ball(body.piece)) is None:
            continue
        center, radius = found
        if body.joint not in largest or radius > largest[body.joint].radius:
            placed = body.placement[:3, :3] @ center + body.placement[:3, 3]
            largest[body.joint] = InscribedBall(row, placed, radius)
    return tuple(sorted(largest.values(), key=lambda ball: -ball.radius))


@made_once(KEPT_MESHES)
def inscribed_ball(piece: Piece) -> tuple[Array, float] | None:
    """Return the centre (3,) and radius [m] of a ball inside the solid of a link's piece, in its frame; None where none
    is known to be inside, as in open meshes."""
    middle = piece.vertices.mean(axis=0)
    if piece.radii is not None:
        radius = float(piece.radii.min())
    elif piece.disc:
        radius = min(piece.disc, 0.5 * float(np.ptp(piece.vertices[:, 2])))
    elif piece.ball:
        radius = piece.ball
    else:
        if piece.surface is not None:
            return _inside(piece.surface.solid)
        return None if thinness(piece.vertices) <= FLAT_RATIO else _inside(Solid(TriangleMesh.hull(piece.vertices)))
    return (middle, radius) if piece.grains is None and radius >= SMALLEST_RADIUS else None


@made_once(KEPT_MESHES)
def _inside(solid: Solid) -> tuple[Array, float] | None:
    if solid.open or solid.shells.one_sided.any():  # a point of which it is not certain whether it is inside
        return None
    mesh = solid.mesh
    (low, high), corners = solid.box, mesh.vertices[mesh.triangles]
    size = float((high - low).max())
    tree = scipy.spatial.cKDTree(divided(corners, size / FINENESS).mean(axis=1))
    axes = (np.linspace(a, b, GRID_SIDE + 2)[1:-1] for a, b in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    deepest = grid[np.argsort(-tree.query(grid)[0])[:GRID_POINTS]]
    center = next((point for point in deepest if solid.holds(point)), None)
    if center is None:
        return None
    step, around = (
        size / GRID_SIDE,
        np.stack(np.meshgrid(*3 * [[0.0, -1.0, 1.0]], indexing="ij"), axis=-1).reshape(-1, 3),
    )
    for _ in range(DEEPENING_STEPS):
        tried = center + step * around
        center, step = tried[int(tree.query(tried)[0].argmax())], STEP_FACTOR * step
    if not solid.holds(center):
        return None
    place = np.eye(4)
    place[:3, 3] = center
    (least,), whole = PIECES[Sphere](radius=SMALLEST_RADIUS), hull_piece(mesh.vertices, Surface(mesh, solid))
    radius = SMALLEST_RADIUS + distance(least, place, whole, np.eye(4)) - RADIUS_ROUNDING
    return (center, radius) if radius >= SMALLEST_RADIUS else None
