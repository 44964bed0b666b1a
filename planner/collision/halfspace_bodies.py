"""Bodies for the second side of the planner's distance: planes with exact supports, and a box for the broad phase.

In: scene shapes or outer link bodies. Out: HalfspaceBody: unit normals n_k and supports h(n_k) = max_{b in B} n_k·b,
exact for the shape itself (a true cylinder, not a polygon). What the planes enclose is slightly more than the shape
(an outer body).

The setting `planner.normals` chooses the planes: "box" gives a box or a link the 26 directions of its box, and any
other shape 50; "faces" gives a box or a link only its 6 faces; "sphere" adds 96 directions to each, spread evenly.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.symbolic.halfspaces import FAR_OFFSET, box_directions
from hdplan.planner.collision.convex_pieces import MOST_SECONDS, convex_pieces
from hdplan.planner.geometry.meshes import ReadMesh
from hdplan.planner.geometry.shape_table import operations
from hdplan.planner.geometry.voxel_grids import boxes_in
from hdplan.scenes.array_types import Array
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.deadline import check_time
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import ReadOnly, read_only
from hdplan.scenes.poses import Pose
from hdplan.scenes.shapes import Box, Points, Shape
from hdplan.scenes.voxel_grids import Map

BOX_PLANES, BODY_PLANES = 26, 50  # planes of box-like bodies and of all others; one compiled kernel each
SPHERE_DIRECTIONS = 96  # additional ones for "sphere"


@dataclass(frozen=True)
class HalfspaceBody(ReadOnly):
    """The intersection of half-spaces n_k · y ≤ h_k around a convex body, in the frame of what carries it."""

    name: str  # of the obstacle or link
    joint: int  # the joint that carries it; 0, the world, if it stands
    normals: Array  # (K, 3) unit normals, the directions of its box first; K is one of few numbers
    supports: Array  # (K,) [m]
    box: Array  # (4, 4) the frame of a tight box around the body
    half_size: Array  # (3,) of that box [m]
    shape: Shape | ConvexBody | None  # the body itself, no mesh; None: its box
    placement: Array  # (4, 4) the frame in which `shape` is given

    @property
    def solid(self) -> Shape | ConvexBody:
        """The body itself."""
        return Box(2.0 * self.half_size) if self.shape is None else self.shape

    @property
    def directions(self) -> Array:
        """Normals (k, 3) in the frame of its box, without filled slots."""
        reach = self.supports - self.normals @ self.box[:3, 3]
        used: Array = (self.normals @ self.box[:3, :3])[reach < np.linalg.norm(self.half_size) + FAR_OFFSET / 2]
        return used


def from_obstacle(
    obstacle: Obstacle,
    planes: str = "box",
    seconds: float = MOST_SECONDS,
    closely: bool = False,
    pose: Pose | None = None,
) -> tuple[tuple[HalfspaceBody, ...], tuple[str, ...]]:
    """Enclose an obstacle whose file was read: one body, or one for each convex piece of its mesh; and notes on how it
    was split.

    A mesh that cannot be split, or not within `seconds`, is enclosed by boxes around parts of its surface, as a cloud
    is by boxes around parts of it; `closely` by smaller ones. pose: where it stands, its own by default.
    """
    check_time("building the problem")
    pose = obstacle.pose if pose is None else pose
    placement = pose.matrix
    if isinstance(obstacle.shape, Cloud):
        from hdplan.planner.collision.cell_bodies import from_cloud

        return from_cloud(obstacle.name, obstacle.shape, pose, planes, closely)
    if isinstance(obstacle.shape, Map):
        from hdplan.planner.collision.cell_bodies import from_boxes

        return from_boxes(obstacle.name, boxes_in(obstacle.shape), pose, planes), ()
    if not isinstance(obstacle.shape, ReadMesh):
        return (from_shape(obstacle.name, obstacle.shape, placement, planes),), ()
    mesh = obstacle.shape.mesh
    split = convex_pieces(mesh, seconds)
    about = f"obstacle '{obstacle.name}': mesh {obstacle.shape.file.name}"
    if split is None:
        from hdplan.planner.collision.cell_bodies import from_surface

        bodies = from_surface(obstacle.name, mesh, pose, planes, closely)
        return bodies, (f"{about} is planned around as {len(bodies)} boxes that contain its surface",)
    bodies = tuple(from_points(obstacle.name, piece, placement, planes) for piece in split)
    return bodies, (f"{about} split into {len(split)} convex pieces",) if len(split) > 1 else ()


def enclosed_loosely(obstacle: Obstacle) -> bool:
    """True if `from_obstacle` can enclose it more closely: a cloud, or a mesh that is not split."""
    if isinstance(obstacle.shape, ReadMesh):
        return convex_pieces(obstacle.shape.mesh, 0.0) is None
    return isinstance(obstacle.shape, Cloud)


def from_shape(name: str, shape: Shape, placement: Array, planes: str = "box") -> HalfspaceBody:
    """Enclose a scene shape that stands at `placement` in the world. A mesh is given as the convex Points of its
    pieces."""
    if isinstance(shape, Points):
        return from_points(name, np.array(shape.points), placement, planes)
    if operations(shape).outline is None:
        raise TypeError(f"{name}: a {type(shape).__name__} has to be split into convex pieces first")
    return _placed(name, 0, placement, shape, *_enclosed(shape, planes))


@functools.lru_cache(maxsize=4096)
def _enclosed(shape: Shape, planes: str) -> tuple[Array, Array, Array]:
    """The planes around a shape in its own frame, by normals and supports, and half the size of its box."""
    outline = operations(shape).outline
    assert outline is not None
    half = outline.half_size(shape)
    match outline.round_about:
        case "nothing":
            directions = few_directions(planes)
        case "axis":
            directions = _many(_round_directions(), planes)
        case "centre":
            directions = _many(_ball_directions(half), planes)
    return read_only(directions), read_only(outline.support(shape, directions)), read_only(half)


def from_points(name: str, points: Array, placement: Array, planes: str = "box") -> HalfspaceBody:
    """Enclose the hull of points (m, 3), flat ones too, that stands at `placement` in the world."""
    return _placed(name, 0, placement, *_around_points(np.asarray(points, np.float64).tobytes(), planes))


@functools.lru_cache(maxsize=256)
def _around_points(points: bytes, planes: str) -> tuple[ConvexBody, Array, Array, Array, Array]:
    """The hull of points, given as bytes, and the planes around it as `_placed` takes them: a mesh is the same in each
    problem that is assembled for the last touches, and often at many places of a scene."""
    cloud = np.frombuffer(points).reshape(-1, 3)
    frame = _box_frame(cloud)
    local = (cloud - frame[:3, 3]) @ frame[:3, :3]
    faces = _face_normals(local)
    directions = _many(np.vstack([box_directions(), faces]), planes) if len(faces) else few_directions(planes)
    spare = BODY_PLANES - BOX_PLANES - len(faces) if len(faces) else 0
    directions, supports = _fill(directions, (directions @ local.T).max(axis=1), spare)
    half = read_only(np.abs(local).max(axis=0))
    return ConvexBody.from_points(cloud), read_only(directions), read_only(supports), half, read_only(frame)


@functools.lru_cache(maxsize=1024)
def from_link_body(link: str, joint: int, body: ConvexBody, planes: str = "box") -> HalfspaceBody:
    """Enclose an outer link body by the directions of its box; it moves with `joint`."""
    frame, directions = _box_frame(body.vertices), few_directions(planes)
    local = (body.vertices - frame[:3, 3]) @ frame[:3, :3]
    supports = (directions @ local.T).max(axis=1) + body.radius
    half = np.abs(local).max(axis=0) + body.radius
    return _placed(link, joint, np.eye(4), body, directions, supports, half, frame)


def from_link_part(link: str, joint: int, body: ConvexBody, part: Array, planes: str = "box") -> HalfspaceBody:
    """Enclose what an outer link body encloses of its link, points (m, 3) in it, by the directions of a ball: tighter
    than the body itself, in more directions."""
    if len(part) == 0:
        return from_link_body(link, joint, body, planes)
    frame = _box_frame(part)
    local = (part - frame[:3, 3]) @ frame[:3, :3]
    directions = few_directions(planes) if planes == "faces" else _many(_ball_directions(np.ones(3)), planes)
    supports = (directions @ local.T).max(axis=1)
    return _placed(link, joint, np.eye(4), body, directions, supports, np.abs(local).max(axis=0), frame)


def plane_counts(planes: str) -> tuple[int, int]:
    """The numbers of planes that an obstacle may have: box-like, or of any other shape."""
    return len(few_directions(planes)), len(_many(_round_directions(), planes))


def few_directions(planes: str) -> Array:
    """The directions for a box-like body."""
    if planes == "faces":
        return np.vstack([np.eye(3), -np.eye(3)])
    return _many(box_directions(), planes)


def _many(directions: Array, planes: str) -> Array:
    """These directions, and additional ones for "sphere"."""
    return np.vstack([directions, _fibonacci(SPHERE_DIRECTIONS)]) if planes == "sphere" else directions


def _placed(
    name: str,
    joint: int,
    placement: Array,
    shape: Shape | ConvexBody,
    normals: Array,
    supports: Array,
    half_size: Array,
    frame: Array | None = None,
) -> HalfspaceBody:
    """Transform planes from the frame of the body's box, or the shape's own frame if none is given, to that of the
    joint that carries the body: h' = h + n'·t."""
    box = placement if frame is None else placement @ frame
    turned = normals @ box[:3, :3].T
    return HalfspaceBody(name, joint, turned, supports + turned @ box[:3, 3], box, half_size, shape, placement)


def _fill(normals: Array, supports: Array, spare: int) -> tuple[Array, Array]:
    """Fill unused slots with a plane so far away that it never decides."""
    far = FAR_OFFSET + supports.max()
    return np.vstack([normals, np.tile([0.0, 0.0, 1.0], (spare, 1))]), np.append(supports, np.full(spare, far))


def _box_frame(points: Array) -> Array:
    """A frame (4, 4) in which the points' box is centred and aligned with their principal axes."""
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=len(points) < 3)[2].T
    if np.linalg.det(axes) < 0:
        axes[:, 2] = -axes[:, 2]
    local = points @ axes
    frame = np.eye(4)
    frame[:3, :3] = axes
    frame[:3, 3] = axes @ ((local.min(axis=0) + local.max(axis=0)) / 2)
    return frame


