"""Convex bodies: from points or named shapes to what the distance needs (vertices, face normals, edge directions).

A body is a convex polytope swept by a sphere: the set of points within ``radius`` of the convex hull of ``vertices``.
A sphere is one vertex, a capsule two. Everything is in the body's own frame, lengths in [m].
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.errors import InputError, nearest
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.once import read_only
from hdplan.scenes.values import Whole, checked, instance

if TYPE_CHECKING:
    from hdplan.distance.unions import BodyUnion

NONE = read_only(np.empty((0, 3)))
FLAT_RATIO = (
    1e-9  # an extent below this part of the body's size is zero: the body is a point, a segment or a flat polygon
)
SAME_DIRECTION = 1e-6  # [rad] directions closer than this, up to sign, are merged
SAME_PLANE = 1e-6  # of the body's size: triangles this close to one plane are one face, as in float32 meshes

UNIT = 1e-6  # by which the length of a direction may differ from 1
MOST_SIDES = 1000
LARGEST_LENGTH = 1e100  # [m] beyond, squares and cubes of lengths overflow

GOLDEN = (1.0 + np.sqrt(5.0)) / 2.0


@dataclass(frozen=True, eq=False, repr=False)
class ConvexBody:
    """A convex polytope swept by a sphere: V, F and E of the paper's Definition III.1, and a radius.

    A full polytope has all three sets. A flat polygon has its normal on both sides as faces; a segment has one edge
    direction and no face; a point has neither. Build bodies by the constructors below, which keep the sets consistent.
    """

    vertices: Array  # (m, 3) [m] the extreme points, m >= 1; those of a flat polygon in their order around it
    faces: Array  # (F, 3) unit outward normals, one per face (coplanar triangles are one face)
    edges: Array  # (E, 3) unit edge directions, equal up to sign counted once
    edge_counts: Array  # (E,) how many edges run along each of them
    radius: float = 0.0  # [m] of the sphere that sweeps the polytope, >= 0

    def __repr__(self) -> str:
        """Return its size, for display."""
        swept = f", swept by a sphere of {self.radius:g} m" if self.radius else ""
        count = len(self.vertices)
        return f"<ConvexBody: {count} {'vertex' if count == 1 else 'vertices'}{swept}>"

    def __post_init__(self) -> None:
        """Check and freeze the arrays. Raises InputError for invalid ones."""
        for name in ("vertices", "faces", "edges"):
            array = _rows(name, getattr(self, name))
            if name != "vertices" and not np.allclose(np.linalg.norm(array, axis=1), 1.0, rtol=0.0, atol=UNIT):
                raise InputError(f"{name}: allowed are directions of length 1")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if not len(self.vertices):
            raise InputError("vertices: found none, at least one is needed")
        counts = _numbers("edge_counts", self.edge_counts)
        if counts.shape != (len(self.edges),) or (counts <= 0.0).any():
            raise InputError(f"edge_counts: found {counts.tolist()}, allowed is one above 0 for each of the edges")
        counts.setflags(write=False)
        object.__setattr__(self, "edge_counts", counts)
        object.__setattr__(self, "radius", _length("radius", self.radius, zero=True))

    @classmethod
    def box(cls, size: ArrayLike) -> ConvexBody:
        """Return the box of full side lengths ``size`` (3,) [m], centred, along the axes."""
        sides = _numbers("box size", size)
        if sides.shape != (3,) or np.any(sides <= 0):
            raise InputError(f"box size: found {sides.tolist()}, allowed are three positive lengths")
        corners = np.array(list(product((-0.5, 0.5), repeat=3))) * sides
        return cls(corners, np.vstack([np.eye(3), -np.eye(3)]), np.eye(3), np.full(3, 4.0))

    @classmethod
    def sphere(cls, radius: float) -> ConvexBody:
        """Return the sphere of ``radius`` [m] around the origin."""
        return cls(np.zeros((1, 3)), NONE, NONE, np.empty(0), _length("sphere radius", radius))

    @classmethod
    def capsule(cls, radius: float, length: float) -> ConvexBody:
        """Return the capsule of ``radius`` [m] along z, ``length`` [m] between the centres of its end spheres."""
        half = 0.5 * _length("capsule length", length)
        ends = np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])
        return cls(ends, NONE, np.array([[0.0, 0.0, 1.0]]), np.ones(1), _length("capsule radius", radius))

    @classmethod
    def cylinder(cls, radius: float, length: float, sides: int = 16) -> ConvexBody:
        """Return the regular prism around the cylinder of ``radius`` and ``length`` [m] along z, which it contains.

        The prism is wider than the cylinder by ``radius (1/cos(pi/sides) - 1)`` at its edges: 2 % for 16 sides.
        """
        sides = checked(Whole(3, MOST_SIDES), sides, "cylinder sides")
        half = 0.5 * _length("cylinder length", length)
        angles = 2.0 * np.pi * np.arange(sides) / sides
        ring = (
            _length("cylinder radius", radius) / np.cos(np.pi / sides) * np.stack([np.cos(angles), np.sin(angles)], 1)
        )
        return cls.from_points([[x, y, z] for z in (-half, half) for x, y in ring])

    @classmethod
    def platonic(cls, name: str, circumradius: float = 1.0) -> ConvexBody:
        """Return the Platonic solid ``name``, its vertices ``circumradius`` [m] from the origin."""
        if not isinstance(name, str) or name not in PLATONIC:
            raise InputError(f"platonic solid: unknown name '{name}'{nearest(str(name), PLATONIC)}")
        points = np.array(PLATONIC[name])
        return cls.from_points(points * (_length("circumradius", circumradius) / np.linalg.norm(points[0])))

    @classmethod
    def from_points(cls, points: ArrayLike, radius: float = 0.0) -> ConvexBody:
        """Return the convex hull of ``points`` (n, 3) [m], swept by ``radius`` [m].

        One point, collinear and coplanar points are allowed: they give a point, a segment and a flat polygon.

        Raises InputError for no points, another shape than (n, 3) and numbers that are not finite.
        """
        cloud = _rows("points", points)
        if not len(cloud):
            raise InputError("points: found none, at least one is needed")
        return cls(*_hull(cloud), radius)

    @classmethod
    def union(cls, pieces: Iterable[ConvexBody | BodyUnion]) -> BodyUnion:
        """Return the union of convex bodies, all in one frame: a body that is not convex, for the same distances.

        Its HD-SDF is the Hölder minimum of the pieces', as smooth and as safe in sign: see ``unions``.

        Raises InputError for no pieces and for pieces that are not bodies.
        """
        from hdplan.distance.unions import union_of

        return union_of(pieces)

    def inflated(self, clearance: float) -> ConvexBody:
        """Return this body grown by ``clearance`` >= 0 [m] in all directions, that is with a larger radius."""
        return replace(self, radius=self.radius + _length("clearance", clearance, zero=True))

    @property
    def centre(self) -> Array:
        """The mean of the vertices (3,) [m], a point of the body."""
        return np.asarray(self.vertices.mean(axis=0))

    @property
    def reach(self) -> float:
        """The largest distance from the centre to a point of the body [m]."""
        return float(np.linalg.norm(self.vertices - self.centre, axis=1).max()) + self.radius


def check_bodies(body_a: object, body_b: object) -> None:
    """Raise InputError unless both are convex bodies; a union of some is not."""
    instance(body_a, ConvexBody, "body_a")
    instance(body_b, ConvexBody, "body_b")


def unique_directions(directions: ArrayLike) -> tuple[Array, Array]:
    """Return the distinct unit vectors among ``directions`` (n, 3), up to sign, and how often each occurs.

    Of equal ones the first is kept.
    """
    rows = np.asarray(directions, dtype=float).reshape(-1, 3)
    kept, counts, found = np.empty_like(rows), np.zeros(len(rows)), 0
    for row in rows:
        same = np.flatnonzero(np.abs(kept[:found] @ row) >= 1.0 - 0.5 * SAME_DIRECTION**2)
        if len(same):
            counts[same[0]] += 1
        else:
            kept[found], counts[found] = row, 1
            found += 1
    return kept[:found], counts[:found]


def _length(name: str, value: float, zero: bool = False) -> float:
    number = _numbers(name, value)
    if number.shape != () or number < 0 or (number == 0 and not zero):
        raise InputError(f"{name}: found {value}, allowed is a {'length >= 0' if zero else 'positive length'}")
    return float(number)


def _rows(name: str, values: ArrayLike) -> Array:
    """Return a copy as an array (n, 3); an empty one is (0, 3)."""
    rows = _numbers(name, values)
    if rows.size and (rows.ndim != 2 or rows.shape[1] != 3):
        raise InputError(f"{name}: found an array of shape {rows.shape}, allowed is (n, 3)")
    return rows.reshape(-1, 3)


def _numbers(name: str, values: ArrayLike) -> Array:
    """Return a copy as an array of finite numbers, at most LARGEST_LENGTH in size."""
    try:
        found = np.array(values)
        if found.dtype.kind not in "iuf" and found.size:
            raise TypeError(f"found {found.dtype}")
        numbers = found.astype(float)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name}: not an array of numbers ({error})") from None
    if not np.all(np.abs(numbers) <= LARGEST_LENGTH):  # nor is NaN
        raise InputError(f"{name}: found a number that is not finite (NaN or infinite), or beyond {LARGEST_LENGTH:g}")
    return numbers


def _hull(points: Array) -> tuple[Array, Array, Array, Array]:
    """Return vertices, faces, edges and edge counts of the convex hull of ``points`` (n, 3), of any dimension.

    The hull is taken in coordinates along the principal axes, each scaled to extent 1: an affine map preserves vertices
    and faces, and needles and plates become as well-conditioned as cubes.
    """
    centred = points - points[0]
    centred = centred - centred.mean(0)
    size = float(np.abs(centred).max())
    if size == 0.0:
        return points[:1], NONE, NONE, np.empty(0)
    axes = np.linalg.svd(centred / size, full_matrices=len(points) < 3)[2]  # (3, 3), rows, longest first
    along = (centred / size) @ axes.T
    extents = np.ptp(along, axis=0)
    rounding = 64 * np.finfo(float).eps * max(1.0, float(np.abs(points).max()) / size)
    dimension = int(np.sum(extents > max(FLAT_RATIO * extents.max(), rounding)))
    scaled = along[:, :dimension] / extents[:dimension]
    if dimension == 1:
        return points[[np.argmin(scaled), np.argmax(scaled)]], NONE, axes[:1], np.ones(1)
    rounding /= extents[dimension - 1]
    if dimension == 2:
        corners = points[_corners(scaled, rounding)]
        return corners, np.stack([axes[2], -axes[2]]), *unique_directions(_unit(np.roll(corners, -1, 0) - corners))
    return _polytope(points, scaled, rounding, axes / extents[:, None])


def _corners(plane: Array, rounding: float) -> NDArray[np.intp]:
    """Return the indices of the corners of the convex hull of ``plane`` (n, 2), in order around it."""
    ring = scipy.spatial.ConvexHull(plane).vertices
    before, after = plane[np.roll(ring, 1)] - plane[ring], plane[np.roll(ring, -1)] - plane[ring]
    across = _unit(after - before)
    height = np.abs(across[:, 0] * after[:, 1] - across[:, 1] * after[:, 0])
    return np.asarray(ring[height > rounding])


def _polytope(points: Array, scaled: Array, rounding: float, to_points: Array) -> tuple[Array, Array, Array, Array]:
    """Merge the triangles of the hull of ``scaled`` (n, 3) into faces; ``to_points`` (3, 3) maps normals back."""
    hull = scipy.spatial.ConvexHull(scaled)
    corners = np.sort(hull.vertices[np.sum(_planes(hull, scaled, rounding)[1], axis=0) >= 3])
    if len(corners) < len(hull.vertices):  # the others lie inside faces or edges and cause slivers
        return _polytope(points[corners], scaled[corners], rounding, to_points)
    planes, on_face = _planes(hull, scaled, max(SAME_PLANE, rounding))
    incidence = scipy.sparse.csr_matrix(on_face.astype(int))
    shared = scipy.sparse.triu(incidence @ incidence.T, k=1).tocoo()
    ridges = []
    for f, g in zip(shared.row[shared.data >= 2], shared.col[shared.data >= 2], strict=True):
        ends = points[hull.vertices[on_face[f] & on_face[g]]]  # two faces share an edge where they share two corners
        ridges.append(ends[np.argmax(np.linalg.norm(ends - ends[0], axis=1))] - ends[0])
    return points[corners], _unit(planes @ to_points), *unique_directions(_unit(np.array(ridges)))


def _planes(hull: Any, points: Array, tolerance: float) -> tuple[Array, Mask]:
    """Return the normals (F, 3) of the faces and which hull vertices lie on each (F, m).

    The largest triangle not yet in a face starts the next one, which takes in every triangle within ``tolerance`` of
    its plane: the normal of a sliver is meaningless, its position is not.
    """
    a, b, c = (points[hull.simplices[:, k]] for k in range(3))
    order = np.argsort(-np.linalg.norm(np.cross(b - a, c - a), axis=1), kind="stable")
    slot = np.searchsorted(np.sort(hull.vertices), hull.simplices)
    slot = np.argsort(hull.vertices)[slot]  # place of each triangle's corners in hull.vertices
    free = np.ones(len(order), dtype=bool)
    normals, members = [], []
    for triangle in order:
        if free[triangle]:
            plane = hull.equations[triangle]
            near = np.abs(points[hull.vertices] @ plane[:3] + plane[3]) <= tolerance
            free &= ~np.all(near[slot], axis=1)
            free[triangle] = False
            normals.append(plane[:3])
            members.append(near)
    return np.array(normals), np.array(members)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


CUBE = [*product((-1.0, 1.0), repeat=3)]


def _cyclic(first: float, second: float) -> list[tuple[float, float, float]]:
    """Return the twelve points (0, ±first, ±second) and their cyclic shifts."""
    pairs = product((-first, first), (-second, second))
    return [p for a, b in pairs for p in ((0.0, a, b), (a, b, 0.0), (b, 0.0, a))]


PLATONIC: dict[str, ArrayLike] = {
    "tetrahedron": [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)],
    "cube": CUBE,
    "octahedron": read_only(np.vstack([np.eye(3), -np.eye(3)])),
    "icosahedron": _cyclic(1.0, GOLDEN),
    "dodecahedron": CUBE + _cyclic(1.0 / GOLDEN, GOLDEN),
}
