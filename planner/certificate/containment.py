"""Which bodies lie wholly inside the solid that a mesh bounds: what distances between surfaces do not tell.

Let A be bounded by triangles and B a convex body or bounded by triangles too, and let no triangle of A meet B, or a
triangle of B, at any time of a motion: the sweep proves that, piece by piece, as the pieces that a mesh is cut into
hold all of its triangles. Then the winding number of A around a point p of B, each where the motion brings it, changes
continuously with time, and with p along the part of B that p belongs to, a convex body or triangles that hang together.
For a closed A it is an integer, so it is constant: one point of each part, at one instant, tells for the whole part and
the whole motion. And where no part of B is inside A, and none of A inside B, they have no point in common: from a
common point go straight on to the first surface of the two, that of A, say; B has not been left, so this point, and the
part of A that it belongs to, is inside B.

So every pair of solids is asked at the start, whatever the distances of the pieces, by the solids whole. An open mesh
lets bodies in by its hole, and its winding number is a fraction, so it is asked at every waypoint: between two of them
it is its triangles, and nothing more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.intervals import Bodies, Body, Index, Intervals, Pairs
from hdplan.planner.motion.motion_bounds import Array


@dataclass(frozen=True)
class Query:
    """Whether a part of one body is inside the solid of another."""

    outer: int  # row of the bodies: of all pieces cut from one mesh the first
    inner: int
    point: Array  # (3,) on the part, in the frame of `inner`
    pairs: tuple[int, ...]  # of pieces of the two


class Containment:
    """The solids of a scene, made ready to be asked in many configurations."""

    def __init__(self, bodies: Bodies, pairs: Pairs) -> None:
        """Gather what there is to ask: every pair of bodies of which one is bounded by triangles."""
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
        """Return the same of open meshes alone."""
        return self._found(nodes, np.flatnonzero(self.open))

    def _found(self, nodes: Intervals, rows: Index) -> list[tuple[int, tuple[int, ...]]]:
        outer, inner = self.outer[rows], self.inner[rows]
        world = np.einsum("kqij,qj->kqi", nodes.rotation[:, inner], self.points[rows]) + nodes.origin[:, inner]
        local = np.einsum("kqji,kqj->kqi", nodes.rotation[:, outer], world - nodes.origin[:, outer])
        near = ((local >= self.low[rows]) & (local <= self.high[rows])).all(axis=2)
        found: dict[tuple[int, tuple[int, ...]], None] = {}
        for node, row in np.argwhere(near).tolist():
            query = self.queries[rows[row]]
            surface = self.bodies.pieces[query.outer].surface
            if (node, query.pairs) not in found and surface is not None and surface.solid.holds(local[node, row]):
                found[node, query.pairs] = None
        return list(found)


def _identity(body: Body) -> object:
    """What pieces that are cut from one mesh have in common."""
    surface = body.piece.surface
    return id(body) if surface is None else (body.name, id(surface.solid), body.joint, body.placement.tobytes())


def _parts(body: Body) -> Array:
    """A point (c, 3) of each part that hangs together, in the body's frame."""
    surface = body.piece.surface
    return body.piece.vertices[:1] if surface is None else surface.solid.parts
