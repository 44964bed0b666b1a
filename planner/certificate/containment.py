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

import numpy as np

from hdplan.planner.certificate.intervals import Bodies, Body, Index, Intervals, Pairs
from hdplan.planner.geometry.solids import Solid
from hdplan.planner.motion.motion_bounds import Array


class Containment:
    """The solids of a scene, prepared for checks at many configurations.

    Each of q queries asks whether one point of a part of the body `inner` is inside the solid of the body `outer`.
    """

    def __init__(self, bodies: Bodies, pairs: Pairs) -> None:
        """Collect the queries: every pair of bodies one of which is bounded by triangles."""
        self.bodies = bodies
        first: dict[object, int] = {}  # the first of all pieces cut from one mesh stands for them
        whole = np.array([first.setdefault(_identity(body), row) for row, body in enumerate(bodies.bodies)], np.int64)
        self._pairs = np.flatnonzero(bodies.hollow[pairs.a] | bodies.hollow[pairs.b])  # of pieces
        key = whole[pairs.a[self._pairs]] * len(whole) + whole[pairs.b[self._pairs]]
        met, self._met = np.unique(key, return_inverse=True)  # bodies that meet (u,); which of them each pair is of
        both = np.stack(np.divmod(met, len(whole)), axis=1)  # (u, 2)
        outer, inner, asked = both.ravel(), both[:, ::-1].ravel(), np.repeat(np.arange(len(met)), 2)
        outer, inner, asked = (each[bodies.hollow[outer]] for each in (outer, inner, asked))
        parts = {row: _parts(bodies.bodies[row]) for row in sorted(set(inner.tolist()))}
        count = [len(parts[row]) for row in inner.tolist()]
        self.outer, self.inner, self._asked = (np.repeat(each, count) for each in (outer, inner, asked))
        self.points = np.concatenate([np.empty((0, 3)), *(parts[row] for row in inner.tolist())])
        self.low, self.high = (np.full((len(whole), 3), bound) for bound in (np.inf, -np.inf))  # of the solids
        hollow = np.zeros(len(whole), dtype=bool)
        for row in sorted(set(outer.tolist())):
            solid = self._solid(row)
            (self.low[row], self.high[row]), hollow[row] = solid.box, solid.open
        self.open = hollow[self.outer]  # (q,)

    def found(self, nodes: Intervals) -> list[tuple[int, tuple[int, ...]]]:
        """Return the bodies that are inside others at the midpoints of intervals: the interval's row, and the pairs of
        the two bodies' pieces."""
        return self._found(nodes, np.arange(len(self.outer)))

    def found_in_open(self, nodes: Intervals) -> list[tuple[int, tuple[int, ...]]]:
        """Return the same for open meshes only."""
        return self._found(nodes, np.flatnonzero(self.open))

    def _found(self, nodes: Intervals, rows: Index) -> list[tuple[int, tuple[int, ...]]]:
        outer, inner = self.outer[rows], self.inner[rows]
        every = np.arange(len(nodes.interval))[:, None]
        inside, around = nodes.row(every, inner), nodes.row(every, outer)  # (k, q)
        world = np.einsum("kqij,qj->kqi", nodes.rotation[inside], self.points[rows]) + nodes.origin[inside]
        local = np.einsum("kqji,kqj->kqi", nodes.rotation[around], world - nodes.origin[around])
        near = ((local >= self.low[outer]) & (local <= self.high[outer])).all(axis=2)
        found: dict[tuple[int, tuple[int, ...]], None] = {}
        for node, row in np.argwhere(near).tolist():
            pairs = tuple(self._pairs[self._met == self._asked[rows[row]]].tolist())
            if (node, pairs) not in found and self._solid(int(outer[row])).holds(local[node, row]):
                found[node, pairs] = None
        return list(found)

    def _solid(self, row: int) -> Solid:
        surface = self.bodies.pieces[row].surface
        assert surface is not None
        return surface.solid


def _identity(body: Body) -> object:
    """Return what all pieces cut from one mesh have in common."""
    surface = body.piece.surface
    return id(body) if surface is None else (body.name, id(surface.solid), body.joint, body.placement.tobytes())


def _parts(body: Body) -> Array:
    """Return one point of each connected part (c, 3), in the body's frame."""
    surface = body.piece.surface
    return body.piece.vertices[:1] if surface is None else surface.solid.parts
