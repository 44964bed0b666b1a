"""Exact proximity of link and obstacle pieces, for the certificate: closed-form supports, and coal's directions.

A piece is a convex hull, exact for everything convex, and for a mesh that is not convex, or a cloud, also the parts
that make it up (`part_distance`). coal proposes only a *direction* n; the number comes from the support functions,

    gap(n) = min_{a ∈ A} n·a − max_{b ∈ B} n·b  ≤  d(A, B)   for every unit n (separating plane),

so no fault of an iterative solver (coal returns O(1) garbage in about 0.1 % of exactly parallel contacts) can make it
too large. Positive = separated, lengths in [m].
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import coal
import numpy as np

from hdplan.planner.certificate.hull_volumes import hull_volume, is_convex
from hdplan.planner.certificate.parts import Parts
from hdplan.planner.geometry.coal_shapes import convex_hull, corners_of
from hdplan.planner.geometry.meshes import ReadMesh, TriangleMesh, below
from hdplan.planner.geometry.rotations import slight_turns
from hdplan.planner.geometry.solids import Solid
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.once import freeze, made_once, read_only
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Points, Sphere, own_fields

MOST_PIECES = 12  # a mesh of more separate parts is taken as one, and none is cut into more pieces: pairs cost time
WORTH_CUTTING = 0.85  # share of a hull's volume: if the hulls of the two halves have more, the mesh is not cut
HULL_VERTICES = 250  # vertices of the hull that replaces one too large for coal
KEPT_MESHES = 256  # whose pieces stay in memory
# [m] coal's distance and the gap along its own normal differ by more only where coal is wrong
DOUBTFUL_DIFFERENCE = 1e-5
NUDGES = 3  # slightly rotated poses that are tried where coal's answer is doubtful
NUDGE = 1e-5  # [rad] of these rotations: enough to break an exactly parallel contact


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex set: the hull of `vertices`, swept by a ball, by a disc normal to z, or by an ellipsoid. With `surface`
    or `grains`, the hull of that."""

    vertices: Array  # (m, 3) [m] in the piece's frame
    shape: Any  # the same for coal, which only proposes directions
    ball: float = 0.0  # [m] radius of the sweeping ball: sphere, capsule
    disc: float = 0.0  # [m] radius of the sweeping disc, normal to z: cylinder
    radii: Array | None = None  # (3,) [m] semi-axes of the sweeping ellipsoid
    surface: Surface | None = None  # the triangles, if they are not convex
    grains: Array | None = None  # (m, 4) the balls of a cloud's cell, centres and radii [m]
    low: Array = field(init=False)  # (3,) corners of the bounding box
    high: Array = field(init=False)
    center: Array = field(init=False)  # (3,) of the bounding ball
    radius: float = field(init=False)  # [m] of the bounding ball

    def __post_init__(self) -> None:
        """Compute the bounding box and the bounding ball."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        if self.sweep:
            reach = np.array([self.disc, self.disc, 0.0]) + self.ball + (0.0 if self.radii is None else self.radii)
            low, high = low - reach, high + reach
        center = 0.5 * (low + high)
        away = self.vertices - center
        farthest = math.sqrt((away * away).sum(axis=1).max()) + self.ball
        if self.radii is not None:
            farthest += float(self.radii.max())
        if self.disc:
            farthest = float(np.linalg.norm(high - center))
        for name, value in (("low", low), ("high", high), ("center", center), ("radius", farthest)):
            object.__setattr__(self, name, value)
        freeze(self)

    @classmethod
    def bounded(cls, vertices: Array, shape: Any, ball: float, grains: Array, bounds: tuple[Any, ...]) -> Piece:
        """Return a piece whose low, high, center and radius are known already, of read-only arrays: a cloud has
        thousands."""
        piece = object.__new__(cls)
        low, high, center, radius = bounds
        vars(piece).update(vertices=vertices, shape=shape, ball=ball, disc=0.0, radii=None, surface=None, grains=grains)
        vars(piece).update(low=low, high=high, center=center, radius=radius)
        return piece

    @cached_property
    def parts(self) -> Parts | None:
        """The mesh whose hull the piece is; None where the piece is the hull itself. Built on first use."""
        if self.surface is not None:
            corners = self.surface.mesh.vertices[self.surface.mesh.triangles]
            return Parts.of(corners, np.zeros(len(corners)))
        return None if self.grains is None else Parts.of(self.grains[:, None, :3], self.grains[:, 3])

    @property
    def sweep(self) -> float:
        """Greatest distance of a point of the piece from the hull of its vertices [m]."""
        return self.ball + self.disc + (0.0 if self.radii is None else float(self.radii.max()))

    def support(self, directions: Array) -> Array:
        """Return h(d) = max_{x in the piece} d·x for directions (k, 3) of any length, in the piece's frame."""
        values = (directions @ self.vertices.T).max(axis=1)
        if self.ball:
            values = values + self.ball * np.linalg.norm(directions, axis=1)
        if self.disc:
            values = values + self.disc * np.hypot(directions[:, 0], directions[:, 1])
        if self.radii is not None:
            values = values + np.linalg.norm(directions * self.radii, axis=1)
        return np.asarray(values)


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles that are not convex."""

    mesh: TriangleMesh
    solid: Solid  # which they bound, alone or with others


def obstacle_pieces(obstacle: Obstacle) -> tuple[Piece, ...]:
    """Return the true shape of an obstacle whose file was read, in its frame. Raises HdplanError for a shape that the
    certificate does not know."""
    made = PIECES.get(type(obstacle.shape))
    if made is None:
        kind = type(obstacle.shape).__name__
        raise HdplanError(f"obstacles.{obstacle.name}: shape {kind} is not supported by the certificate")
    return made(**own_fields(obstacle.shape))


def link_pieces(geometry: Any, name: str) -> tuple[Piece, ...]:
    """Return a link's collision geometry (coal's) as pieces, in its frame. Raises HdplanError for unknown kinds."""
    match geometry:
        case coal.Box():
            return (box_piece(2.0 * geometry.halfSide),)
        case coal.Sphere():
            return (_capsule(geometry.radius, 0.0),)
        case coal.Ellipsoid():
            return (_ellipsoid(tuple(np.asarray(geometry.radii).tolist())),)
        case coal.Cylinder():
            return (_cylinder(geometry.radius, 2.0 * geometry.halfLength),)
        case coal.Capsule():
            return (_capsule(geometry.radius, 2.0 * geometry.halfLength),)
        case coal.ConvexBase():
            return (hull_piece(np.array(geometry.points())),)
        case coal.BVHModelBase():
            return _link_mesh(np.array(geometry.vertices()).tobytes(), corners_of(geometry).tobytes())
    raise HdplanError(f"link geometry '{name}': shape {type(geometry).__name__} is not supported by the certificate")


@made_once(KEPT_MESHES)
def _link_mesh(vertices: bytes, corners: bytes) -> tuple[Piece, ...]:
    """Return the pieces of a link's mesh: a robot that holds something is another one, of the same meshes."""
    points, triangles = np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(corners, np.int64).reshape(-1, 3)
    return mesh_pieces(TriangleMesh.merged(points, triangles).trimmed())


