"""Fit a small sphere-swept polytope around points: few vertices, one radius, everything inside, little outside.

Points S (N, 3) and m -> vertices V (m, 3) and radius r with dist(s, conv V) <= r for every s in S, so the swept body
contains the convex hull of S. The fit minimizes how far the body stands out beyond the faces f of a reference hull, the
sum of A_f g_f^2 with g_f = max(0, max_i n_f.v_i + r - h_f), where A_f, n_f and h_f are the face's area, normal and
offset. All lengths in [m], one frame.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hdplan.planner.collision.descent import minimized
from hdplan.planner.collision.hull_distance import distance_to_hull
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.deadline import check_time
from hdplan.scenes.lazy_imports import scipy

MARGIN = 1e-6  # added to every radius [m], above rounding
FIT_POINTS = 128  # points that the steps of a fit use; the radius is taken over all points
REFERENCE_FACES = 150  # corners that the reference keeps of the hull
STARTS = 3  # of every fit
STAGES = ((64, 20.0, 2e-3, 35), (128, 80.0, 5e-4, 40))  # points, exponent of the soft maximum, softness [m], rounds


@dataclass(frozen=True, eq=False)
class Swept:
    """The convex hull of some vertices, swept by a ball."""

    vertices: Array  # (m, 3) [m]
    radius: float  # [m]


@dataclass(frozen=True, eq=False)
class Reference:
    """The faces of the hull beyond which a body should not stand out."""

    normals: Array  # (F, 3) unit, outward
    offsets: Array  # (F,) [m]
    weights: Array  # (F,) areas, summing to 1

    @classmethod
    def of(cls, points: Array) -> Reference:
        """Return the faces of the convex hull of points (N, 3)."""
        hull = scipy.spatial.ConvexHull(points)
        a, b, c = (points[hull.simplices[:, k]] for k in range(3))
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return cls(hull.equations[:, :3], -hull.equations[:, 3], areas / areas.sum())

    def excess(self, *bodies: Swept) -> float:
        """Return the root mean square of how far bodies stand out beyond the faces, at each the farthest [m]."""
        reach = [(self.normals @ body.vertices.T).max(1) + body.radius for body in bodies]
        return float(np.sqrt(self.weights @ np.maximum(np.max(reach, axis=0) - self.offsets, 0.0) ** 2))


@dataclass(frozen=True, eq=False)
class Target:
    """Points that a body contains, and the surface beyond which it should not reach."""

    points: Array  # (N, 3), all of them inside
    few: Array  # (FIT_POINTS, 3) of them, the first ones as far from each other as possible
    reference: Reference

    @classmethod
    def of(cls, points: Array, around: Array) -> Target:
        """Return the target of points (N, 3) that lie in the hull of points `around` (M, 3)."""
        return cls(
            points,
            np.resize(spread(points, FIT_POINTS), (FIT_POINTS, 3)),
            Reference.of(spread(around, REFERENCE_FACES)),
        )

    def enclosed(self, core: Array) -> Swept:
        """Return the least body around all points that has these vertices."""
        return Swept(core, float(distance_to_hull(self.points, core)[0].max()) + MARGIN)


def rough_fits(targets: Sequence[Target], count: int) -> list[Swept]:
    """Return for each target the best body of `count` vertices after the first of STAGES, from seeded starts."""
    random = np.random.default_rng(0)
    begun = [_start(target.few, count, random, k == 0) for target in targets for k in range(STARTS)]
    ends = iter(_descend([target for target in targets for _ in range(STARTS)], np.array(begun), 0))
    return [min(itertools.islice(ends, STARTS), key=target.reference.excess) for target in targets]


def finished(targets: Sequence[Target], rough: Sequence[Swept]) -> tuple[Swept, ...]:
    """Return each target's body after the second of STAGES."""
    ends = _descend(targets, np.array([body.vertices for body in rough]), 1)
    return tuple(min(pair, key=target.reference.excess) for target, *pair in zip(targets, rough, ends, strict=True))


