"""Clouds, maps and surfaces of meshes for the planner: boxes around the cells of a grid, grown by the balls' radii, and
the boxes of maps. Together they contain every ball, every cell and every triangle (outer bodies)."""

from __future__ import annotations

import math

import numpy as np

from hdplan.distance.compiled.loops import twin_of
from hdplan.planner.collision.halfspace_bodies import HalfspaceBody, few_directions
from hdplan.planner.collision.pieces import Pieces, Planes
from hdplan.planner.geometry.cells import CellBoxes, axes_of, cells_of, grouped
from hdplan.planner.geometry.cells_loop import cell_boxes as by_loop
from hdplan.planner.geometry.clouds import balls_in, merged, reach
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.once import made_once, read_only
from hdplan.scenes.poses import Pose

CELL, SMALL_CELL = 0.08, 0.04  # [m] edges of the cubes; the small ones for where the others leave no way
MOST_TRIANGLES = 100_000  # of a surface when it is cut, about: larger cells are taken for a larger one,
CELL_GROWTH = 1.25  # by this factor
SLIVER = math.log2(3.0)  # halving the two long sides of a triangle without area makes three of it
MOST_HALVINGS = 40  # of a triangle, at most
FARTHEST_POINT = 1000.0  # [m] a cloud that reaches farther was hardly meant in metres


def from_cloud(
    name: str, cloud: Cloud, pose: Pose, planes: str, closely: bool = False
) -> tuple[tuple[HalfspaceBody, ...], tuple[str, ...]]:
    """Enclose a cloud that was read and stands at `pose` in the world: bodies, and notes on what was merged and what
    can hardly be meant."""
    balls, notes = balls_in(cloud), []
    if (far := reach(balls.array)) > FARTHEST_POINT:
        notes.append(f"reaches as far as {far:.0f} m: is it in millimetres? hdplan takes metres")
    if cloud.voxel is not None:
        count = len(balls)
        balls, added = merged(balls, cloud.voxel)
        notes.append(f"{count} points planned around as {len(balls)} balls, up to {1e3 * added:.3g} mm larger")
    return from_balls(name, balls, pose, planes, closely), tuple(f"cloud '{name}': {words}" for words in notes)


def pieces_of(name: str, cloud: Cloud, pose: Pose, planes: str, within: Array) -> Pieces:
    """Enclose a cloud that was read by small cells, for one use: nothing is cached, nothing is noted. Left out is what
    touches none of the balls (k, 4) in the world [m]."""
    assert isinstance(cloud.points, FixedArray)
    points, radius = cloud.points.array, cloud.radius
    radii = radius.array if isinstance(radius, FixedArray) else np.full(len(points), radius)
    if cloud.voxel is not None:
        found = merged(balls_in(cloud), cloud.voxel)[0].array
        points, radii = found[:, :3], found[:, 3]
    placement = pose.matrix
    local = np.column_stack([(within[:, :3] - placement[:3, 3]) @ placement[:3, :3], within[:, 3]])
    normals, supports, box, half = _planes(cell_boxes(points, radii, SMALL_CELL, local), pose, planes)
    count = len(half)
    every = (Planes(np.arange(count), normals, supports),) if count else ()
    known = (few_directions(planes),) if count else ()
    return Pieces((name,) * count, np.zeros(count, np.int64), every, box, half, (None,) * count, box, known)


@twin_of(by_loop)
def cell_boxes(points: Array, radii: Array, edge: float, balls: Array) -> CellBoxes:
    """Return boxes around the points (m, 3), with radii (m,), in each cell, but for those that touch none of the balls
    (k, 4)."""
    near = np.zeros(len(points), dtype=np.bool_)
    for ball in balls:
        near |= np.linalg.norm(points - ball[:3], axis=1) <= ball[3] + radii
    points, radii = points[near], radii[near]
    if not len(points):
        nothing = np.empty((0, 3))
        return CellBoxes(np.empty((0, 3, 3)), nothing, nothing, np.empty(0))
    order, first = grouped(points, edge)
    found = points[order]
    rotation = axes_of(found, first)
    return CellBoxes(rotation, *_extents(found, first, rotation), np.maximum.reduceat(radii[order], first))


