"""Triangle meshes: read from files, taken apart into pieces, and asked what is inside them.

A mesh file → vertices (m, 3) [m] and triangles (F, 3), merged to one mesh, checked: it has triangles, its numbers are
finite and it is not flat.
"""

from __future__ import annotations

import threading
import warnings
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from hdplan.scenes.errors import InputError
from hdplan.scenes.model import Mesh

Array = NDArray[np.float64]

CONVEX = 1e-3  # a solid that misses less than this part of its hull's volume passes for its hull, which contains it
LARGEST = 1e6  # [m] beyond which distances drown in rounding
FLAT = 1e-6  # thinner than this part of its length, a mesh encloses nothing that could be told from rounding

_reading = threading.Lock()  # which warnings are passed over is set for the whole process


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles with shared vertices; those that bound a solid run counter-clockwise seen from outside."""

    vertices: Array  # (m, 3) [m]
    triangles: NDArray[np.int64]  # (F, 3) rows of vertices

    @classmethod
    def merged(cls, vertices: ArrayLike, triangles: ArrayLike) -> TriangleMesh:
        """Build one from triangles that may repeat their vertices, as an STL file does; equal vertices become one."""
        points, index = np.unique(np.asarray(vertices, dtype=np.float64), axis=0, return_inverse=True)
        corners = index.ravel()[np.asarray(triangles, dtype=np.int64)]
        proper = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
        return cls(points, corners[proper])

    @classmethod
    def hull(cls, points: ArrayLike) -> TriangleMesh:
        """Build the convex hull of points (m, 3) that are not flat."""
        found = ConvexHull(points)
        a, b, c = np.moveaxis(found.points[found.simplices], 1, 0)
        outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) > 0
        triangles = np.where(outward[:, None], found.simplices, found.simplices[:, ::-1])
        return cls(found.points, triangles.astype(np.int64)).trimmed()

    @property
    def closed(self) -> bool:
        """Whether every edge is met once in each direction, so that inside and outside are told apart."""
        a, b = self.triangles.ravel(), np.roll(self.triangles, -1, axis=1).ravel()
        size = len(self.vertices)
        return len(self.triangles) > 0 and bool(
            np.array_equal(np.unique(a * size + b), np.sort(b * size + a)) and len(np.unique(a * size + b)) == len(a)
        )

    @property
    def volume(self) -> float:
        """The enclosed volume [m³] of a closed mesh; negative when the triangles run the other way round."""
        corners = (self.vertices - self.vertices.mean(axis=0))[self.triangles]
        return float(np.linalg.det(corners).sum() / 6.0)

    @property
    def hull_volume(self) -> float:
        """The volume [m³] of its convex hull; 0 for a flat one."""
        return float(ConvexHull(self.vertices).volume) if thinness(self.vertices) > FLAT else 0.0

    @property
    def convex(self) -> bool:
        """Whether it is closed and as large as its convex hull, up to the part `CONVEX` of the volume."""
        return self.closed and abs(self.volume) >= (1.0 - CONVEX) * self.hull_volume > 0.0

    def components(self) -> tuple[TriangleMesh, ...]:
        """Take it apart into the pieces that share no vertex."""
        corners, size = self.triangles, len(self.vertices)
        links = (np.ones(2 * len(corners)), (corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel()))
        _, label = connected_components(coo_matrix(links, shape=(size, size)), directed=False)
        kinds = np.unique(label[corners[:, 0]])
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
        """Return how often the mesh winds around `point` (3,): ±1 inside a closed mesh, 0 outside, in between if open.

        The sum of the triangles' signed solid angles over 4π (A. Jacobson et al., "Robust inside-outside segmentation
        using generalized winding numbers", 2013).
        """
        return float(self.solid_angles(point).sum() / (4.0 * np.pi))

    def solid_angles(self, point: ArrayLike) -> Array:
        """Return the signed solid angle (F,) under which each triangle is seen from `point` (3,), positive from inside
        (A. Van Oosterom, J. Strackee, 1983)."""
        corners = self.vertices[self.triangles] - np.asarray(point, dtype=np.float64)
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        ab, bc, ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
        angle = 2.0 * np.arctan2(np.linalg.det(corners), la * lb * lc + ab * lc + bc * la + ca * lb)
        return np.asarray(angle)


def load_mesh(shape: Mesh, field: str) -> TriangleMesh:
    """Read a mesh file (anything that trimesh reads), scaled, its parts merged into one.

    `field` is where the scene speaks of it, for the error. Raises InputError when the file is missing, unreadable or of
    an unknown format, holds no triangles or numbers that are not finite, or is flat.
    """
    where = f"{field}: mesh {shape.file}"
    if not shape.file.is_file():
        raise InputError(f"{where}: no such file")
    if shape.file.suffix.lower().lstrip(".") not in trimesh.available_formats():
        raise InputError(f"{where}: format '{shape.file.suffix}' is not known (stl, obj, ply, off, dae, glb are)")
    try:
        with _reading, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about colours and the like
            loaded = trimesh.load_mesh(str(shape.file), process=False)
            vertices, triangles = np.array(loaded.vertices, dtype=np.float64), np.array(loaded.faces)
    except ImportError:  # it guesses at the encoding of what is no text
        raise InputError(f"{where}: cannot be read, it is not what its ending says") from None
    except Exception as error:  # each format's reader has its own failures; none is the user's language
        raise InputError(f"{where}: cannot be read ({type(error).__name__}: {error})") from error
    if len(triangles) == 0:
        raise InputError(f"{where}: is empty, it holds no triangles")
    if not np.isfinite(vertices[triangles]).all():
        raise InputError(f"{where}: holds coordinates that are not finite (NaN or infinite)")
    if np.abs(vertices * np.array(shape.scale)).max() > LARGEST:
        raise InputError(f"{where}: reaches farther than {LARGEST:g} m (its scale is {shape.scale[0]:g})")
    mesh = TriangleMesh.merged(vertices * np.array(shape.scale), triangles).trimmed()
    if len(mesh.triangles) == 0 or thinness(mesh.vertices) <= FLAT:
        raise InputError(f"{where}: is flat; a body with some thickness is needed")
    return mesh


def thinness(points: Array) -> float:
    """Return the smallest over the largest principal extent of `points` (m, 3)."""
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(extents[-1] / extents[0]) if len(extents) == 3 else 0.0
