"""A few tight outer bodies for each link of a robot, which the planner uses instead of the link's mesh.

Robot -> `LinkBody`s whose union contains the link's collision geometry, in the joint's frame, [m]. They are fitted
(`link_fit`) once and cached on disk by the content of the link's geometry; those of well-known robots come with the
package.

The setting `link_bodies` chooses the bodies: "fitted" takes the cheapest that fit well. The others are for comparison:
one capsule, one box, polytopes of a fixed number of vertices in all, or the link's convex hull itself.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import coal
import numpy as np
import pinocchio as pin
from threadpoolctl import threadpool_limits

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.compiled.cache import content_key, finite, load, store
from hdplan.planner.collision.convex_bodies import convex_bodies
from hdplan.planner.collision.hull_distance import distance_to_hull
from hdplan.planner.collision.link_fit import box_axes, fitted, hull_points
from hdplan.planner.collision.shipped_bodies import shipped_bodies
from hdplan.planner.collision.sphere_swept_fit import MARGIN, Swept
from hdplan.planner.collision.standing_out import outside
from hdplan.planner.geometry.coal_shapes import corners_of
from hdplan.planner.geometry.division import halved
from hdplan.planner.geometry.shape_table import operations, shape_of
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.lazy_imports import LazyModule, scipy
from hdplan.scenes.once import ForkSafeLock, read_only
from hdplan.scenes.progress import tell

if TYPE_CHECKING:
    import trimesh
else:
    trimesh = LazyModule("trimesh")

FIT_VERSION = "8"  # to be changed with anything that changes a fit, so that old cache entries are not used
FIXED = {"capsule": (1, 2), "outer-4": (1, 4), "outer-12": (3, 4)}  # the one candidate of each of these settings
MOST_HALVINGS = 60  # of a triangle, at most, until each part lies in one body

_fitting = ForkSafeLock()  # the number of BLAS threads is set for the whole process


@dataclass(frozen=True, eq=False)
class LinkBody:
    """One outer body of a link."""

    link: str
    joint: int  # of robot.model; 0 is the world
    body: ConvexBody  # in that joint's frame

    @cached_property
    def ball(self) -> tuple[Array, float]:
        """The centre (3,) and radius of a ball around it [m]."""
        vertices = self.body.vertices
        middle: Array = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        return read_only(middle), np.linalg.norm(vertices - middle, axis=1).max() + self.body.radius


@dataclass(frozen=True)
class FitRow:
    """The fit of a link's bodies."""

    link: str
    bodies: int
    vertices: int  # of all bodies together
    volume_ratio: float  # of the bodies (each counted in full) over that of the link's convex hull
    mean_outside: float  # of the bodies' surface, outside the link's convex hull [m]
    p95_outside: float  # 95th percentile of the same [m]
    contained: bool  # every corner of the cut geometry lies in its body


def link_bodies(robot: Robot, geometry: str = "fitted") -> tuple[LinkBody, ...]:
    """Return the outer bodies of all links, from base to tip; shipped with the
    package, from the cache, or fitted now (some tenths of a second each).

    geometry: "fitted", "capsule", "outer-4", "outer-12", "box" (the oriented bounding box) or "hull" (all its corners).
    """
    links, around = [], []
    for link in robot.links:
        for swept in enclosed(robot, link, geometry):
            links.append(link)
            around.append(Swept(in_joint(robot, link, swept.vertices), swept.radius))
    return tuple(
        LinkBody(link, robot.link_joint[link], body) for link, body in zip(links, convex_bodies(around), strict=True)
    )


def fit_report(robot: Robot) -> tuple[FitRow, ...]:
    """Return one row per link: how many fitted bodies, how tight, and whether they contain the link's geometry."""
    rows = []
    for link in robot.links:
        bodies = enclosed(robot, link, "fitted")
        triangles = link_triangles(robot, link)
        points = hull_points(triangles.reshape(-1, 3))
        mean, p95 = outside(bodies, points, samples=2000)
        volume = sum(_volume(body) for body in bodies) / scipy.spatial.ConvexHull(points).volume
        vertices = sum(len(body.vertices) for body in bodies)
        rows.append(FitRow(link, len(bodies), vertices, volume, mean, p95, contains(bodies, triangles)))
    return tuple(rows)


def contains(bodies: tuple[Swept, ...], triangles: Array) -> bool:
    """True if the union of bodies contains all triangles (T, 3, 3): each, or each of its parts, lies in one body.

    A triangle lies in a convex body if its corners do; one that lies in none is halved across its longest side, up to
    HALVINGS times. True is a proof (to rounding); False may also mean that these were not enough.
    """
    for _ in range(MOST_HALVINGS):
        inside = np.array(
            [
                (distance_to_hull(triangles.reshape(-1, 3), body.vertices)[0] <= body.radius).reshape(-1, 3)
                for body in bodies
            ]
        )  # (bodies, T, 3)
        if not inside.any(0).all():
            return False  # a corner sticks out
        triangles = triangles[~inside.all(2).any(0)]
        if len(triangles) == 0:
            return True
        triangles = halved(triangles)
    return False