@made_once(KEPT_MESHES)
def mesh_pieces(mesh: TriangleMesh) -> tuple[Piece, ...]:
    """Split a mesh into its connected parts; a convex part becomes its hull, any other keeps its triangles. It is done
    once for all copies of a mesh.

    Parts that are open or inside out (the wall of a cavity) have a meaning only together, so that the mesh is not split
    then. Parts that are not convex are cut where that makes their hulls much smaller.
    """
    parts = mesh.components()
    if len(parts) > MOST_PIECES or not all(part.closed and part.volume > 0 for part in parts):
        if is_convex(mesh):
            return (hull_piece(mesh.vertices),)
        return _cut(mesh, Solid(mesh))
    return tuple(
        piece
        for part in parts
        for piece in ((hull_piece(part.vertices),) if is_convex(part) else _cut(part, Solid(part)))
    )


def _cut(mesh: TriangleMesh, solid: Solid) -> tuple[Piece, ...]:
    """Cut triangles into parts, the one with the largest hull first, as long as the hulls of the two halves are much
    smaller than the hull of both: the tighter the hulls, the less often planes for single triangles are needed.

    The parts of a shell could be cut for ever, always with enough gain: MOST_PIECES ends that.
    """
    parts, whole = [(hull_volume(mesh), mesh)], list[TriangleMesh]()
    while parts:
        volume, part = parts.pop(max(range(len(parts)), key=lambda i: parts[i][0]))
        halves = _halves(part) if volume > 0.0 and len(parts) + len(whole) + 2 <= MOST_PIECES else ()
        volumes = [hull_volume(half) for half in halves]
        if halves and sum(volumes) <= WORTH_CUTTING * volume:
            parts.extend(zip(volumes, halves, strict=True))
        else:
            whole.append(part)
    return tuple(hull_piece(part.vertices, Surface(part, solid)) for part in whole)


