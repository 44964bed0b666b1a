"""Which bodies lie wholly inside the solid that a mesh bounds: distances between surfaces do not show that.

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

from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.intervals import Bodies, Body, Index, Intervals, Pairs
from hdplan.planner.motion.motion_bounds import Array


@dataclass(frozen=True)
class Query:
    """Whether a part of one body is inside the solid of another."""

    outer: int  # row of the bodies: the first of all pieces cut from one mesh
    inner: int
    point: Array  # (3,) on the part, in the frame of `inner`
    pairs: tuple[int, ...]  # of pieces of the two


class Containment:
    """The solids of a scene, prepared for checks at many configurations."""

    def __init__(self, bodies: Bodies, pairs: Pairs) -> None:
        """Collect the queries: every pair of bodies one of which is bounded by triangles."""
        self.bodies = bodies
        first: dict[object, int] = {}
        whole = [first.setdefault(_identity(body), row) for row, body in enumerate(bodies.bodies)]
        met: dict[tuple[int, int], list[int]] = {}
        for pair in np.flatnonzero(bodies.hollow[pairs.a] | bodies.hollow[pairs.b]).tolist():
            met.setdefault((whole[pairs.a[pair]], whole[pairs.b[pair]]), []).append(pair)
        self.queries = tuple(
            Query(outer, inner, point, tuple(rows))
            for (a, b), rows in met.items()
            for outer, inner in ((a, b), (b, a))
            if bodies.pieces[outer].surface is not None
            for point in _parts(bodies.bodies[inner])
        )
        self.outer = np.array([query.outer for query in self.queries], dtype=np.int64)
        self.inner = np.array([query.inner for query in self.queries], dtype=np.int64)
        self.points = np.array([query.point for query in self.queries]).reshape(-1, 3)
        surfaces = [bodies.pieces[query.outer].surface for query in self.queries]
        boxes = [surface.solid.box for surface in surfaces if surface is not None]
        self.low, self.high = np.array(boxes).reshape(-1, 2, 3).transpose(1, 0, 2)
        self.open = np.array([surface is not None and surface.solid.open for surface in surfaces], dtype=bool)

    def found(self, nodes: Intervals) -> list[tuple[int, tuple[int, ...]]]:
        """Return the bodies that are inside others at the midpoints of intervals: the interval's row, and the pairs of
        the two bodies' pieces."""
        return self._found(nodes, np.arange(len(self.queries)))

    def found_in_open(self, nodes: Intervals) -> list[tuple[int, tuple[int, ...]]]:
        """Return the same for open meshes only."""
        return self._found(nodes, np.flatnonzero(self.open))

    def _found(self, nodes: Intervals, rows: Index) -> list[tuple[int, tuple[int, ...]]]:
        outer, inner = self.outer[rows], self.inner[rows]
        every = np.arange(len(nodes.interval))[:, None]
        inside, around = nodes.row(every, inner), nodes.row(every, outer)  # (k, q)
        world = np.einsum("kqij,qj->kqi", nodes.rotation[inside], self.points[rows]) + nodes.origin[inside]
        local = np.einsum("kqji,kqj->kqi", nodes.rotation[around], world - nodes.origin[around])
        near = ((local >= self.low[rows]) & (local <= self.high[rows])).all(axis=2)
        found: dict[tuple[int, tuple[int, ...]], None] = {}
        for node, row in np.argwhere(near).tolist():
            query = self.queries[rows[row]]
            surface = self.bodies.pieces[query.outer].surface
            if (node, query.pairs) not in found and surface is not None and surface.solid.holds(local[node, row]):
                found[node, query.pairs] = None
        return list(found)


def _identity(body: Body) -> object:
    """Return what all pieces cut from one mesh have in common."""
    surface = body.piece.surface
    return id(body) if surface is None else (body.name, id(surface.solid), body.joint, body.placement.tobytes())


def _parts(body: Body) -> Array:
    """Return one point of each connected part (c, 3), in the body's frame."""
    surface = body.piece.surface
    return body.piece.vertices[:1] if surface is None else surface.solid.parts
