"""Bodies around the triangles of one link: cut into slabs, a sphere-swept polytope around each.

Triangles -> the cheapest number of slabs and vertices that fits well. The corners of a slab's triangles lie within its
body, which is convex and so contains the slab.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.collision.sphere_swept_fit import Reference, Swept, Target, finished, rough_fits, spread
from hdplan.planner.collision.standing_out import outside
from hdplan.scenes.array_types import Array
from hdplan.scenes.lazy_imports import LazyModule, scipy

if TYPE_CHECKING:
    import trimesh
else:
    trimesh = LazyModule("trimesh")

GOOD_MEAN, GOOD_P95 = 0.0095, 0.0185  # outside the link's hull [m]: the first candidate this tight is taken
PROMISING_OVERHANG = 0.020  # beyond the faces of the link's hull [m]: a rough fit with more will not become good
LARGE_DIAGONAL = 1.0  # links with a longer diagonal [m] may have bodies that stand out more, in proportion
TELLING_VERTICES = 4  # vertices of a body from which on it tells how tight others can be
# axes whose rough fits stand out by no more than this many times the least are compared by measuring
NEAR_LEAST = 1.15
OUTLINE_CORNERS = 400  # corners of the hull from which how far bodies stand out is measured
REACH = 0.06  # how far a slab's body may reach into neighbouring slabs at no cost [m]
CANDIDATES = ((1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (1, 6), (3, 4), (2, 6), (3, 6))  # slabs, vertices; cheapest first


def fitted(triangles: Array, candidates: tuple[tuple[int, int], ...] = CANDIDATES) -> tuple[Swept, ...]:
    """Return bodies around triangles (T, 3, 3): the cheapest candidate that fits well, or else the tightest.

    A candidate is passed over, unless it is the last, if it would have to be tighter than the best so far by more than
    in proportion to their vertices.
    """
    link = _Link(triangles)
    limit = PROMISING_OVERHANG * link.slack
    best: _Rough | None = None
    scored: list[tuple[float, tuple[Swept, ...]]] = []
    along: tuple[int, ...] = (0, 1, 2)  # axes; those that do worse with bodies of some vertices are given up
    for slabs, vertices in candidates:
        if best is not None and best.vertices >= TELLING_VERTICES and (slabs, vertices) != candidates[-1]:
            least = best.excess * best.vertices / (slabs * vertices)
            if least > limit:
                continue
        trials = link.roughly(slabs, vertices, along if slabs > 1 else (0,))
        best = trials[0] if best is None else min(best, trials[0], key=lambda each: each.excess)
        near = [trial for trial in trials if trial.excess <= NEAR_LEAST * trials[0].excess]
        scores = {}
        for trial in near:
            if trial.excess <= limit:
                bodies = finished(trial.targets, trial.bodies)
                scores[trial.axis] = link.score(bodies)
                if scores[trial.axis] <= 1.0:
                    return bodies
                scored.append((scores[trial.axis], bodies))
        if slabs > 1 and vertices >= TELLING_VERTICES:
            along = (min(scores, key=scores.__getitem__),) if scores else tuple(trial.axis for trial in near)
    if scored:
        return min(scored, key=lambda each: each[0])[1]
    assert best is not None
    return finished(best.targets, best.bodies)


def box_axes(points: Array) -> Array:
    """Return the axes (3, 3), as rows, of the oriented bounding box of points, longest side first."""
    to_box, extents = trimesh.bounds.oriented_bounds(points)
    return np.asarray(to_box[:3, :3][np.argsort(-extents)])


def hull_points(points: Array) -> Array:
    """Return the corners (N, 3) of the convex hull of points (M, 3)."""
    return np.asarray(points[scipy.spatial.ConvexHull(points).vertices])


@dataclass(frozen=True, eq=False)
class _Rough:
    """A rough fit of one body for each slab."""

    axis: int  # along which the link is cut
    targets: list[Target]
    bodies: list[Swept]
    excess: float  # beyond the faces of the link's hull, root mean square [m]

    @property
    def vertices(self) -> int:
        return sum(len(body.vertices) for body in self.bodies)


class _Link:
    """A link's surface, its hull, and its pieces."""

    def __init__(self, triangles: Array) -> None:
        corners, rows = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        ends = np.sort(rows.reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2))
        self.corners = corners
        self.edges = np.stack(np.divmod(np.unique(ends[:, 0] * len(corners) + ends[:, 1]), len(corners)))
        self.points = hull_points(corners)
        self.hull = Reference.of(self.points)
        self.outline = spread(self.points, OUTLINE_CORNERS)
        self.slack = max(1.0, float(np.linalg.norm(np.ptp(self.points, axis=0))) / LARGE_DIAGONAL)
        self.cut: dict[tuple[int, int], list[Target]] = {}

    @cached_property
    def axes(self) -> Array:
        return box_axes(self.outline)

    def roughly(self, slabs: int, vertices: int, along: tuple[int, ...]) -> list[_Rough]:
        """Return rough fits of the link cut along these axes, the tightest first."""
        targets = {axis: self.targets(slabs, axis) for axis in along}
        bodies = iter(rough_fits([each for axis in along for each in targets[axis]], vertices))
        parts = {axis: list(itertools.islice(bodies, len(targets[axis]))) for axis in along}
        found = [_Rough(axis, targets[axis], parts[axis], self.hull.excess(*parts[axis])) for axis in along]
        return sorted(found, key=lambda each: each.excess)

    def score(self, bodies: tuple[Swept, ...]) -> float:
        """Return the excess of bodies beyond the hull, as a fraction of the acceptable excess."""
        mean, p95 = outside(bodies, self.outline)
        return max(mean / GOOD_MEAN, p95 / GOOD_P95) / self.slack

    def targets(self, slabs: int, axis: int) -> list[Target]:
        """Return the points that the bodies of equal slabs along an axis must contain; bodies may reach beyond by
        REACH."""
        if (slabs, axis) not in self.cut:
            self.cut[slabs, axis] = self._slabs(slabs, axis) if slabs > 1 else [Target.of(self.points, self.points)]
        return self.cut[slabs, axis]

    def _slabs(self, count: int, axis: int) -> list[Target]:
        """Return the targets of `count` slabs, or fewer: one that holds nothing, or nothing that has a volume, as
        between parts of a link that stand apart, is taken together with the next."""
        height = self.corners @ self.axes[axis]
        cuts = np.linspace(height.min(), height.max(), count + 1)[1:-1].tolist()
        low, parts = -np.inf, []
        for high in (*cuts, np.inf):
            points = _corners_of_volume(self._between(height, low, high))
            if points is not None:
                parts.append((low, high, points))
                low = high
        if low < np.inf:  # what is left is taken together with the last
            low = parts.pop()[0] if parts else low
            parts.append((low, np.inf, hull_points(self._between(height, low, np.inf))))
        return [
            Target.of(points, hull_points(self._between(height, low - REACH, high + REACH)))
            for low, high, points in parts
        ]

    def _between(self, height: Array, low: float, high: float) -> Array:
        """Return points whose hull is that of what lies between two heights: corners there, and where edges cross."""
        points = [self.corners[(height >= low) & (height <= high)]]
        first, second = height[self.edges]
        for cut in (low, high):
            a, b = self.edges[:, (first < cut) != (second < cut)]
            share = (cut - height[a]) / (height[b] - height[a])
            points.append(self.corners[a] + share[:, None] * (self.corners[b] - self.corners[a]))
        return np.concatenate(points)


def _corners_of_volume(points: Array) -> Array | None:
    """Return the corners of the hull of points (N, 3); None if it has no volume."""
    try:
        return hull_points(points) if len(points) else None
    except scipy.spatial.QhullError:
        return None
