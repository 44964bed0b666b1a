"""All operations on a scene's shapes in one table: description, support, coal's geometry, inertia, triangles.

A new shape is its class in the scene's model, a row here, and its own support in the certificate (`exact_proximity`),
which takes nothing from this table: two separate supports make the proof independent. How a scene file writes a shape
follows from its class.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import coal
import numpy as np
import pinocchio as pin

from hdplan.planner.geometry.coal_shapes import convex_hull, hull_triangles, triangle_tree
from hdplan.planner.geometry.drawn_shapes import drawn_box, drawn_capsule, drawn_cylinder
from hdplan.planner.geometry.meshes import FLAT_RATIO, ReadMesh, TriangleMesh, thinness
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.lazy_imports import LazyModule
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Points, Shape, Sphere, own_fields

if TYPE_CHECKING:
    import trimesh
else:
    trimesh = LazyModule("trimesh")

ROUND_SIDES = 16  # of the prism around a cylinder


@dataclass(frozen=True, eq=False)
class Swept(ReadOnly):
    """A convex body: the hull of vertices (m, 3), swept by a disc normal to z, an ellipsoid along the axes and a ball
    [m]."""

    vertices: Array
    disc: float = 0.0
    radii: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ball: float = 0.0


@dataclass(frozen=True)
class Outline:
    """Formulas of a convex shape in its own frame, about whose origin it is symmetric."""

    half_size: Callable[[Any], Array]  # (3,) of the box around it [m]
    support: Callable[[Any, Array], Array]  # h(n) = max_{x in it} n·x [m], exact, for unit directions (k, 3) -> (k,)
    around: Callable[[Any], Array]  # (m, 3) corners of a polyhedron that contains it [m]
    round_about: Literal["nothing", "axis", "centre"]  # decides which directions enclose it tightly
    swept: Callable[[Any], Swept]  # the same body, exactly
    linear: bool = False  # whether support and half size are in its sizes, and the directions that enclose it the same


@dataclass(frozen=True)
class Operations:
    """The operations on one kind of shape. `field` names it to the user: "attached.cup"."""

    fields: str  # of the shape that they know, all it has
    words: Callable[[Any], str]
    coal: Callable[[Any, str], Any]  # the geometry that links have
    inertia: Callable[[Any, float, str], pin.Inertia]  # for a uniform density and a mass [kg]
    triangles: Callable[[Any], TriangleMesh]  # for drawing
    outline: Outline | None = None  # hulls of points and meshes have no formulas
    from_coal: tuple[Any, Callable[[Any], Shape]] | None = None  # coal's class, and its geometry as a shape
    sizes: str = ""  # those of its fields that may be scaled at random [m]


def operations(shape: Shape) -> Operations:
    """Return the row of a shape's kind; a mesh has one once it was read (`geometry.opened`). Raises TypeError for a
    kind without one, or with fields that it does not know."""
    row, known = TABLE.get(type(shape)), own_fields(shape)
    if row is None or row.fields != " ".join(known):
        raise TypeError(f"unknown shape {type(shape).__name__} with {', '.join(known)}")
    return row


def shape_of(geometry: Any) -> Shape | None:
    """Return coal's geometry of a link as a scene's shape; None for hulls and triangles."""
    for row in TABLE.values():
        if row.from_coal is not None and isinstance(geometry, row.from_coal[0]):
            return row.from_coal[1](geometry)
    return None


def _points_coal(shape: Points, field: str) -> Any:
    corners = np.array(shape.points)
    if thinness(corners) <= FLAT_RATIO:
        raise InputError(f"{field}.shape.points: are flat; a body with some thickness is needed")
    return convex_hull(corners) or triangle_tree(TriangleMesh.hull(corners))


def _mesh_inertia(shape: ReadMesh, mass: float, field: str) -> pin.Inertia:
    if not shape.mesh.closed:
        raise InputError(
            f"{field}.mass: mesh {shape.file} is not closed, so its mass has no volume to be spread over; give it as "
            "payload, with its com and inertia"
        )
    return _even(trimesh.Trimesh(shape.mesh.vertices, shape.mesh.triangles, process=False), mass)


def _even(mesh: trimesh.Trimesh, mass: float) -> pin.Inertia:
    """Return the inertia of a closed mesh of uniform density, about its centre of mass."""
    if mesh.volume < 0:  # its triangles are oriented inwards
        mesh = mesh.copy()
        mesh.invert()
    mesh.density = mass / mesh.volume
    return pin.Inertia(mass, np.asarray(mesh.center_mass), np.asarray(mesh.moment_inertia))


def _ellipsoid_triangles(radii: tuple[float, float, float]) -> TriangleMesh:
    ball = drawn_capsule(1.0, 0.0)
    return TriangleMesh(ball.vertices * radii, ball.triangles)


def _box_corners(half: Array) -> Array:
    """Return the corners (8, 3) of a box."""
    corners: Array = np.array(list(itertools.product((-1, 1), repeat=3))) * half
    return corners


def _ends(length: float) -> Array:
    """Return the ends (2, 3) of an axis along z."""
    return np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]])


def _around_cylinder(radius: float, half: float) -> Array:
    angles = 2 * np.pi * (np.arange(ROUND_SIDES) + 0.5) / ROUND_SIDES
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], 1) / np.cos(np.pi / ROUND_SIDES)
    return np.concatenate([radius * ring + [0, 0, end * half] for end in (-1, 1)])


def _around_ball(radius: float, half: float) -> Array:
    """Corners around two balls on the z axis, or one."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    outer = radius / float(np.min(np.sum(ball.triangles[:, 0] * ball.face_normals, axis=1)))
    return np.concatenate([outer * ball.vertices + [0, 0, end * half] for end in (-1, 1)])


