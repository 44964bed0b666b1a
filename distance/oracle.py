"""The exact signed distance of two convex bodies, with witness points: coal for the bulk, checked every time.

In: two bodies and their poses (4, 4), world from body [m]. Out: ``Proximity``, exact to about 1e-9 of the bodies' size,
positive = separated. coal is fast, but wrong in about one of a thousand exactly parallel contacts; so its answer counts
only if it proves itself, and otherwise ``sat.ground_truth`` decides.
"""

from __future__ import annotations

import functools

import coal
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import own_directions, separating_axes
from hdplan.distance.sat import Proximity, ground_truth
from hdplan.scenes.errors import InputError

Array = NDArray[np.float64]

__all__ = ["Proximity", "signed_distance"]

PLAUSIBLE = 1e-9  # by this much of the size may coal's answer miss its own proof
REQUEST = coal.DistanceRequest()
REQUEST.enable_signed_distance = True
REQUEST.gjk_tolerance = REQUEST.epa_tolerance = 1e-10


def signed_distance(body_a: ConvexBody, pose_a: ArrayLike, body_b: ConvexBody, pose_b: ArrayLike) -> Proximity:
    """Return the exact signed distance of A and B at poses (4, 4), world from body [m].

    d = max over unit n of min n·(a - b) - r_A - r_B (paper, section ``sec:distance-function``, Theorem SDF): the radii
    come off the signed distance of the polytopes. Raises InputError for poses of another shape or not finite.
    """
    world_a, world_b = _pose("pose_a", pose_a), _pose("pose_b", pose_b)
    exponent = -max(_exponent(body_a), _exponent(body_b))
    scale = 2.0**exponent  # to about 1 m; a power of two, so that nothing is rounded
    origin = world_b[:3, 3]
    placements = (world_a[:3, :3], (world_a[:3, 3] - origin) * scale), (world_b[:3, :3], np.zeros(3))
    answer = _coal((body_a, body_b), placements, exponent)
    if answer is None:
        (rotation_a, offset), (rotation_b, _) = placements
        axes = separating_axes(body_a, rotation_a, body_b, rotation_b)
        answer = ground_truth(
            body_a.vertices * scale @ rotation_a.T + offset, body_b.vertices * scale @ rotation_b.T, axes
        )
    n = answer.normal
    return Proximity(
        answer.distance / scale - body_a.radius - body_b.radius,
        answer.point_a / scale + origin - body_a.radius * n,
        answer.point_b / scale + origin + body_b.radius * n,
        n,
    )


def _coal(
    bodies: tuple[ConvexBody, ConvexBody], placements: tuple[tuple[Array, Array], tuple[Array, Array]], exponent: int
) -> Proximity | None:
    """Return coal's answer for the polytopes, lengths times 2^exponent; None if it does not prove itself.

    The proof: the gap along any unit normal is a lower bound of the signed distance, and that along coal's normal must
    equal its distance. Apart, the distance of two points of the bodies is an upper bound. Overlapping, no face's gap
    may be larger.
    """
    hulls = [_hull(body, exponent) for body in bodies]
    result = coal.DistanceResult()
    distance = coal.distance(
        hulls[0], coal.Transform3s(*placements[0]), hulls[1], coal.Transform3s(*placements[1]), REQUEST, result
    )
    normal, points = -result.normal, (result.getNearestPoint1(), result.getNearestPoint2())
    if not (abs(distance) < 1e300 and np.isfinite(normal).all() and np.isfinite(points).all()):
        return None
    scale = 2.0**exponent
    tolerance = PLAUSIBLE * max(1.0, abs(distance))
    corners = [
        body.vertices * scale @ rotation.T + offset for body, (rotation, offset) in zip(bodies, placements, strict=True)
    ]
    gap = np.min(corners[0] @ normal) - np.max(corners[1] @ normal)
    misses = [
        abs(np.linalg.norm(normal) - 1.0),
        abs(gap - distance),
        *np.abs(points[0] - points[1] - distance * normal),
    ]
    for body, point, (rotation, offset) in zip(bodies, points, placements, strict=True):
        normals, heights = _facets(body)
        misses.append(np.max(normals @ (rotation.T @ (point - offset)) - heights * scale))
    if distance <= tolerance:
        outward = np.vstack([-bodies[0].faces @ placements[0][0].T, bodies[1].faces @ placements[1][0].T, normal])
        gaps = np.min(outward @ corners[0].T, axis=1) - np.max(outward @ corners[1].T, axis=1)
        misses.append(np.max(gaps) - distance)
    return Proximity(distance, *points, normal) if max(misses) <= tolerance else None


@functools.lru_cache(maxsize=4096)
def _hull(body: ConvexBody, exponent: int) -> coal.Convex:
    """Return coal's convex shape of the vertices times 2^exponent; it takes flat bodies with the triangles of a fan."""
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(body.vertices * 2.0**exponent))
    last = len(body.vertices) - 1
    corners = [(0, min(i, last), min(i + 1, last)) for i in range(max(1, last))]
    if len(body.faces) > 2:  # an affine map keeps the hull's triangles, and this one makes needles round
        corners = ConvexHull(np.linalg.svd(body.vertices - body.vertices.mean(0), full_matrices=False)[0]).simplices
    for triangle in corners:
        triangles.append(coal.Triangle(*map(int, triangle)))
    return coal.Convex(points, triangles)


@functools.lru_cache(maxsize=4096)
def _facets(body: ConvexBody) -> tuple[Array, Array]:
    """Return outward normals (H, 3) and heights (H,) of half-spaces that meet in the polytope, flat ones too."""
    if len(body.faces) > 2:
        normals = body.faces
    else:
        sides = np.cross(body.faces[:1], body.edges) if len(body.faces) else own_directions(body)
        normals = np.vstack([body.faces, sides, -sides])
    return normals, np.max(normals @ body.vertices.T, axis=1)


@functools.lru_cache(maxsize=4096)
def _exponent(body: ConvexBody) -> int:
    """Return the power of two just above the body's size; 0 for a point at its origin."""
    return int(np.frexp(np.abs(body.vertices).max())[1])


def _pose(name: str, pose: ArrayLike) -> Array:
    matrix = np.asarray(pose, dtype=float)
    if matrix.shape != (4, 4) or not np.all(np.isfinite(matrix)):
        raise InputError(f"{name}: found an array of shape {matrix.shape}, allowed is a finite array (4, 4)")
    return matrix