def _halves(mesh: TriangleMesh) -> tuple[TriangleMesh, ...]:
    """Cut triangles across their longest extent; empty if all of them lie on one side of the cut."""
    middle = mesh.vertices.mean(axis=0)
    axis = np.linalg.svd(mesh.vertices - middle, full_matrices=False)[2][0]
    heights = (mesh.vertices - middle) @ axis
    offset, corners = middle @ axis + 0.5 * (heights.min() + heights.max()), mesh.vertices[mesh.triangles]
    cut = (below(corners, side * axis, side * offset).reshape(-1, 3) for side in (1, -1))
    halves = tuple(TriangleMesh.merged(points, np.arange(len(points)).reshape(-1, 3)).trimmed() for points in cut)
    return halves if all(len(half.triangles) for half in halves) else ()


def directions(placed: Iterable[tuple[Any, Any, Any, Any]]) -> tuple[Array, Array]:
    """Separating directions by coal of pairs of shapes (of least penetration, if in contact), each with its
    transform: unit normals (i, 3) from B to A in the world frame, and coal's signed distances (i,) [m], which are not
    to be trusted on their own. Where coal finds no direction, the distance is not a number."""
    normals, distances, result = list[Array](), list[float](), coal.DistanceResult()
    for a, pose_a, b, pose_b in placed:
        result.clear()
        distances.append(coal.distance(a, pose_a, b, pose_b, _REQUEST, result))
        normals.append(-result.normal)
    lengths = np.array([math.sqrt(normal.dot(normal)) for normal in normals])
    lost = ~(np.isfinite(lengths) & (lengths >= 0.5))
    found = np.array(normals).reshape(-1, 3) / np.where(lost, 1.0, lengths)[:, None]
    found[lost] = [0.0, 0.0, 1.0]
    return found, np.where(lost, np.nan, distances)


def gap(a: Piece, rotation_a: Array, origin_a: Array, b: Piece, rotation_b: Array, origin_b: Array, n: Array) -> float:
    """Return gap(n) of the module's equation for one pair: a lower bound of the signed distance, exact for the best
    unit n."""
    nearest_a = n @ origin_a - a.support(-(n @ rotation_a)[None])[0]
    farthest_b = n @ origin_b + b.support((n @ rotation_b)[None])[0]
    return float(nearest_a - farthest_b)


def best_direction(a: Piece, pose_a: Array, b: Piece, pose_b: Array) -> tuple[Array, float]:
    """Return the direction of the largest gap among coal's answers at these and slightly rotated poses, and the gap.

    For the few places where one answer is doubtful. Poses are (4, 4).
    """
    rotation_a, origin_a, rotation_b, origin_b = pose_a[:3, :3], pose_a[:3, 3], pose_b[:3, :3], pose_b[:3, 3]
    best, largest = np.array([0.0, 0.0, 1.0]), -np.inf
    for turn in (np.eye(3), *TURNS):
        here, there = coal.Transform3s(rotation_a @ turn, origin_a), coal.Transform3s(rotation_b, origin_b)
        (normal,), _ = directions([(a.shape, here, b.shape, there)])
        value = gap(a, rotation_a, origin_a, b, rotation_b, origin_b, normal)
        if value > largest:
            best, largest = normal, value
    return best, largest


