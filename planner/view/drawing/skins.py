"""Skins of robots and obstacles: coloured triangles in the frames of the joints that carry them.

Robot -> `Skin`s of three kinds: the visual meshes of its URDF, the collision geometry that the certificate works with,
and the outer bodies of the planner. Files are read once in a process. Lengths in [m].

Pinocchio's own viser visualizer is not used: it reads every mesh again for every robot shown, and always gives a .dae
mesh the colours of its file, so that ghosts and robots of other colours are impossible.
"""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hdplan.distance.bodies import ConvexBody
from hdplan.planner.geometry.coal_shapes import corners_of, sides_of
from hdplan.planner.geometry.mesh_files import mesh_stamps
from hdplan.planner.geometry.meshes import LARGEST_COORDINATE, TriangleMesh
from hdplan.planner.geometry.seen import seen_mesh, seen_parts
from hdplan.planner.geometry.shape_table import operations, shape_of
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.visuals import read_visuals
from hdplan.planner.view.drawing.creases import creased
from hdplan.planner.view.drawing.mesh_parts import Color, Part, mesh_parts, rgb
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, listed, naming
from hdplan.scenes.files import Stamps, stamps_of
from hdplan.scenes.lazy_imports import trimesh
from hdplan.scenes.obstacles import Obstacle, Seen
from hdplan.scenes.once import ReadOnly
from hdplan.scenes.poses import Vector3
from hdplan.scenes.robot_files.library import source_of
from hdplan.scenes.robot_files.packages import Packages
from hdplan.scenes.robot_files.source import Source
from hdplan.scenes.robot_spec import RobotSpec

PLAIN: Color = (190, 190, 190)  # of what has no colour of its own
PALE: Color = (230, 230, 230)  # of visuals without a colour
HELD: Color = (230, 159, 0)  # orange, of held objects
ENDLESS = 3.0  # [m] length to which an unbounded box is drawn
IN_PLACE = pin.SE3.Identity()
# [m] by which robots that are seen through are smaller, and twice and three times it: what stands, and links that turn
# about their own axes, are in one place in all of them, and would flicker
INSET = 0.0015
COARSE = 2  # subdivisions of the balls that stand for a sweeping sphere


Triangles = tuple[Array, NDArray[np.uint32]]


@dataclass(frozen=True, eq=False)
class Skin(ReadOnly):
    """Triangles of one colour."""

    link: str
    joint: int  # of robot.model that carries it; 0 is the world
    vertices: NDArray[np.float32]  # (m, 3) in the joint's frame
    triangles: NDArray[np.uint32]  # (F, 3)
    color: Color


def visual_skins(robot: Robot, spec: RobotSpec) -> tuple[tuple[Skin, ...], tuple[str, ...]]:
    """Return the robot's appearance, one skin per link and colour, with the objects that it holds; none if its URDF
    holds no visuals. And words for the meshes that are left out, as they are missing or cannot be read: a link of which
    nothing is left is drawn by its collision geometry.

    Raises InputError for a URDF that is not valid.
    """
    source = source_of(spec)
    visuals, packages = read_visuals(source), Packages(source.urdf, source.package_dirs)
    files = []
    for visual in visuals:
        with contextlib.suppress(InputError):  # reported when it is drawn
            files += [visual.mesh.found(packages)[0]] if visual.mesh else []
    read = [file for file, *_ in robot.files]
    own, failed = _visual_skins(robot, source, stamps_of(read) + mesh_stamps(dict.fromkeys(files)))
    bare = {link for link, _ in failed} - {skin.link for skin in own}
    held = {attached.name for attached in robot.attached}
    drawn = own
    if own and bare:  # without any, the whole robot is shown in its collision geometry
        drawn = (*drawn, *(skin for skin in collision_skins(robot) if skin.link in bare))
    if own and held:
        drawn = (*drawn, *(skin for skin in collision_skins(robot, HELD) if skin.link in held))
    words = [reason for _, reason in failed]
    if instead := [link for link in robot.links if own and link in bare]:
        words.append(f"drawn by their collision geometry: {listed(instead)}")
    return drawn, tuple(words)


@functools.lru_cache(maxsize=8)
def _visual_skins(robot: Robot, source: Source, stamps: Stamps) -> tuple[tuple[Skin, ...], tuple[tuple[str, str], ...]]:
    """Make them once, as long as the files, by `stamps`, stay as they are; and what is wrong with others, with their
    links."""
    parts: dict[tuple[str, Color], list[Triangles]] = {}
    failed: list[tuple[str, str]] = []
    packages = Packages(source.urdf, source.package_dirs)
    for visual in read_visuals(source):
        if visual.failed:
            failed.append((visual.link, visual.failed))
            continue
        try:
            found = _parts(visual.link, *visual.mesh.found(packages)) if visual.mesh else _primitive(visual.solid)
        except InputError as error:
            failed.append((visual.link, str(error)))
            continue
        for part in found:
            color = rgb(visual.color) if visual.color else part.color or PALE
            parts.setdefault((visual.link, color), []).append(
                (_placed(part.vertices, visual.placement), part.triangles)
            )
    skins = []
    for (link, color), meshes in parts.items():
        frame = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)]
        vertices, triangles = _joined(meshes)
        placed = _placed(vertices, frame.placement).astype(np.float32)
        skins.append(Skin(link, int(frame.parentJoint), placed, triangles, color))
    return tuple(skins), tuple(failed)


