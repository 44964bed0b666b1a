"""The exact signed distance of two convex bodies, with witness points: by coal, whose every answer is checked.

In: two bodies and their poses (4, 4), world from body [m]. Out: ``Proximity``, or for many poses at once the distances
alone; exact to about 1e-9 of the bodies' size, positive = separated. coal is fast, but wrong in about one of a thousand
exactly parallel contacts; so its answer is used only if it can be verified, otherwise ``ground_truth`` decides.
``CoalPair`` is coal without the check, for timing.
"""

from __future__ import annotations

import functools
import threading
from functools import reduce
from typing import NamedTuple

import coal
import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.baselines.ground_truth import Proximity, ground_truth
from hdplan.distance.baselines.surface import triangles
from hdplan.distance.bodies import ConvexBody, check_bodies
from hdplan.distance.normals import PARALLEL_SINE, own_directions, separating_axes
from hdplan.distance.poses import check_pose, check_pose_lists
from hdplan.distance.unions import Body, pairs_of
from hdplan.scenes.array_types import Array, Mask

__all__ = ["CoalPair", "Proximity", "signed_distance", "signed_distances"]

CHECK_TOLERANCE = 1e-9  # of the size: tolerance of the check
BLOCK = 2**20  # numbers that the check of overlaps holds at once, about 8 MB
REQUEST = coal.DistanceRequest()
REQUEST.enable_signed_distance = True
REQUEST.gjk_tolerance = REQUEST.epa_tolerance = 1e-10


class _Placements(NamedTuple):
    """Poses scaled to bodies of about 1 m, B at the origin, so that no digits are lost far away or at odd scales."""

    rotations_a: Array  # (N, 3, 3) world from A
    offsets: Array  # (N, 3) from B's origin to A's, in the world, scaled
    rotations_b: Array  # (N, 3, 3) world from B
    exponent: int  # lengths are multiplied by 2^exponent: a power of two, so that nothing is rounded


class _Answers(NamedTuple):
    """The contents of ``Proximity`` for N poses."""

    distances: Array  # (N,)
    points_a: Array  # (N, 3)
    points_b: Array  # (N, 3)
    normals: Array  # (N, 3)


def signed_distance(body_a: Body, pose_a: ArrayLike, body_b: Body, pose_b: ArrayLike) -> Proximity:
    """Return the exact signed distance of body_a and body_b [m], at pose_a and pose_b (4, 4), world from body.

    d = max over unit n of min n·(a - b) - r_A - r_B (paper: Theorem III.1, eq. (2)): the radii are subtracted from the
    signed distance of the polytopes. For unions, the result is that of the pair of pieces with the least distance:
    exact where they are apart. In overlap it is the depth of one piece in another; the unions are equally deep or
    deeper, so it is an upper bound of the signed distance, with its sign (``unions``), and the normal separates that
    pair.

    Raises InputError for arguments that are not bodies, and for poses of another shape, not finite or not rigid.
    """
    poses = check_pose("pose_a", pose_a)[None], check_pose("pose_b", pose_b)[None]
    every = [_exact(a, poses[0], b, poses[1]) for a, b in pairs_of(body_a, body_b)]
    found = min(every, key=lambda answers: float(answers.distances[0]))
    return Proximity(float(found.distances[0]), found.points_a[0], found.points_b[0], found.normals[0])


def signed_distances(body_a: Body, poses_a: ArrayLike, body_b: Body, poses_b: ArrayLike) -> Array:
    """Return the exact signed distances (N,) [m] of body_a and body_b at N poses each.

    poses_a and poses_b: (N, 4, 4), world from body.

    Equal to ``signed_distance`` pose by pose, but several times faster: only coal itself is called one by one.
    Overlaps take longest, as their check goes through every pair of edges.

    Raises InputError for poses of another shape, not finite or not rigid, and for lists of unequal length.
    """
    pairs = pairs_of(body_a, body_b)
    world_a, world_b = check_pose_lists(poses_a, poses_b)
    return np.asarray(reduce(np.minimum, (_of_pair(a, world_a, b, world_b) for a, b in pairs)))


