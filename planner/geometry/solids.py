"""The inside of a mesh, for any orientation of its triangles: solid, hollow, inside out, open, in several
parts.

The winding number w(x) of a closed mesh, the sum of its triangles' signed solid angles over 4π, is an integer that
changes only across triangles: ±1 inside, 0 outside, and also 0 in a cavity, whose wall has the opposite orientation (A.
Van Oosterom, J. Strackee, 1983; A. Jacobson et al., "Robust inside-outside segmentation using generalized winding
numbers", 2013). It can be trusted where triangles are oriented consistently. So a mesh is split into *shells*:
triangles joined by edges that exactly two of them share. A point x counts as inside where |w(x)| > ½ for all
consistently oriented shells together, or for a doubtful shell by itself, after its triangles have been oriented
consistently. A shell is doubtful

    if it is open (w is a fraction then: ½ and more is inside),
    if its triangles were not oriented consistently, or came twice, once each way: cavities cannot be identified then,
    if it crosses a shell of the opposite orientation: the two would cancel where they overlap, and neither is a cavity.

A one-sided shell (such as a Klein bottle) contains all of its bounding box. Doubt only ever adds to the inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np

from hdplan.planner.geometry.coal_shapes import triangle_tree
from hdplan.planner.geometry.meshes import TriangleMesh, connected
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.once import ReadOnly, read_only

WELD = 1e-6  # of a mesh's size: narrower cracks are closed
MOST_CROSSINGS = 10_000  # pairs of shells tested; with more, no shell is taken for a cavity


@dataclass(frozen=True, eq=False)
class Shells(ReadOnly):
    """The triangles of a mesh, each once, grouped into shells."""

    triangles: Rows  # (F, 3) rows of vertices, oriented consistently in each shell
    shell: Rows  # (F,) 0 to S − 1
    turned: Mask  # (S,) were not oriented consistently
    open: Mask  # (S,) have a rim
    one_sided: Mask  # (S,) cannot be oriented consistently

    @classmethod
    def of(cls, triangles: Rows) -> Shells:
        """Split triangles (F, 3) into shells."""
        size = int(triangles.max()) + 1
        low, middle, high = np.sort(triangles, axis=1).T
        _, pair = np.unique(low * size + middle, return_inverse=True)
        _, first, again = np.unique(pair * size + high, return_index=True, return_inverse=True)
        both_ways = np.zeros(len(first), dtype=bool)
        both_ways[again[_odd(triangles) != _odd(triangles[first])[again]]] = True
        triangles = triangles[first]
        count = len(triangles)
        begin, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
        face, rising = np.repeat(np.arange(count), 3), begin < end
        edges = np.minimum(begin, end) * size + np.maximum(begin, end)
        _, edge, met = np.unique(edges, return_inverse=True, return_counts=True)
        order = np.argsort(edge, kind="stable")
        one, other = order[met[edge[order]] == 2].reshape(-1, 2).T
        # each triangle is there twice, as it is and reversed: connected ones are oriented alike
        same = rising[one] != rising[other]
        joined = np.concatenate([face[other] + count * ~same, (face[other] + count * same)])
        way = connected(np.concatenate([face[one], face[one] + count]), joined, 2 * count)
        _, shell = np.unique(np.minimum(way[:count], way[count:]), return_inverse=True)
        number = int(shell.max()) + 1
        lead = np.unique(shell, return_index=True)[1]  # the first triangle of each shell keeps its orientation
        flip = way[:count] != way[lead][shell]
        triangles = np.where(flip[:, None], triangles[:, ::-1], triangles)
        rising = np.where(np.repeat(flip, 3), ~rising, rising)
        held, row = np.unique(np.repeat(shell, 3) * len(met) + edge, return_inverse=True)
        balance = np.bincount(row, weights=np.where(rising, 1.0, -1.0))
        one_sided = way[lead] == way[count:][lead]
        return cls(
            triangles,
            shell,
            _any(flip | both_ways, shell, number) | one_sided,
            _any(balance != 0.0, held // len(met), number),
            one_sided,
        )


@dataclass(frozen=True, eq=False)
class Solid:
    """The solid that a mesh bounds."""

    mesh: TriangleMesh

    @cached_property
    def shells(self) -> Shells:
        """Shells of the mesh, after cracks are closed."""
        return Shells.of(self._whole.triangles)

    @cached_property
    def _whole(self) -> TriangleMesh:
        """The mesh with vertices merged that are closer than WELD of its size: rounding in files tears edges open."""
        mesh = self.mesh
        if mesh.closed:
            return mesh
        reach = WELD * float(np.linalg.norm(self.box[1] - self.box[0]))
        _, first, cell = np.unique(np.floor(mesh.vertices / reach), axis=0, return_index=True, return_inverse=True)
        one, other = scipy.spatial.cKDTree(mesh.vertices[first]).query_pairs(reach, output_type="ndarray").T
        joined = connected(one, other, len(first))
        label = joined[cell.ravel()]
        corners = label[mesh.triangles]
        proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
        return TriangleMesh(mesh.vertices[np.unique(label, return_index=True)[1]], corners[proper].astype(np.int64))

    @cached_property
    def open(self) -> bool:
        """True if the mesh has a hole, through which a body could enter without touching a triangle."""
        return bool(self.shells.open.any())

    @cached_property
    def parts(self) -> Array:
        """A point (c, 3) on each part that is connected by its vertices."""
        corners = self.mesh.triangles
        label = connected(corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel(), len(self.mesh.vertices))
        used = np.flatnonzero(np.bincount(corners.ravel()))
        return read_only(self.mesh.vertices[used[np.unique(label[used], return_index=True)[1]]])

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """The corners (3,) of the bounding box: outside it |w| < ½ for every shell, whose triangles lie on one side of
        a plane."""
        return read_only(self.mesh.vertices.min(axis=0)), read_only(self.mesh.vertices.max(axis=0))

    @cached_property
    def _doubtful(self) -> Mask:
        shells = self.shells
        doubtful = shells.turned | shells.open
        corners = self._whole.vertices[shells.triangles] - self._whole.vertices.mean(axis=0)
        volume = np.bincount(shells.shell, weights=np.linalg.det(corners), minlength=len(doubtful))
        low, high = np.full((len(doubtful), 3), np.inf), np.full((len(doubtful), 3), -np.inf)
        np.minimum.at(low, shells.shell, corners.min(axis=1))
        np.maximum.at(high, shells.shell, corners.max(axis=1))
        outward, inward = (np.flatnonzero((sign * volume > 0.0) & ~doubtful) for sign in (1.0, -1.0))
        if len(outward) * len(inward) > MOST_CROSSINGS:
            doubtful[inward] = True
            return doubtful
        for i in inward.tolist():
            near = (low[outward] <= high[i]).all(axis=1) & (high[outward] >= low[i]).all(axis=1)
            for j in outward[near].tolist():
                if _cross(self._tree(i), self._tree(j)):
                    doubtful[[i, j]] = True
        return doubtful

    def _tree(self, shell: int) -> object:
        return triangle_tree(TriangleMesh(self._whole.vertices, self.shells.triangles[self.shells.shell == shell]))

    def holds(self, point: Array) -> bool:
        """True if a point (3,) that is not on a triangle is inside."""
        low, high = self.box
        if (point < low).any() or (point > high).any():
            return False
        shells, doubtful = self.shells, self._doubtful
        around = np.bincount(shells.shell, weights=self._turned.solid_angles(point))
        alone, together = np.abs(around[doubtful]), abs(around[~shells.turned].sum())
        return bool(together > 2.0 * np.pi or (alone > 2.0 * np.pi).any()) or self._boxed(point)

    @cached_property
    def _turned(self) -> TriangleMesh:
        return TriangleMesh(self._whole.vertices, self.shells.triangles)

    def _boxed(self, point: Array) -> bool:
        """True if a point is in the bounding box of a one-sided shell."""
        shells = self.shells
        for shell in np.flatnonzero(shells.one_sided).tolist():
            corners = self._whole.vertices[shells.triangles[shells.shell == shell]].reshape(-1, 3)
            if (point >= corners.min(axis=0)).all() and (point <= corners.max(axis=0)).all():
                return True
        return False


def _odd(triangles: Rows) -> Mask:
    """True if a triangle's corners (F, 3) are an odd permutation of their order."""
    a, b, c = triangles.T
    return np.asarray((a > b) ^ (b > c) ^ (a > c))


def _any(chosen: Mask, shell: Rows, number: int) -> Mask:
    return np.bincount(shell, weights=chosen, minlength=number) > 0.0


def _cross(a: object, b: object) -> bool:
    here = coal.Transform3s()
    return bool(coal.collide(a, here, b, here, coal.CollisionRequest(), coal.CollisionResult()))