def spread(points: Array, count: int) -> Array:
    """Return at most `count` of the points (N, 3), far from each other."""
    chosen = [0]
    distance = np.full(len(points), np.inf)
    while len(chosen) < min(count, len(points)):
        distance = np.minimum(distance, np.sum((points - points[chosen[-1]]) ** 2, axis=1))
        chosen.append(int(distance.argmax()))
    return points[chosen]


def _start(points: Array, count: int, random: np.random.Generator, greedy: bool) -> Array:
    """Return points far from each other (k-means++), pulled towards the middle."""
    chosen = [
        int(np.argmax(np.linalg.norm(points - points.mean(0), axis=1))) if greedy else int(random.integers(len(points)))
    ]
    while len(chosen) < count:
        square = np.min(np.sum((points[:, None] - points[chosen]) ** 2, axis=2), axis=1)
        total = square.sum()
        shares = square / total if total > 0.0 else None  # fewer points than vertices: any of them again
        chosen.append(int(square.argmax()) if greedy else int(random.choice(len(points), p=shares)))
    middle = points.mean(0)
    return np.asarray(middle + (0.6 if greedy else random.uniform(0.3, 0.8)) * (points[chosen] - middle))


def _descend(targets: Sequence[Target], vertices: Array, stage: int) -> list[Swept]:
    """Return for vertices (B, m, 3) nearby bodies around their targets that stand out little."""
    count, exponent, softness, rounds = STAGES[stage]
    points = np.array([target.few[:count] for target in targets])
    most = max(len(target.reference.weights) for target in targets)
    normals, offsets, weights = (np.zeros((len(targets), most, *size)) for size in ((3,), (), ()))
    for row, target in enumerate(targets):
        faces = slice(len(target.reference.weights))
        normals[row, faces], offsets[row, faces] = target.reference.normals, target.reference.offsets
        weights[row, faces] = target.reference.weights

    def objective(flat: Array, rows: Rows) -> tuple[Array, Array]:
        cores = flat.reshape(-1, *vertices.shape[1:])
        return _objective(points[rows], normals[rows], offsets[rows], weights[rows], cores, exponent, softness)

    ends = minimized(objective, vertices.reshape(len(vertices), -1), rounds).reshape(vertices.shape)
    return [target.enclosed(core) for target, core in zip(targets, ends, strict=True)]


def _objective(
    points: Array, normals: Array, offsets: Array, weights: Array, vertices: Array, p: float, softness: float
) -> tuple[Array, Array]:
    """Return the excess (B,) with a p-norm for the radius and a soft maximum over vertices, and its gradient
    (B, 3 m)."""
    check_time("fitting bodies to the robot's links (those done are kept for the next time)")
    distance, shares = distance_to_hull(points, vertices)
    largest = distance.max(1, keepdims=True) + 1e-9
    power = np.sum((distance / largest) ** p, axis=1, keepdims=True)
    radius = largest * power ** (1.0 / p)
    pull = power ** (1.0 / p - 1.0) * (distance / largest) ** (p - 1.0) / np.maximum(distance, 1e-9)
    radius_slope = -shares.swapaxes(1, 2) @ (pull[:, :, None] * (points - shares @ vertices))

    heights = normals @ vertices.swapaxes(1, 2)
    top = heights.max(2, keepdims=True)
    share = np.exp((heights - top) / softness)
    total = share.sum(2, keepdims=True)
    gaps = np.maximum((top + softness * np.log(total))[:, :, 0] + radius - offsets, 0.0)
    slope = 2.0 * weights * gaps
    gradient = (share / total * slope[:, :, None]).swapaxes(1, 2) @ normals
    gradient += slope.sum(1)[:, None, None] * radius_slope
    return np.einsum("bf,bf->b", weights, gaps**2), gradient.reshape(len(vertices), -1)
