"""Triangle meshes: read from files, split into connected parts, and tested for points inside.

A mesh file → vertices (m, 3) [m] and triangles (F, 3), merged into one mesh and checked: it has triangles, its numbers
are finite and it is not flat.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.geometry.mesh_files import read_mesh_file
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.shapes import Mesh

CONVEX_GAP = 1e-3  # share of its hull's volume; a solid that lacks less is replaced by its hull, which contains it
LARGEST_COORDINATE = 1e6  # [m] beyond which distances are lost in rounding
FLAT_RATIO = 1e-6  # a mesh thinner than this part of its length encloses nothing but rounding errors


@dataclass(frozen=True, eq=False)
class TriangleMesh(ReadOnly):
    """Triangles with shared vertices; those that bound a solid run counter-clockwise seen from outside.

    Equal to another one of the same arrays.
    """

    vertices: Array  # (m, 3) [m]
    triangles: Rows  # (F, 3) rows of vertices

    def __eq__(self, other: object) -> bool:
        """Compare contents."""
        return isinstance(other, TriangleMesh) and self.content == other.content

    def __hash__(self) -> int:
        """Hash the content."""
        return hash(self.content)

    @classmethod
    def merged(cls, vertices: ArrayLike, triangles: ArrayLike) -> TriangleMesh:
        """Build a mesh from triangles that may repeat their vertices, as in an STL file; equal vertices are merged."""
        points, index = np.unique(np.asarray(vertices, dtype=np.float64), axis=0, return_inverse=True)
        corners = index.ravel()[np.asarray(triangles, dtype=np.int64)]
        proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
        return cls(points, corners[proper])

    @classmethod
    def hull(cls, points: ArrayLike) -> TriangleMesh:
        """Build the convex hull of points (m, 3) that are not flat."""
        found = scipy.spatial.ConvexHull(points)
        a, b, c = np.moveaxis(found.points[found.simplices], 1, 0)
        outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) > 0
        triangles = np.where(outward[:, None], found.simplices, found.simplices[:, ::-1])
        return cls(found.points, triangles.astype(np.int64)).trimmed()

    @cached_property
    def content(self) -> bytes:
        """Key of equality."""
        digest = hashlib.sha256(np.ascontiguousarray(self.vertices).data)
        digest.update(np.ascontiguousarray(self.triangles).data)
        return digest.digest()

    @property
    def closed(self) -> bool:
        """True if every edge is used once in each direction, so that inside and outside are well defined."""
        a, b = self.triangles.ravel(), np.roll(self.triangles, -1, axis=1).ravel()
        there, back = (np.sort(edges) for edges in (a * len(self.vertices) + b, b * len(self.vertices) + a))
        return len(there) > 0 and bool(np.array_equal(there, back) and (there[1:] != there[:-1]).all())

    @property
    def volume(self) -> float:
        """The enclosed volume [m³] of a closed mesh; negative when the triangles are oriented inwards."""
        corners = (self.vertices - self.vertices.mean(axis=0))[self.triangles]
        return float(np.linalg.det(corners).sum() / 6.0)

    @property
    def hull_volume(self) -> float:
        """The volume [m³] of its convex hull; 0 for a flat one."""
        return float(scipy.spatial.ConvexHull(self.vertices).volume) if thinness(self.vertices) > FLAT_RATIO else 0.0

    @property
    def convex(self) -> bool:
        """True if the mesh is closed and as large as its convex hull, up to the part `CONVEX` of the volume."""
        return self.fills(self.hull_volume)

    def fills(self, volume: float) -> bool:
        """True if the mesh is closed and as large as a hull of this `volume` [m³], up to the part `CONVEX` of it."""
        return self.closed and abs(self.volume) >= (1.0 - CONVEX_GAP) * volume > 0.0

    def components(self) -> tuple[TriangleMesh, ...]:
        """Split the mesh into the parts that share no vertex."""
        corners = self.triangles
        label = connected(corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel(), len(self.vertices))
        kinds = np.flatnonzero(np.bincount(label[corners[:, 0]]))
        if len(kinds) == 1:
            return (self,)
        return tuple(
            TriangleMesh.merged(self.vertices, corners[label[corners[:, 0]] == kind]).trimmed() for kind in kinds
        )

    def trimmed(self) -> TriangleMesh:
        """Drop the vertices that no triangle uses."""
        used, index = np.unique(self.triangles, return_inverse=True)
        return TriangleMesh(self.vertices[used], index.reshape(-1, 3))

    def winding_number(self, point: ArrayLike) -> float:
        """Return the winding number of the mesh around `point` (3,): ±1 inside a closed mesh, 0 outside, in between if
        open.

        The sum of the triangles' signed solid angles over 4π (A. Jacobson et al., "Robust inside-outside segmentation
        using generalized winding numbers", 2013).
        """
        return float(self.solid_angles(point).sum() / (4.0 * np.pi))

    def solid_angles(self, point: ArrayLike) -> Array:
        """Return the signed solid angle (F,) under which each triangle is seen from `point` (3,), positive from inside
        (A. Van Oosterom, J. Strackee, 1983)."""
        beside = self.vertices - np.asarray(point, dtype=np.float64)
        away = np.sqrt((beside * beside).sum(axis=1))
        a, b, c = (np.ascontiguousarray(beside[corner].T) for corner in self.triangles.T)  # rows are quicker
        la, lb, lc = (away[corner] for corner in self.triangles.T)
        ab, bc, ca = ((x * y).sum(axis=0) for x, y in ((a, b), (b, c), (c, a)))
        volume = (
            a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        return np.asarray(2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb))


@dataclass(frozen=True, repr=False)
class ReadMesh(Mesh):
    """A mesh that was read: equal to another one of the same file, scale and content."""

    mesh: TriangleMesh = field(kw_only=True, compare=False, repr=False)
    content: bytes = field(init=False, repr=False)  # tells its triangles from others

    @property
    def requested(self) -> Mesh:
        """The mesh by its file."""
        return Mesh(self.file, self.scale, name=self.name, pose=self.pose)

    def _check_whole(self) -> None:
        object.__setattr__(self, "content", self.mesh.content)


def load_mesh(shape: Mesh, where: str, upright: bool = False) -> TriangleMesh:
    """Read a mesh file (stl, obj, ply, off, dae, glb, gltf), scaled, its parts merged into one.

    `where` is its field in the scene, for error messages; `upright` as in `read_mesh_file`. Raises InputError when the
    file is missing, damaged or of an unknown format, holds no triangles or numbers that are not finite, or is flat.
    """
    with naming(f"{where}: mesh {shape.file}"):
        vertices, triangles = read_mesh_file(shape.file, upright)
        used = np.bincount(triangles.ravel(), minlength=len(vertices)) > 0
        with np.errstate(over="ignore"):
            vertices[used] *= np.array(shape.scale)
        if not np.isfinite(vertices[used]).all():
            raise InputError("holds coordinates that are not finite (NaN or infinite)")
        if np.abs(vertices[used]).max() > LARGEST_COORDINATE:
            raise InputError(f"reaches farther than {LARGEST_COORDINATE:g} m (its scale is {shape.scale[0]:g})")
        mesh = TriangleMesh.merged(vertices, triangles).trimmed()
        if len(mesh.triangles) == 0 or thinness(mesh.vertices) <= FLAT_RATIO:
            raise InputError("is flat; a body with some thickness is needed")
    return mesh


def connected(one: Rows, other: Rows, count: int) -> Rows:
    """Return for each of `count` nodes the number of the connected part in which it lies; node one[k] and node other[k]
    are linked."""
    part: Rows = np.arange(count)  # the least node in each node's known component
    while len(one):
        low, high = np.minimum(part[one], part[other]), np.maximum(part[one], part[other])
        apart = low != high
        one, other = one[apart], other[apart]
        np.minimum.at(part, high[apart], low[apart])
        while (part[part] != part).any():
            part = part[part]
    return np.asarray(np.unique(part, return_inverse=True)[1])


def thinness(points: Array) -> float:
    """Return the smallest over the largest principal extent of `points` (m, 3)."""
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(extents[-1] / extents[0]) if len(extents) == 3 else 0.0


def below(triangles: Array, normal: Array, offset: float) -> Array:
    """Return the parts of triangles (T, 3, 3) where normal · x ≤ offset, as triangles."""
    height = triangles @ normal - offset
    inside = height <= 0
    count = inside.sum(1)
    parts = [triangles[count == 3]]
    for corners_inside in (1, 2):
        chosen = count == corners_inside
        lone = (inside[chosen] if corners_inside == 1 else ~inside[chosen]).argmax(1)  # the corner alone on its side
        turn = (lone[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(triangles[chosen], turn[:, :, None], 1), 1, 0)
        above_a, above_b, above_c = np.take_along_axis(height[chosen], turn, 1).T[:, :, None]
        to_b = a + (b - a) * (above_a / (above_a - above_b))
        to_c = a + (c - a) * (above_a / (above_a - above_c))
        if corners_inside == 1:
            parts.append(np.stack([a, to_b, to_c], 1))
        else:
            parts.extend((np.stack([to_b, b, c], 1), np.stack([to_b, c, to_c], 1)))
    return np.concatenate(parts)