def shown_skins(robot: Robot, spec: RobotSpec) -> tuple[tuple[Skin, ...], str]:
    """Return the skins in which the robot is shown, and a note where they are not all its visual meshes."""
    try:
        skins, left_out = visual_skins(robot, spec)
    except InputError as error:
        skins, left_out = (), (str(error),)
    if skins:
        return skins, f"left out of the picture: {'; '.join(left_out)}" if left_out else ""
    why = "; ".join(left_out) or "its URDF has no visual meshes"
    return collision_skins(robot), f"{robot.name} is shown in its collision meshes: {why}"


@functools.lru_cache(maxsize=8)
def collision_skins(robot: Robot, color: Color = PLAIN) -> tuple[Skin, ...]:
    """Return the links' collision geometry, as the certificate sees it."""
    return tuple(
        _skin(link, int(item.parentJoint), _solid(item.geometry), color, item.placement)
        for link, own in robot.link_geometry.items()
        for item in (robot.collision.geometryObjects[index] for index in own)
    )


@functools.lru_cache(maxsize=8)
def outer_skins(robot: Robot, geometry: str) -> tuple[Skin, ...]:
    """Return the links' outer bodies, as the planner sees them with the setting `link_bodies` at `geometry`."""
    from hdplan.planner.collision.link_bodies import link_bodies  # with the planner's bodies

    return tuple(_skin(body.link, body.joint, _swept(body.body), PLAIN) for body in link_bodies(robot, geometry))


def obstacle_mesh(obstacle: Obstacle) -> TriangleMesh:
    """Return the true shape of an obstacle whose file was read, in its own frame; a cloud's as boxes around its
    points."""
    if isinstance(obstacle.shape, Seen):
        return TriangleMesh(*seen_mesh(obstacle.shape))
    return operations(obstacle.shape).triangles(obstacle.shape)


def obstacle_parts(obstacle: Obstacle) -> Array:
    """Return boxes around an obstacle, or around the parts of a cloud: their lower and upper corners (b, 2, 3) in its
    own frame."""
    if isinstance(obstacle.shape, Seen):
        return seen_parts(obstacle.shape)
    vertices = obstacle_mesh(obstacle).vertices
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])[None]


def smaller(vertices: NDArray[Any], inset: float) -> NDArray[Any]:
    """Return vertices (v, 3) drawn together by `inset` [m] on each side, but never by more than half of the width."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    half = 0.5 * (high - low)
    return np.asarray(vertices - np.minimum(inset, 0.5 * half) * (vertices - low - half) / np.maximum(half, 1e-9))


def _joined(meshes: Sequence[Triangles]) -> Triangles:
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    triangles = [corners + np.uint32(begin) for (_, corners), begin in zip(meshes, first.tolist(), strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(triangles)


def _placed(vertices: NDArray[Any], place: pin.SE3) -> Array:
    moved: Array = vertices @ place.rotation.T + place.translation
    return moved


def _skin(link: str, joint: int, mesh: TriangleMesh, color: Color, place: pin.SE3 = IN_PLACE) -> Skin:
    return Skin(link, joint, *creased(_placed(mesh.vertices, place), mesh.triangles), color)


def _primitive(shape: Any) -> Sequence[Part]:
    solid = _solid(shape)
    return (Part.of(solid.vertices, solid.triangles),)


def _parts(link: str, file: Path, scale: Vector3) -> Sequence[Part]:
    with naming(f"link '{link}': mesh {file}"):
        if not all(math.isfinite(factor) and 0.0 < abs(factor) <= LARGEST_COORDINATE for factor in scale):
            raise InputError(f"scale must be three numbers other than 0, found {scale}")
        parts = mesh_parts(file, mesh_stamps([file]))
    turned = slice(None, None, -1 if math.prod(scale) < 0 else 1)  # a mirrored triangle runs the other way round
    return [
        Part(part.vertices * np.array(scale, dtype=np.float32), part.triangles[:, turned], part.color) for part in parts
    ]


def _solid(shape: Any) -> TriangleMesh:
    """Return one of coal's shapes as triangles."""
    known = shape_of(shape)
    if known is not None:
        return operations(known).triangles(known)
    match shape:
        case coal.BVHModelBase():
            return TriangleMesh(shape.vertices(), corners_of(shape))
        case coal.Convex():
            return sides_of(shape)
    raise InputError(f"robot: the viewer does not support the geometry {type(shape).__name__}")


def _swept(body: ConvexBody) -> TriangleMesh:
    """Return a polytope swept by a sphere: the hull of small balls at its vertices."""
    ball = trimesh.creation.icosphere(subdivisions=COARSE, radius=body.radius)
    return TriangleMesh.hull((np.asarray(body.vertices)[:, None] + ball.vertices).reshape(-1, 3))