def _of_pair(body_a: ConvexBody, world_a: Array, body_b: ConvexBody, world_b: Array) -> Array:
    """Return the exact signed distances (N,) of two convex bodies, block by block."""
    axes = len(body_a.faces) + len(body_b.faces) + len(body_a.edges) * len(body_b.edges)
    block = max(1, min(512, BLOCK // (1 + axes * (len(body_a.vertices) + len(body_b.vertices)))))
    blocks = [slice(start, start + block) for start in range(0, len(world_a), block)]
    return np.concatenate([np.empty(0), *(_exact(body_a, world_a[k], body_b, world_b[k]).distances for k in blocks)])


class CoalPair(threading.local):
    """Two bodies for coal's own signed distance, with as little overhead as possible and without any check.

    For timing only: silently wrong in about one of a thousand exactly parallel contacts. Threads may share it, as each
    has its own copies.
    """

    def __init__(self, body_a: ConvexBody, body_b: ConvexBody) -> None:
        """Build coal's objects once. Raises InputError for unions: they are several pairs."""
        check_bodies(body_a, body_b)
        self._hulls = _hull(body_a, 0), _hull(body_b, 0)  # the functor below does not keep them alive
        compute, result = coal.ComputeDistance(*self._hulls), coal.DistanceResult()
        self._own = coal.Transform3s(), coal.Transform3s(), compute, result, body_a.radius + body_b.radius

    def distance(self, pose_a: Array, pose_b: Array) -> float:
        """Return coal's signed distance [m] at poses (4, 4), world from body [m]."""
        place_a, place_b, compute, result, radii = self._own
        place_a.setRotation(pose_a[:3, :3])
        place_a.setTranslation(pose_a[:3, 3])
        place_b.setRotation(pose_b[:3, :3])
        place_b.setTranslation(pose_b[:3, 3])
        result.clear()
        return float(compute(place_a, place_b, REQUEST, result)) - radii


def _exact(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> _Answers:
    """Return the exact answers at poses (N, 4, 4): coal's where verified, else the ground truth."""
    exponent = -max(_exponent(body_a), _exponent(body_b))
    scale = 2.0**exponent
    origins = poses_b[:, :3, 3]
    places = _Placements(poses_a[:, :3, :3], (poses_a[:, :3, 3] - origins) * scale, poses_b[:, :3, :3], exponent)
    found = _coal(body_a, body_b, places)
    for k in (~_proven(body_a, body_b, places, found)).nonzero()[0]:
        rotation_a, rotation_b = places.rotations_a[k], places.rotations_b[k]
        truth = ground_truth(
            body_a.vertices * scale @ rotation_a.T + places.offsets[k],
            body_b.vertices * scale @ rotation_b.T,
            separating_axes(body_a, rotation_a, body_b, rotation_b),
        )
        found.distances[k], found.normals[k] = truth.distance, truth.normal
        found.points_a[k], found.points_b[k] = truth.point_a, truth.point_b
    return _Answers(
        found.distances / scale - body_a.radius - body_b.radius,
        found.points_a / scale + origins - body_a.radius * found.normals,
        found.points_b / scale + origins + body_b.radius * found.normals,
        found.normals,
    )


def _coal(body_a: ConvexBody, body_b: ConvexBody, places: _Placements) -> _Answers:
    """Return coal's answers for the polytopes."""
    hulls = _hull(body_a, places.exponent), _hull(body_b, places.exponent)
    compute = coal.ComputeDistance(*hulls)
    place_a, place_b, result = coal.Transform3s(), coal.Transform3s(), coal.DistanceResult()
    found = _Answers(*(np.empty((len(places.offsets), *shape)) for shape in ((), (3,), (3,), (3,))))
    for k, (rotation_a, offset, rotation_b) in enumerate(zip(*places[:3], strict=True)):
        place_a.setRotation(rotation_a)
        place_a.setTranslation(offset)
        place_b.setRotation(rotation_b)
        result.clear()
        found.distances[k] = compute(place_a, place_b, REQUEST, result)
        found.points_a[k], found.points_b[k] = result.getNearestPoint1(), result.getNearestPoint2()
        found.normals[k] = result.normal
    return found._replace(normals=-found.normals)


def _proven(body_a: ConvexBody, body_b: ConvexBody, places: _Placements, found: _Answers) -> Mask:
    """Return, for each answer (N,), whether it is verified.

    The gap along any unit normal is a lower bound of the signed distance, and that along the answer's normal must equal
    its distance. Apart, the distance of two points of the bodies is an upper bound. Overlapping, no gap along the axes
    of the separating axis theorem may be larger.
    """
    corners_a, normals_a, heights_a = _polytope(body_a, places.exponent)
    corners_b, normals_b, heights_b = _polytope(body_b, places.exponent)
    rotations_a, offsets, rotations_b, _ = places
    distances, points_a, points_b, normals = found
    with np.errstate(invalid="ignore", over="ignore"):  # a wrong answer may be infinite: it is rejected
        tolerance = CHECK_TOLERANCE * np.minimum(np.maximum(1.0, np.abs(distances)), 1e300)
        lowest_a = (_turned_back(normals, rotations_a) @ corners_a.T).min(1) + (normals * offsets).sum(1)
        highest_b = (_turned_back(normals, rotations_b) @ corners_b.T).max(1)
        misses = [
            np.abs(np.sqrt((normals * normals).sum(1)) - 1.0),
            np.abs(lowest_a - highest_b - distances),
            np.abs(points_a - points_b - distances[:, None] * normals),
            _turned_back(points_a - offsets, rotations_a) @ normals_a.T - heights_a,
            _turned_back(points_b, rotations_b) @ normals_b.T - heights_b,
        ]
        proven = np.asarray(np.column_stack(misses).max(1) <= tolerance)
    deep = proven & (distances <= tolerance)
    if deep.any():
        largest = _largest_gap(
            body_a, body_b, _Placements(rotations_a[deep], offsets[deep], rotations_b[deep], places.exponent)
        )
        proven[deep] = largest - distances[deep] <= tolerance[deep]
    return proven


def _largest_gap(body_a: ConvexBody, body_b: ConvexBody, places: _Placements) -> Array:
    """Return the largest gap (N,) along the facets of both polytopes and across each edge of one and of the other."""
    corners_a, normals_a, heights_a = _polytope(body_a, places.exponent)
    corners_b, normals_b, heights_b = _polytope(body_b, places.exponent)
    turns_a, turns_b = places.rotations_a, places.rotations_b
    corners_a = corners_a @ turns_a.transpose(0, 2, 1)  # (N, m, 3) along the world, from A's own origin
    corners_b = corners_b @ turns_b.transpose(0, 2, 1) - places.offsets[:, None]
    along_a = (corners_b @ turns_a @ normals_a.T).min(1) - heights_a
    along_b = ((corners_a + places.offsets[:, None]) @ turns_b @ normals_b.T).min(1) - heights_b
    edges_a, edges_b = body_a.edges @ turns_a.transpose(0, 2, 1), body_b.edges @ turns_b.transpose(0, 2, 1)
    across = np.cross(edges_a[:, :, None], edges_b[:, None]).reshape(len(turns_a), -1, 3)
    sines = np.sqrt((across * across).sum(2, keepdims=True))
    normals = np.divide(across, sines, out=across, where=sines > PARALLEL_SINE).transpose(0, 2, 1)
    shadows_a, shadows_b = corners_a @ normals, corners_b @ normals
    gaps = np.maximum(shadows_a.min(1) - shadows_b.max(1), shadows_b.min(1) - shadows_a.max(1))
    gaps[sines[..., 0] <= PARALLEL_SINE] = -np.inf
    return np.asarray(np.column_stack([along_a, along_b, gaps]).max(1))


def _turned_back(vectors: Array, rotations: Array) -> Array:
    """Return world vectors (N, 3) as seen in frames that rotations (N, 3, 3) turn into the world."""
    turned: Array = (vectors[:, None] @ rotations)[:, 0]
    return turned


@functools.lru_cache(maxsize=4096)
def _hull(body: ConvexBody, exponent: int) -> coal.Convex:
    return coal_hull(body, 2.0**exponent)


def coal_hull(body: ConvexBody, scale: float = 1.0) -> coal.Convex:
    """Return coal's convex shape of the vertices times `scale`, without the radius; it takes flat bodies too."""
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(body.vertices * scale))
    faces.extend([coal.Triangle(*map(int, corners)) for corners in triangles(body)])
    return coal.Convex(points, faces)


@functools.lru_cache(maxsize=4096)
def _polytope(body: ConvexBody, exponent: int) -> tuple[Array, Array, Array]:
    """Return corners (m, 3) times 2^exponent, and outward normals (H, 3) and heights (H,) of half-spaces that meet in
    their hull, flat ones too."""
    if len(body.faces) > 2:
        normals = body.faces
    else:
        sides = np.cross(body.faces[:1], body.edges) if len(body.faces) else own_directions(body)[0]
        normals = np.vstack([body.faces, sides, -sides])
    corners = body.vertices * 2.0**exponent
    return corners, normals, np.max(normals @ corners.T, axis=1)


@functools.lru_cache(maxsize=4096)
def _exponent(body: ConvexBody) -> int:
    """Return the power of two just above the body's size; 0 for a point at its origin."""
    return int(np.frexp(np.abs(body.vertices).max())[1])
