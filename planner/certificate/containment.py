"""Bodies that lie wholly inside the solid that a mesh bounds, which distances between surfaces do not show.

Let A be bounded by triangles, and B convex or bounded by triangles too. Let no triangle of A meet B, or a triangle of
B, at any time of a motion: the collision proof shows that, piece by piece, as the pieces that a mesh is cut into
contain all of its triangles. Then the winding number of A around a point p of B, as both move, changes continuously
with time, and with p along the connected part of B to which p belongs. For a closed A it is an integer, so it is
constant: one point of each part, at one instant, decides for the whole part and the whole motion. And if no part of B
is inside A, and none of A inside B, they have no point in common: from a common point, follow a straight line to the
first surface of the two, say that of A; B has not been left yet, so this point, and the part of A to which it belongs,
is inside B.

So every pair of solids is checked at the start, as whole solids, whatever the distances of their pieces. An open mesh
lets bodies in through its hole, and its winding number is not an integer, so it is checked at every waypoint; between
two waypoints only its triangles count.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.certificate.intervals import Bodies, Body, Intervals, Pairs
from hdplan.planner.geometry.cells import grouped
from hdplan.planner.geometry.meshes import connected
from hdplan.planner.geometry.solids import Solid
from hdplan.scenes.array_types import Array, Rows

CHECKED_OVERLAPS = 1000  # balls of which it is worthwhile to find those that overlap
TOUCHING_CUBE = 1.15  # of the radius: balls in a cube of this edge have centres less than two radii apart
ROUNDING_SHARE = 1e-9  # share by which balls around parts are larger, for rounding


class Containment:
    """The solids of a scene, prepared for checks at many configurations.

    Each of q queries is whether a part of the body `inner`, one point of it, is inside the solid of the body `outer`.
    """

    def __init__(self, bodies: Bodies, pairs: Pairs) -> None:
        """Collect the queries: every pair of bodies one of which is bounded by triangles. Of a cloud every ball is a
        part, so that the parts of a body are examined only where the body is near the solid."""
        self.bodies = bodies
        first: dict[object, int] = {}  # the first of all pieces cut from one mesh stands for them
        whole = np.array([first.setdefault(_identity(body), row) for row, body in enumerate(bodies.bodies)], np.int64)
        self._pairs = np.flatnonzero(bodies.bounding[pairs.a] | bodies.bounding[pairs.b])  # of pieces
        key = whole[pairs.a[self._pairs]] * len(whole) + whole[pairs.b[self._pairs]]
        met, self._met = np.unique(key, return_inverse=True)  # bodies that meet (u,); each pair's row among these
        both = np.stack(np.divmod(met, len(whole)), axis=1)  # (u, 2)
        outer, inner, queries = both.ravel(), both[:, ::-1].ravel(), np.repeat(np.arange(len(met)), 2)
        self.outer, self.inner, self._queries = (each[bodies.bounding[outer]] for each in (outer, inner, queries))
        self._parts: dict[int, Array] = {}  # of bodies that were near a solid
        self.center, self.radius = np.zeros((len(whole), 3)), np.zeros(len(whole))  # of balls around the parts
        for row in sorted(set(self.inner.tolist())):
            points = _points(bodies.bodies[row])
            self.center[row] = 0.5 * (points.min(axis=0) + points.max(axis=0))
            self.radius[row] = float(np.linalg.norm(points - self.center[row], axis=1).max())
        self.low, self.high = (np.full((len(whole), 3), bound) for bound in (np.inf, -np.inf))  # of the solids
        hollow = np.zeros(len(whole), dtype=bool)
        for row in sorted(set(self.outer.tolist())):
            solid = self._solid(row)
            (self.low[row], self.high[row]), hollow[row] = solid.box, solid.open
        self.open = hollow[self.outer]  # (q,)

    def found(self, nodes: Intervals) -> list[tuple[int, tuple[int, ...]]]:
        """Return the bodies that are inside others at the midpoints of intervals: the interval's row, and the pairs of
        the two bodies' pieces."""
        return self._found(nodes, np.arange(len(self.outer)))

    def found_in_open(self, nodes: Intervals) -> list[tuple[int, tuple[int, ...]]]:
        """Return the bodies that are inside others, of open meshes only."""
        return self._found(nodes, np.flatnonzero(self.open))

    def _found(self, nodes: Intervals, rows: Rows) -> list[tuple[int, tuple[int, ...]]]:
        outer, inner = self.outer[rows], self.inner[rows]
        every = np.arange(len(nodes.interval))[:, None]
        inside, around = nodes.row(every, inner), nodes.row(every, outer)  # (k, q)
        world = np.einsum("kqij,qj->kqi", nodes.rotation[inside], self.center[inner]) + nodes.origin[inside]
        local = np.einsum("kqji,kqj->kqi", nodes.rotation[around], world - nodes.origin[around])
        room = (self.radius * (1.0 + ROUNDING_SHARE))[inner][:, None]
        near = ((local >= self.low[outer] - room) & (local <= self.high[outer] + room)).all(axis=2)
        found: dict[tuple[int, tuple[int, ...]], None] = {}
        for node, row in np.argwhere(near).tolist():
            pairs = tuple(self._pairs[self._met == self._queries[rows[row]]].tolist())
            a, b = int(inner[row]), int(outer[row])
            if (node, pairs) not in found and self._holds(nodes.pose(node, b), b, nodes.pose(node, a), a):
                found[node, pairs] = None
        return list(found)

    def _holds(self, around: Array, outer: int, inside: Array, inner: int) -> bool:
        """True if the solid of one body holds a part of another one, at these placements (4, 4)."""
        if inner not in self._parts:
            self._parts[inner] = _parts(self.bodies.bodies[inner])
        world = self._parts[inner] @ inside[:3, :3].T + inside[:3, 3]
        local = (world - around[:3, 3]) @ around[:3, :3]
        near = ((local >= self.low[outer]) & (local <= self.high[outer])).all(axis=1)
        return any(self._solid(outer).holds(point) for point in local[near])

    def _solid(self, row: int) -> Solid:
        surface = self.bodies.pieces[row].surface
        assert surface is not None
        return surface.solid


def _identity(body: Body) -> object:
    """Return the key that all pieces cut from one mesh share."""
    surface = body.piece.surface
    if surface is None:
        return id(body)
    # all copies of a mesh have one solid, and an obstacle may have the name of a link: neither alone tells them apart
    return body.name, id(surface.solid), body.joint, body.placement.tobytes(), body.obstacle_motion


def _points(body: Body) -> Array:
    """Return points of the body (c, 3), in its frame, at least one of each connected part: of a cloud, of each ball."""
    surface, grains = body.piece.surface, body.piece.grains
    if grains is not None:
        return grains[:, :3]
    return body.piece.vertices[:1] if surface is None else surface.solid.parts


def _parts(body: Body) -> Array:
    """Return one of its points (c, 3) for each connected part, or for less than that: balls that overlap are one."""
    points, grains = _points(body), body.piece.grains
    if grains is None:
        return points
    order, first = grouped(points, TOUCHING_CUBE * float(grains[:, 3].min()))  # those in one cube overlap
    points, radii = points[order[first]], grains[order[first], 3]
    if len(points) > CHECKED_OVERLAPS:
        return points
    one, other = np.nonzero(np.linalg.norm(points[:, None] - points, axis=2) < radii[:, None] + radii)
    return points[np.unique(connected(one, other, len(points)), return_index=True)[1]]