@made_once(4)
def from_balls(
    name: str, balls: FixedArray, pose: Pose, planes: str, closely: bool = False
) -> tuple[HalfspaceBody, ...]:
    """Enclose balls (m, 4), centres and radii [m] in a frame that stands at `pose` in the world: one body for each
    cell, a small one if they are to be enclosed `closely`."""
    cells = cells_of(balls, SMALL_CELL if closely else CELL)
    found = balls.array[cells.order]
    radius = np.maximum.reduceat(found[:, 3], cells.first)
    boxes = CellBoxes(cells.rotation, *_extents(found[:, :3], cells.first, cells.rotation), radius)
    return _bodies(name, boxes, pose, planes)


@made_once(4)
def from_surface(
    name: str, mesh: TriangleMesh, pose: Pose, planes: str, closely: bool = False
) -> tuple[HalfspaceBody, ...]:
    """Enclose the surface of a mesh that stands at `pose` in the world, and nothing of what it bounds: one body for
    each cell, a small one if it is to be enclosed `closely`."""
    import trimesh

    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())  # twice that of the triangles
    long = np.linalg.norm([b - a, c - b, a - c], axis=2).max(axis=0)
    edge = SMALL_CELL if closely else CELL
    while area / edge**2 + ((long[long > edge] / edge) ** SLIVER).sum() > MOST_TRIANGLES:
        edge *= CELL_GROWTH
    vertices, triangles = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.triangles, edge, max_iter=MOST_HALVINGS)
    corners = vertices[triangles]  # (F, 3, 3)
    order, first = grouped(corners.mean(axis=1), edge)
    found, first = corners[order].reshape(-1, 3), 3 * first
    rotation = axes_of(found, first)
    return _bodies(name, CellBoxes(rotation, *_extents(found, first, rotation), np.zeros(len(first))), pose, planes)


@made_once(4)
def from_boxes(name: str, boxes: FixedArray, pose: Pose, planes: str) -> tuple[HalfspaceBody, ...]:
    """Return a body for each of the boxes (k, 6), lower and upper corners [m] in a frame that stands at `pose`."""
    low, high = boxes.array[:, :3], boxes.array[:, 3:]
    turns = np.tile(np.eye(3), (len(low), 1, 1))
    return _bodies(name, CellBoxes(turns, low, high, np.zeros(len(low))), pose, planes)


def _extents(points: Array, first: Rows, rotation: Array) -> tuple[Array, Array]:
    """Return the extents of groups of points (m, 3), which begin at `first` (c,), along axes (c, 3, 3): lower and upper
    ends (c, 3)."""
    sizes = np.diff(np.append(first, len(points)))
    local = np.einsum("mi,mij->mj", points, np.repeat(rotation, sizes, axis=0))
    return np.minimum.reduceat(local, first), np.maximum.reduceat(local, first)


def _bodies(name: str, boxes: CellBoxes, pose: Pose, planes: str) -> tuple[HalfspaceBody, ...]:
    """Return bodies around boxes with rounded edges."""
    normals, supports, box, half = (read_only(each) for each in _planes(boxes, pose, planes))
    return tuple(
        HalfspaceBody(name, 0, normals[c], supports[c], box[c], half[c], None, box[c]) for c in range(len(half))
    )


def _planes(boxes: CellBoxes, pose: Pose, planes: str) -> tuple[Array, Array, Array, Array]:
    """Return normals (c, K, 3), supports (c, K), boxes (c, 4, 4) and their half sizes (c, 3) of the same in the
    world."""
    placement, radius = pose.matrix, boxes.radius
    middle, half = 0.5 * (boxes.low + boxes.high), 0.5 * (boxes.high - boxes.low)
    box = np.tile(np.eye(4), (len(half), 1, 1))
    box[:, :3, :3] = placement[:3, :3] @ boxes.rotation
    box[:, :3, 3] = (box[:, :3, :3] @ middle[..., None])[..., 0] + placement[:3, 3]
    directions = few_directions(planes)
    normals = directions @ box[:, :3, :3].swapaxes(1, 2)
    # of a box with rounded edges: h(n) = Σ_i |n_i| half_i + r
    supports = half @ np.abs(directions).T + radius[:, None] + (normals @ box[:, :3, 3, None])[..., 0]
    return normals, supports, box, half + radius[:, None]