def witness_points(a: Piece, pose_a: Array, b: Piece, pose_b: Array) -> Array:
    """Return the closest points (2, 3) [m] of two convex pieces, on a and on b, as coal finds them.

    For pictures: nothing is proven about them. In contact they are the ends of the least penetration, or the place
    where two triangles meet. Poses are (4, 4).
    """
    result = coal.DistanceResult()
    here, there = (coal.Transform3s(pose[:3, :3], pose[:3, 3]) for pose in (pose_a, pose_b))
    coal.distance(a.shape, here, b.shape, there, _REQUEST, result)
    return np.array([result.getNearestPoint1(), result.getNearestPoint2()])


def box_piece(size: Array) -> Piece:
    """Return a box about the origin with full edge lengths (3,) [m]."""
    return Piece(CORNERS * size, coal.Box(*size))


@functools.lru_cache(maxsize=4096)
def _box(size: tuple[float, ...]) -> Piece:
    return box_piece(np.array(size))


@functools.lru_cache(maxsize=4096)
def _cylinder(radius: float, length: float) -> Piece:
    return Piece(np.array([[0, 0, -0.5], [0, 0, 0.5]]) * length, coal.Cylinder(radius, length), disc=radius)


@functools.lru_cache(maxsize=4096)
def _capsule(radius: float, length: float) -> Piece:
    if length == 0.0:
        return Piece(np.zeros((1, 3)), coal.Sphere(radius), ball=radius)
    return Piece(np.array([[0, 0, -0.5], [0, 0, 0.5]]) * length, coal.Capsule(radius, length), ball=radius)


@functools.lru_cache(maxsize=4096)
def _ellipsoid(radii: tuple[float, ...]) -> Piece:
    return Piece(np.zeros((1, 3)), coal.Ellipsoid(*radii), radii=np.array(radii))


def hull_piece(points: Array, surface: Surface | None = None) -> Piece:
    """Return the hull of `points`; if they are flat, coal gets a slightly thicker hull, while the supports stay exact.

    If the hull is too large for coal, a hull of fewer vertices gives the direction, and its triangles better ones.
    """
    centered = points - points.mean(axis=0)
    extents = np.linalg.svd(centered, compute_uv=False)
    solid = points
    if len(extents) < 3 or extents[2] < 1e-4 * extents[0]:
        swell = 1e-4 * (float(extents[0]) or 1.0) * np.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
        solid = (points[:, None] + swell[None]).reshape(-1, 3)
    shape = convex_hull(solid)
    if shape is None:
        hull = TriangleMesh.hull(solid)
        surface, shape = surface or Surface(hull, Solid(hull)), convex_hull(outermost(solid))
        return Piece(points, shape, surface=surface)
    corners = np.array(shape.points()) if solid is points else points
    return Piece(corners, shape, surface=surface)


def outermost(points: Array) -> Array:
    """Return the points that lie farthest in HULL_VERTICES directions."""
    directions = np.random.default_rng(0).normal(size=(HULL_VERTICES, 3))
    return np.asarray(points[np.unique((directions @ points.T).argmax(axis=1))])


PIECES: Mapping[type, Callable[..., tuple[Piece, ...]]] = {  # with a shape's own fields: one more is an error
    Box: lambda size: (_box(size),),
    Sphere: lambda radius: (_capsule(radius, 0.0),),
    Ellipsoid: lambda radii: (_ellipsoid(radii),),
    Cylinder: lambda radius, length: (_cylinder(radius, length),),
    Capsule: lambda radius, length: (_capsule(radius, length),),
    Points: lambda points: (hull_piece(np.array(points, dtype=np.float64)),),
    ReadMesh: lambda file, scale, mesh: mesh_pieces(mesh),
}
CORNERS = read_only(np.array(list(itertools.product((-0.5, 0.5), repeat=3))))  # of a cube
_REQUEST = coal.DistanceRequest()
TURNS = tuple(read_only(slight_turns(NUDGES, NUDGE)))  # (3, 3) each
