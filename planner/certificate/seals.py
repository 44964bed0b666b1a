"""Seals: closed surfaces through which no ball of a given radius gets.

A ball that may not touch the points p_i of obstacles has its centre in U = {x : |x − p_i| > r_i for all i}, r_i its
radius and what it must keep. Let Z be a closed surface of triangles between such points, each of which is *shut*: every
point of it is within r_i of one of its corners. U and Z have no point in common, and the winding number of Z is
constant where Z is not. So if it differs at two points of U, no curve in U joins them: no motion brings the ball from
one to the other (Z. McCarthy, T. Bretl, S. Hutchinson, "Proving path non-existence using sampling and alpha shapes",
2012).

*Shut.* For z = Σ λ_i p_i in a triangle, Σ λ_i (|z − p_i|² − r_i²) = −Σ_ij λ_i λ_j Q_ij with Q_ij = ½ (r_i² + r_j² −
|p_i − p_j|²). If that is nowhere positive, some |z − p_i| ≤ r_i everywhere. It is so if and only if Q is copositive:
with q_ij = Q_ij / (r_i r_j), if all q_ij ≥ −1 and 1 + q_12 + q_13 + q_23 + √(2 (1 + q_12)(1 + q_13)(1 + q_23)) ≥ 0 (K.
P. Hadeler, "On copositive matrices", 1983).

*Where Z is sought.* In the regular triangulation of the points with weights r_i², of which triangles that are not
shut are the openings (H. Edelsbrunner, "Weighted alpha shapes", 1992): Z is the boundary of all tetrahedra to which
openings lead from a point. Nothing is taken on trust of it: that Z is closed, that its triangles are shut, and its
winding numbers are computed from its triangles alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.planner.geometry.meshes import TriangleMesh, connected
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.once import ReadOnly

RADIUS_SHRINK = 1.0 - 1e-6  # of the radii: rounding
JOGGLE = 1e-6  # of the weights: no five points are on one sphere
WINDING_ERROR = 1e-2  # by which a winding number may differ from a whole number
FACETS = ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))  # of a tetrahedron, opposite to each corner, outward


@dataclass(frozen=True, eq=False)
class Barrier(ReadOnly):
    """Points that balls must avoid."""

    points: Array  # (n, 3) [m]
    radii: Array  # (n,) [m] how far a ball's centre must be from each

    def seal(self, start: Array, goal: Array, off: float) -> Rows | None:
        """Return the points (m,) of a seal between centres (3,) at start and goal, from which the ball's may be `off`
        by so much [m]; None if none was found."""
        try:
            surfaces = [self._boundary(end) for end in (start, goal)]
        except scipy.spatial.QhullError:  # fewer than five points, or all in one plane
            return None
        for surface in sorted(surfaces, key=len):
            if self.separates(surface, start, goal, off):
                return np.unique(surface)
        return None

    def separates(self, surface: Rows, start: Array, goal: Array, off: float) -> bool:
        """True if triangles (f, 3) between the points are a seal between two centres; see `seal`."""
        if not len(surface) or not self.shut(surface).all() or not _closed(surface):
            return False
        rows = np.unique(surface)
        for center in (start, goal):
            if not (np.linalg.norm(self.points[rows] - center, axis=1) > self.radii[rows] + off).all():
                return False
        mesh = TriangleMesh(self.points, surface)
        turns = np.array([mesh.winding_number(center) for center in (start, goal)])
        return bool((np.abs(turns - turns.round()) < WINDING_ERROR).all() and turns[0].round() != turns[1].round())

    def shut(self, triangles: Rows) -> Mask:
        """True for triangles (f, 3) every point of which is within the radius of a corner."""
        corners, radii = self.points[triangles], RADIUS_SHRINK * self.radii[triangles]
        ends, other = np.roll(corners, -1, axis=1), np.roll(radii, -1, axis=1)
        apart = ((corners - ends) ** 2).sum(axis=2)
        q = 0.5 * (radii**2 + other**2 - apart) / (radii * other)  # (f, 3)
        below = np.maximum(1.0 + q, 0.0)
        return np.asarray((q >= -1.0).all(axis=1) & (1.0 + q.sum(axis=1) + np.sqrt(2.0 * below.prod(axis=1)) >= 0.0))

    @cached_property
    def _cells(self) -> tuple[Rows, Rows, Rows]:
        """The tetrahedra (t, 4) of the triangulation, oriented; the number of the part that each belongs to (t,), 0 the
        outside; and which one is behind each of its facets (t, 4), t the outside."""
        middle = self.points.mean(axis=0)
        beside, weights = self.points - middle, self.radii**2
        joggled = 1.0 + JOGGLE * np.random.default_rng(0).uniform(-1.0, 1.0, len(weights))
        hull = scipy.spatial.ConvexHull(np.column_stack([beside, (beside**2).sum(axis=1) - joggled * weights]))
        lower = hull.equations[:, 3] < 0.0
        row = np.full(len(lower), lower.sum())
        row[lower] = np.arange(lower.sum())
        found, next_to = hull.simplices[lower].astype(np.int64), row[hull.neighbors[lower]]
        a, b, c, d = np.moveaxis(self.points[found], 1, 0)
        turned = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
        found[turned], next_to[turned] = found[turned][:, [1, 0, 2, 3]], next_to[turned][:, [1, 0, 2, 3]]
        facets = found[:, np.array(FACETS)]  # (t, 4, 3)
        cell, side = np.nonzero(~self.shut(facets.reshape(-1, 3)).reshape(-1, 4))
        part = connected(cell, next_to[cell, side], len(found) + 1)
        return found, part, next_to

    def _boundary(self, center: Array) -> Rows:
        """Return the triangles (f, 3) around all to which openings lead from a point (3,)."""
        tetrahedra, part, next_to = self._cells
        within = part == part[self._around(center)]
        within ^= within[-1]  # the outside is not
        cell, side = np.nonzero(within[:-1, None] & ~within[next_to])
        return np.asarray(tetrahedra[cell[:, None], np.array(FACETS)[side]])

    def _around(self, center: Array) -> int:
        """Return the tetrahedron around a point (3,), or the outside."""
        tetrahedra, _, _ = self._cells
        facets = (self.points[tetrahedra] - center)[:, np.array(FACETS)]  # (t, 4, 3, 3)
        found = np.flatnonzero((np.linalg.det(facets) >= 0.0).all(axis=1))
        return int(found[0]) if len(found) else len(tetrahedra)


def _closed(surface: Rows) -> bool:
    """True if every edge of triangles (f, 3) is there as often in one direction as in the other."""
    a, b = surface.ravel(), np.roll(surface, -1, axis=1).ravel()
    size = int(surface.max()) + 1
    return bool(np.array_equal(np.sort(a * size + b), np.sort(b * size + a)))