TABLE: dict[type, Operations] = {
    Box: Operations(
        fields="size",
        words=lambda shape: f"box {' × '.join(f'{edge:g}' for edge in shape.size)} m",
        coal=lambda shape, _: coal.Box(*shape.size),
        inertia=lambda shape, mass, _: pin.Inertia.FromBox(mass, *shape.size),
        triangles=lambda shape: drawn_box(shape.size),
        outline=Outline(
            half_size=lambda shape: np.array(shape.size) / 2,
            support=lambda shape, n: np.abs(n) @ (np.array(shape.size) / 2),
            around=lambda shape: _box_corners(np.array(shape.size) / 2),
            round_about="nothing",
            swept=lambda shape: Swept(_box_corners(np.array(shape.size) / 2)),
            linear=True,
        ),
        from_coal=(coal.Box, lambda found: Box(tuple((2.0 * found.halfSide).tolist()))),
        sizes="size",
    ),
    Sphere: Operations(
        fields="radius",
        words=lambda shape: f"sphere, radius {shape.radius:g} m",
        coal=lambda shape, _: coal.Sphere(shape.radius),
        inertia=lambda shape, mass, _: pin.Inertia.FromSphere(mass, shape.radius),
        triangles=lambda shape: drawn_capsule(shape.radius, 0.0),
        outline=Outline(
            half_size=lambda shape: np.full(3, shape.radius),
            support=lambda shape, n: np.full(len(n), shape.radius),
            around=lambda shape: _around_ball(shape.radius, 0.0),
            round_about="centre",
            swept=lambda shape: Swept(np.zeros((1, 3)), ball=shape.radius),
            linear=True,
        ),
        from_coal=(coal.Sphere, lambda found: Sphere(found.radius)),
        sizes="radius",
    ),
    Ellipsoid: Operations(
        fields="radii",
        words=lambda shape: f"ellipsoid, radii {', '.join(f'{radius:g}' for radius in shape.radii)} m",
        coal=lambda shape, _: coal.Ellipsoid(*shape.radii),
        inertia=lambda shape, mass, _: pin.Inertia.FromEllipsoid(mass, *shape.radii),
        triangles=lambda shape: _ellipsoid_triangles(shape.radii),
        outline=Outline(
            half_size=lambda shape: np.array(shape.radii),
            support=lambda shape, n: np.linalg.norm(n * shape.radii, axis=1),
            around=lambda shape: _around_ball(1.0, 0.0) * shape.radii,
            round_about="centre",
            swept=lambda shape: Swept(np.zeros((1, 3)), radii=shape.radii),
        ),
        from_coal=(coal.Ellipsoid, lambda found: Ellipsoid(tuple(np.asarray(found.radii).tolist()))),
        sizes="radii",
    ),
    Cylinder: Operations(
        fields="radius length",
        words=lambda shape: f"cylinder, radius {shape.radius:g} m, length {shape.length:g} m",
        coal=lambda shape, _: coal.Cylinder(shape.radius, shape.length),
        inertia=lambda shape, mass, _: pin.Inertia.FromCylinder(mass, shape.radius, shape.length),
        triangles=lambda shape: drawn_cylinder(shape.radius, shape.length),
        outline=Outline(
            half_size=lambda shape: np.array([shape.radius, shape.radius, shape.length / 2]),
            support=lambda shape, n: shape.radius * np.hypot(n[:, 0], n[:, 1]) + shape.length / 2 * np.abs(n[:, 2]),
            around=lambda shape: _around_cylinder(shape.radius, shape.length / 2),
            round_about="axis",
            swept=lambda shape: Swept(_ends(shape.length), disc=shape.radius),
            linear=True,
        ),
        from_coal=(coal.Cylinder, lambda found: Cylinder(found.radius, 2.0 * found.halfLength)),
        sizes="radius length",
    ),
    Capsule: Operations(
        fields="radius length",
        words=lambda shape: f"capsule, radius {shape.radius:g} m, length {shape.length:g} m",
        coal=lambda shape, _: coal.Capsule(shape.radius, shape.length),
        inertia=lambda shape, mass, _: pin.Inertia.FromCapsule(mass, shape.radius, shape.length),
        triangles=lambda shape: drawn_capsule(shape.radius, shape.length),
        outline=Outline(
            half_size=lambda shape: np.array([shape.radius, shape.radius, shape.length / 2 + shape.radius]),
            support=lambda shape, n: shape.radius + shape.length / 2 * np.abs(n[:, 2]),
            around=lambda shape: _around_ball(shape.radius, shape.length / 2),
            round_about="axis",
            swept=lambda shape: Swept(_ends(shape.length), ball=shape.radius),
            linear=True,
        ),
        from_coal=(coal.Capsule, lambda found: Capsule(found.radius, 2.0 * found.halfLength)),
        sizes="radius length",
    ),
    Points: Operations(
        fields="points",
        words=lambda shape: f"hull of {len(shape.points)} points",
        coal=_points_coal,
        inertia=lambda shape, mass, _: _even(trimesh.convex.convex_hull(shape.points), mass),
        triangles=lambda shape: hull_triangles(np.array(shape.points)),
    ),
    ReadMesh: Operations(
        fields="file scale mesh",
        words=lambda shape: f"mesh {shape.file.name}",
        coal=lambda shape, _: triangle_tree(shape.mesh),
        inertia=_mesh_inertia,
        triangles=lambda shape: shape.mesh,
    ),
}
