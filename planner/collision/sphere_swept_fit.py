"""Fit a small sphere-swept polytope around points: few vertices, one radius, everything inside, little outside.

Points S (N, 3) and m -> vertices V (m, 3) and radius r with dist(s, conv V) <= r for every s in S, so the swept body
contains the convex hull of S. The fit minimizes how far the body stands out beyond the faces f of a reference hull, the
sum of A_f g_f^2 with g_f = max(0, max_i n_f.v_i + r - h_f), where A_f, n_f and h_f are the face's area, normal and
offset. All lengths in [m], one frame.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import ConvexHull
from scipy.spatial.distance import cdist

from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import check_time

MARGIN = 1e-6  # added to every radius [m], above rounding
SPREAD = 200  # points that the steps of a fit use; the final radius is taken over all of them
STAGES = ((20.0, 2e-3, 60), (80.0, 5e-4, 80))  # exponent of the soft maximum, softness over vertices [m], iterations


@dataclass(frozen=True, eq=False)
class Swept:
    """The convex hull of some vertices, swept by a ball."""

    vertices: Array  # (m, 3) [m]
    radius: float  # [m]


@cache
def _subsets(count: int) -> tuple[NDArray[np.intp], ...]:
    return tuple(np.array(list(itertools.combinations(range(count), k))) for k in range(2, min(count, 4) + 1))


def distance_to_hull(points: Array, vertices: Array) -> tuple[Array, Array]:
    """Return distances (N,) from points (N, 3) to conv of vertices (m, 3), and the nearest points' weights (N, m).

    Tries every segment, triangle and tetrahedron of vertices (Caratheodory): for m up to about 8. A value is never too
    small, since each is the distance to a point of the hull.
    """
    count = len(points)
    if len(vertices) == 1:
        return np.linalg.norm(points - vertices[0], axis=1), np.ones((count, 1))
    best, weights = np.full(count, np.inf), np.zeros((count, len(vertices)))
    for subset in _subsets(len(vertices)):
        size = subset.shape[1]
        origin = vertices[subset[:, 0]]
        edges = vertices[subset[:, 1:]] - origin[:, None]  # (T, size - 1, 3)
        gram = edges @ edges.transpose(0, 2, 1)
        gram += (1e-12 * np.trace(gram, axis1=1, axis2=2) + 1e-24)[:, None, None] * np.eye(size - 1)
        offset = points.T[None] - origin[:, :, None]  # (T, 3, N): long rows last, for speed
        share = np.linalg.solve(gram, edges) @ offset
        if size == 2:
            np.clip(share, 0.0, 1.0, out=share)
        share = np.concatenate([1.0 - share.sum(1, keepdims=True), share], axis=1)  # (T, size, N)
        square = np.sum((offset - edges.transpose(0, 2, 1) @ share[:, 1:]) ** 2, axis=1)
        square[share.min(1) < 0.0] = np.inf
        chosen = square.argmin(0)
        shortest = square[chosen, np.arange(count)]
        closer = np.nonzero(shortest < best)[0]
        best[closer], weights[closer] = shortest[closer], 0.0
        weights[closer[:, None], subset[chosen[closer]]] = share[chosen[closer], :, closer]
    return np.sqrt(best), weights


@dataclass(frozen=True, eq=False)
class Reference:
    """The faces of the hull beyond which a body should not stand out."""

    normals: Array  # (F, 3) unit, outward
    offsets: Array  # (F,) [m]
    weights: Array  # (F,) areas, summing to 1

    @classmethod
    def of(cls, points: Array) -> Reference:
        """Return the faces of the convex hull of points (N, 3)."""
        hull = ConvexHull(points)
        a, b, c = (points[hull.simplices[:, k]] for k in range(3))
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return cls(hull.equations[:, :3], -hull.equations[:, 3], areas / areas.sum())

    def excess(self, body: Swept) -> float:
        """Return the mean square of how far a body stands out beyond the faces [m^2]."""
        gaps = (self.normals @ body.vertices.T).max(1) + body.radius - self.offsets
        return float(self.weights @ np.maximum(gaps, 0.0) ** 2)


def fit_swept(points: Array, reference: Reference, count: int, starts: int = 4) -> Swept:
    """Return the best body of `count` vertices around points (N, 3) found from seeded starts.

    All starts go through the first stage of STAGES, the better half of them through the second.
    """
    random = np.random.default_rng(0)
    few = spread(points)

    def body(core: Array) -> Swept:
        return Swept(core, float(distance_to_hull(points, core)[0].max()) + MARGIN)

    rough = [body(_descend(few, reference, _start(few, count, random, k == 0), 0)) for k in range(starts)]
    rough = sorted(rough, key=reference.excess)[: (starts + 1) // 2]
    return min((body(_descend(few, reference, each.vertices, 1)) for each in rough), key=reference.excess)


def spread(points: Array, count: int = SPREAD) -> Array:
    """Return at most `count` of the points (N, 3), far from each other: enough for the steps of a fit."""
    if len(points) <= count:
        return points
    chosen = [0]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
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
        chosen.append(int(square.argmax()) if greedy else int(random.choice(len(points), p=square / square.sum())))
    middle = points.mean(0)
    return np.asarray(middle + (0.6 if greedy else random.uniform(0.3, 0.8)) * (points[chosen] - middle))


def _descend(points: Array, reference: Reference, vertices: Array, stage: int) -> Array:
    """Return the vertices (m, 3) of a nearby body that stands out little."""
    exponent, softness, iterations = STAGES[stage]
    return np.asarray(
        minimize(
            lambda x: _objective(points, reference, x.reshape(vertices.shape), exponent, softness),
            vertices.ravel(),
            jac=True,
            method="L-BFGS-B",
            options={"maxiter": iterations},
        ).x.reshape(vertices.shape)
    )


def _objective(points: Array, reference: Reference, vertices: Array, p: float, softness: float) -> tuple[float, Array]:
    """Return the excess with a p-norm for the radius and a soft maximum over vertices, and its gradient (3 m,)."""
    check_time("fitting bodies to the robot's links (those done are kept for the next time)")
    distance, weights = distance_to_hull(points, vertices)
    largest = distance.max() + 1e-9
    power = np.sum((distance / largest) ** p)
    radius = largest * power ** (1.0 / p)
    pull = power ** (1.0 / p - 1.0) * (distance / largest) ** (p - 1.0)
    away = (points - weights @ vertices) / np.maximum(distance, 1e-9)[:, None]
    radius_slope = -np.einsum("n,ni,nc->ic", pull, weights, away)

    heights = reference.normals @ vertices.T
    top = heights.max(1, keepdims=True)
    shares = np.exp((heights - top) / softness)
    total = shares.sum(1, keepdims=True)
    gaps = np.maximum((top + softness * np.log(total))[:, 0] + radius - reference.offsets, 0.0)
    slope = 2.0 * reference.weights * gaps
    gradient = np.einsum("f,fi,fc->ic", slope, shares / total, reference.normals) + slope.sum() * radius_slope
    scale = 1e4  # L-BFGS's tolerances are meant for numbers near 1
    return scale * float(reference.weights @ gaps**2), scale * gradient.ravel()


# --- how well bodies fit ----------------------------------------------------------------------------------------------


def outside(bodies: tuple[Swept, ...], hull_points: Array, samples: int = 1500) -> tuple[float, float]:
    """Return mean and 95th percentile [m] of how far the surface of a union of bodies lies outside a convex hull.

    Seeded, area-weighted samples of each body's surface, those inside another body left out; 0 where inside the hull.
    """
    random = np.random.default_rng(0)
    points, weights = [], []
    for index, body in enumerate(bodies):
        surface, area = _surface(body, samples, random)
        free = np.ones(samples, dtype=np.bool_)
        for other in bodies[:index] + bodies[index + 1 :]:
            free &= distance_to_hull(surface, other.vertices)[0] >= other.radius
        points.append(surface[free])
        weights.append(np.full(int(free.sum()), area / samples))
    weight = np.concatenate(weights)
    distance = _distance_to_polytope(np.concatenate(points), hull_points)
    order = np.argsort(distance)
    rank = np.searchsorted(np.cumsum(weight[order]), 0.95 * weight.sum())
    return float(weight @ distance / weight.sum()), float(distance[order][min(rank, len(order) - 1)])


@cache
def _directions() -> Array:
    """Return 642 directions, evenly spread (Fibonacci)."""
    k = np.arange(642)
    z, angle = 1.0 - (2 * k + 1) / 642, k * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def _surface(body: Swept, samples: int, random: np.random.Generator) -> tuple[Array, float]:
    """Return area-weighted random points on a body's surface and its area."""
    cloud = (body.vertices[:, None] + body.radius * _directions()).reshape(-1, 3)
    hull = ConvexHull(cloud)
    a, b, c = (cloud[hull.simplices[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    pick = random.choice(len(areas), samples, p=areas / areas.sum())
    u, v = random.random((2, samples, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[pick] + u * (b - a)[pick] + v * (c - a)[pick]
    distance, weights = distance_to_hull(points, body.vertices)
    core = weights @ body.vertices
    return core + body.radius * (points - core) / distance[:, None], float(areas.sum())


def _distance_to_polytope(points: Array, hull_points: Array) -> Array:
    """Return distances (N,) to the convex hull of points (M, 3), 0 inside: the nearest over all its triangles."""
    hull = ConvexHull(hull_points)
    distance = np.zeros(len(points))
    rows = np.nonzero((hull.equations[:, :3] @ points.T + hull.equations[:, 3:]).max(0) > 0)[0]
    triangles = hull_points[hull.simplices]
    middles = triangles.mean(1)
    reach = np.linalg.norm(triangles - middles[:, None], axis=2).max(1)
    away = cdist(points[rows], middles)
    point, triangle = np.nonzero(away - reach <= away.min(1, keepdims=True))  # the others are farther than the nearest
    nearest = trimesh.triangles.closest_point(triangles[triangle], points[rows[point]])
    distance[rows] = np.inf
    np.minimum.at(distance, rows[point], np.linalg.norm(nearest - points[rows[point]], axis=1))
    return distance