# --- fitting ----------------------------------------------------------------------------------------------------------


def enclosed(robot: Robot, link: str, geometry: str = "fitted") -> tuple[Swept, ...]:
    """Return the bodies of a link in the link's own frame (which no locked joint moves): shipped, from the cache, or
    fitted now."""
    content = link_key(robot, link)
    shipped = shipped_bodies(content) if geometry == "fitted" else None
    if shipped is not None:
        return shipped
    key = content_key(FIT_VERSION, geometry, content)
    with _fitting:  # whoever waited finds what the other has stored
        known = load("link_bodies", key, _kept)
        if known is not None:
            return known
        tell(f"fitting bodies to {link}, link {robot.links.index(link) + 1} of {len(robot.links)} of {robot.name}")
        with threadpool_limits(1):  # thousands of tiny products: with threads that wait for each other, 5 s become 20
            bodies = _around(link_triangles(robot, link), geometry)
        store("link_bodies", key, [[body.vertices.tolist(), body.radius] for body in bodies])
        return bodies


def _kept(value: Any) -> tuple[Swept, ...] | None:
    """Return the bodies of an entry, at least one."""
    return tuple(Swept(finite(each).reshape(-1, 3), float(finite(radius))) for each, radius in value) or None


def link_key(robot: Robot, link: str) -> str:
    """Return a name for the content of a link's geometry: that of no other link enters."""
    return content_key(*(part for item in _items(robot, link) for part in _content(robot, link, item)))


def _around(triangles: Array, geometry: str) -> tuple[Swept, ...]:
    """Return bodies of the chosen kind around triangles (T, 3, 3)."""
    points = hull_points(triangles.reshape(-1, 3))
    match geometry:
        case "hull":
            return (Swept(points, MARGIN),)
        case "box":
            axes = box_axes(points)
            heights = points @ axes.T
            corners = itertools.product(*np.stack([heights.min(axis=0), heights.max(axis=0)], axis=1).tolist())
            return (Swept(np.array(list(corners)) @ axes, MARGIN),)
        case "fitted":
            return fitted(triangles)
        case _:
            return fitted(triangles, (FIXED[geometry],))


def _volume(body: Swept) -> float:
    """Return a swept body's volume [m^3], from a fine polyhedron in it."""
    ball = trimesh.creation.icosphere(subdivisions=3).vertices
    return float(scipy.spatial.ConvexHull((body.vertices[:, None] + body.radius * ball).reshape(-1, 3)).volume)


# --- geometry ---------------------------------------------------------------------------------------------------------


def _items(robot: Robot, link: str) -> list[pin.GeometryObject]:
    return [robot.collision.geometryObjects[index] for index in robot.link_geometry[link]]


def _link_frame(robot: Robot, link: str) -> pin.SE3:
    """Return the link's frame in its joint's frame."""
    return robot.model.frames[_items(robot, link)[0].parentFrame].placement


def in_joint(robot: Robot, link: str, points: Array) -> Array:
    """Return points (m, 3) of a link's frame in the frame of the joint that carries it [m]."""
    return _moved(points, _link_frame(robot, link))


def _moved(points: Array, placement: pin.SE3) -> Array:
    return np.asarray(points @ placement.rotation.T + placement.translation)


def _content(robot: Robot, link: str, item: pin.GeometryObject) -> tuple[str | bytes, ...]:
    """Return the data that determine one geometry in the link's frame, for the cache's key."""
    place = _link_frame(robot, link).inverse() * item.placement
    rounded = np.round(np.hstack([place.rotation.ravel(), place.translation]), 9) + 0.0
    return type(item.geometry).__name__, rounded.tobytes(), (np.round(_outline(item), 9) + 0.0).tobytes()


def link_triangles(robot: Robot, link: str) -> Array:
    """Return triangles (T, 3, 3) in the link's frame whose pieces' hulls contain the link's collision geometry."""
    inverse = _link_frame(robot, link).inverse()
    return np.concatenate([_moved(_triangles(item), inverse * item.placement) for item in _items(robot, link)])


def _triangles(item: pin.GeometryObject) -> Array:
    """Return triangles (T, 3, 3) of a geometry in its own frame: a mesh's, or those of a polyhedron around it."""
    outline = _outline(item)
    if outline.ndim == 3:
        return outline
    try:
        return np.asarray(outline[scipy.spatial.ConvexHull(outline).simplices])
    except scipy.spatial.QhullError:
        raise InputError("robot: a collision geometry is flat") from None


def _outline(item: pin.GeometryObject) -> Array:
    """Return the triangles (T, 3, 3) of a mesh, or the corners (m, 3) of a polyhedron around any other geometry."""
    shape: Any = item.geometry
    if isinstance(shape, coal.BVHModelBase):
        return np.asarray(np.asarray(shape.vertices())[corners_of(shape)])
    if isinstance(shape, coal.ConvexBase):
        return np.array(shape.points())
    known = shape_of(shape)
    outline = None if known is None else operations(known).outline
    if outline is not None:
        return outline.around(known)
    raise InputError(f"robot: collision geometry '{item.name}' is a {type(shape).__name__}, which hdplan does not know")