def _face_normals(points: Array) -> Array:
    """Normals of the hull's largest faces (F, 3), as many as there are slots, without those that a box direction
    already gives; none for flat hulls."""
    try:
        hull = scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):
        return np.empty((0, 3))
    triangles = points[hull.simplices]
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    kept: list[Array] = []
    known = box_directions()
    for index in np.argsort(-areas, kind="stable"):
        normal = hull.equations[index, :3]
        if (known @ normal).max() < 1 - 1e-9:
            kept.append(normal)
            known = np.vstack([known, normal])
        if len(known) == BODY_PLANES:
            break
    return np.array(kept).reshape(-1, 3)


@functools.cache
def _round_directions() -> Array:
    """MANY directions for bodies that are round about z: the box's, 8 more sideways (16 in all) and 16 more slanted.
    Like those of a box and a ball they are mirror symmetric, so that a mirrored scene is the same problem."""
    between = np.pi / 8 + np.arange(8) * np.pi / 4
    sideways = np.stack([np.cos(between), np.sin(between), 0 * between], axis=1)
    slanted = (sideways + [0, 0, 1]) / np.sqrt(2)
    return read_only(np.vstack([box_directions(), sideways, slanted, slanted * [1, 1, -1]]))


def _ball_directions(half_size: Array) -> Array:
    """MANY directions around a ball: the box's, and the 24 like (1, 1, 3) in the widest gaps between them. No direction
    is farther than 19.1 degrees from all of these. For an ellipsoid the 24 are the normals at the points to which
    scaling maps those of the ball."""
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    between = np.vstack([signs * axis for axis in ((1, 1, 3), (1, 3, 1), (3, 1, 1))]) / np.sqrt(11)
    if np.ptp(half_size) > 0.0:
        between = between / half_size
        between /= np.linalg.norm(between, axis=1, keepdims=True)
    return np.vstack([box_directions(), between])


def _fibonacci(count: int) -> Array:
    """Evenly spread unit directions (count, 3)."""
    index = np.arange(count) + 0.5
    height, around = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - height**2)
    return np.stack([ring * np.cos(around), ring * np.sin(around), height], axis=1)
