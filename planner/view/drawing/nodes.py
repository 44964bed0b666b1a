"""The nodes in the browser's scene: robots, obstacles, paths and the closest pair, each a few nodes that are moved.

Meshes are sent once; after that only placements travel, and of all that is set viser sends only what differs.
Everything here is called by the viewer's one thread.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
import viser
from numpy.typing import NDArray

from hdplan.planner.certificate.verdict import Closest
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.clicks import Clicks
from hdplan.planner.view.drawing.colors import (
    CONTACT,
    INK,
    LEFT_OUT,
    LINKS,
    OBSTACLE,
    REGION,
    SELECTED,
    clearance_colors,
    intensities,
)
from hdplan.planner.view.drawing.creases import creased
from hdplan.planner.view.drawing.labels import Label
from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.planner.view.drawing.motion import millimetres, shortened
from hdplan.planner.view.drawing.skins import ENDLESS, Skin, obstacle_mesh, obstacle_parts, smaller
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.path_constraints import Within
from hdplan.scenes.poses import Vector3

PATH_WIDTH, SEGMENT_WIDTH = 0.006, 0.004  # [m]
TIGHT, PULSE = 0.03, 2.0  # [m] below which a segment pulses, and by how many times its width
FADED = 0.3  # opacity of an obstacle between the eye and the robot
MORE_SOLID = 0.65  # opacity of a ghost that is selected
LABEL_HEIGHT = 0.05  # [m] by which the label stands above the segment


@dataclass(frozen=True, eq=False)
class LinkNode:
    """One link of a robot, or what of it has one colour."""

    skin: Skin
    mesh: Any
    parts: Array  # lower and upper corner of the box around it, in the frame of its joint (1, 2, 3)
    data: pin.Data  # the robot's, which holds where it is
    clicks: Clicks

    @property
    def place(self) -> Array:
        """The placement of its joint (4, 4)."""
        return np.asarray(self.data.oMi[self.skin.joint].homogeneous)


class RobotNodes:
    """A robot in one configuration, drawn with one of its skins."""

    def __init__(
        self,
        server: viser.ViserServer,
        name: str,
        robot: Robot,
        skins: Sequence[Skin],
        *,
        color: Color | None = None,
        opacity: float | None = None,
        visible: bool = True,
        inset: float = 0.0,
    ) -> None:
        """Send the meshes, smaller by `inset` [m] on each side; `color` replaces the skins' own."""
        self.robot, self.data = robot, robot.model.createData()
        self.root = server.scene.add_frame(f"/{name}", show_axes=False, visible=visible)
        self.frames = {
            joint: server.scene.add_frame(f"/{name}/{joint}", show_axes=False)
            for joint in sorted({skin.joint for skin in skins})
        }
        self.links: list[LinkNode] = []
        for index, skin in enumerate(skins):
            mesh = server.scene.add_mesh_simple(
                f"/{name}/{skin.joint}/{index}",
                smaller(skin.vertices, inset),
                skin.triangles,
                color=color or skin.color,
                opacity=opacity,
                cast_shadow=False,
                receive_shadow=False,
            )
            box = np.array([[skin.vertices.min(axis=0), skin.vertices.max(axis=0)]], dtype=np.float64)
            self.links.append(LinkNode(skin, mesh, box, self.data, Clicks(mesh)))
        self.color, self.opacity = color, opacity
        self.q: Array | None = None

    def show(self, q: Array) -> None:
        """Take configuration `q` (n,)."""
        self.q = q
        pin.forwardKinematics(self.robot.model, self.data, self.robot.pin_q(q))
        for joint, frame in self.frames.items():
            place = self.data.oMi[joint]
            frame.position, frame.wxyz = place.translation, wxyz_of(place.rotation)

    def paint(self, color: Color) -> None:
        """Take another colour."""
        self.color = color
        self.mark(())

    def mark(self, links: Collection[str]) -> None:
        """Colour these links as being in contact, and all others as they were."""
        for link in self.links:
            color = CONTACT if link.skin.link in links else self.color or link.skin.color
            link.mesh.color = color

    def select(self, selected: bool) -> None:
        """Show a ghost more solid as being selected, or as it was."""
        opacity = MORE_SOLID if selected else self.opacity
        for link in self.links:
            link.mesh.opacity = opacity

    @property
    def visible(self) -> bool:
        """True if the object is shown."""
        return bool(self.root.visible)

    @visible.setter
    def visible(self, value: bool) -> None:
        self.root.visible = value

    def remove(self) -> None:
        """Take it out of the scene."""
        self.root.remove()


class ObstacleNode:
    """One obstacle in its true shape."""

    def __init__(self, server: viser.ViserServer, index: int, obstacle: Obstacle) -> None:
        """Send its mesh; nodes are numbered, as a name may hold any character."""
        self.frame = server.scene.add_frame(f"/obstacles/{index}", show_axes=False)
        self.parts = obstacle_parts(obstacle)  # (b, 2, 3)
        mesh = self._mesh(obstacle)
        vertices, triangles = creased(mesh.vertices, mesh.triangles)
        self.mesh = server.scene.add_mesh_simple(
            f"/obstacles/{index}/mesh", vertices, triangles, color=OBSTACLE, cast_shadow=False, receive_shadow=False
        )
        self.bounds = np.array([vertices.min(axis=0), vertices.max(axis=0)])  # (2, 3) in its own frame
        self._in_contact = self._selected = self._faded = False
        self.clicks = Clicks(self.mesh)
        self.take(obstacle)

    def _mesh(self, obstacle: Obstacle) -> TriangleMesh:
        """Return a mesh that can be clicked."""
        return obstacle_mesh(obstacle)

    def take(self, obstacle: Obstacle) -> None:
        """Show an obstacle of the same shape in another place."""
        self.obstacle = obstacle
        self.motion = None if obstacle.motion is None else ObstacleMotion.of(obstacle)
        x, y, z, w = obstacle.pose.quaternion_xyzw
        self.frame.position, self.frame.wxyz = obstacle.pose.position, (w, x, y, z)
        self.place = obstacle.pose.matrix  # (4, 4) where it is shown

    def show(self, seconds: float) -> None:
        """Move it to its pose at a time [s], if it moves."""
        if self.motion is not None:
            self.place = self.motion.at(np.array([seconds]))[0]
            self.frame.position, self.frame.wxyz = self.place[:3, 3], wxyz_of(self.place[:3, :3])

    def mark(self, in_contact: bool) -> None:
        """Colour it as being in contact, or as it was."""
        self._in_contact = in_contact
        self._paint()

    def select(self, selected: bool) -> None:
        """Colour it as being selected, or as it was."""
        self._selected = selected
        self._paint()

    def fade(self, faded: bool) -> None:
        """Let it be seen through, as it stands between the eye and the robot, or be solid again."""
        self._faded = faded
        self._paint()

    def listen(self, chosen: Callable[[str, bool], object]) -> None:
        """Name the listener to clicks: it gets the obstacle's name, and whether shift or ctrl was held."""
        self.clicks.listen(lambda more: chosen(self.obstacle.name, more))

    @property
    def opacity(self) -> float | None:
        """Opacity of its mesh; None if it is solid."""
        return FADED if self._faded else None

    def _paint(self) -> None:
        color = CONTACT if self._in_contact else SELECTED if self._selected else OBSTACLE
        self.mesh.color = color
        self.mesh.opacity = self.opacity


def draw_ground(scene: viser.SceneApi, middle: Vector3, dark: bool) -> None:
    """Draw the ground as a grid, for one browser or all, for a dark page or a light one."""
    cell, section = ((48, 50, 54), (68, 71, 77)) if dark else ((236, 236, 236), (215, 215, 215))
    scene.add_grid(
        "/ground", 3.0, 3.0, cell_size=0.1, section_size=0.5, cell_color=cell, section_color=section, position=middle
    )


def draw_left_out(server: viser.ViserServer, points: Array) -> Any:
    """Draw the points (m, 3) of clouds that were left out, grey; hidden at first, as they hide the robot."""
    return server.scene.add_point_cloud(
        "/left out", points.astype(np.float32), colors=LEFT_OUT, point_size=0.003, point_shape="circle", visible=False
    )


def draw_region(server: viser.ViserServer, region: Within) -> Any:
    """Draw the box in which a point of a link is to stay, seen through; along an axis without sides, ENDLESS long."""
    x, y, z, w = region.pose.quaternion_xyzw
    width, depth, height = (min(edge, ENDLESS) for edge in region.size)
    return server.scene.add_box(
        "/region",
        REGION,
        (width, depth, height),
        opacity=0.3,
        cast_shadow=False,
        receive_shadow=False,
        position=region.pose.position,
        wxyz=(w, x, y, z),
    )


class PathNode:
    """A line along which a point moves. It is changed, not sent again, as browsers compile shaders for a new one."""

    def __init__(self, server: viser.ViserServer, name: str, tip: Array, colors: NDArray[np.uint8] | Color) -> None:
        """Send it; see `draw`."""
        self._server = server
        self.node = server.scene.add_line_segments(f"/{name}", *_segments(tip, colors), thickness=PATH_WIDTH)

    def draw(self, tip: Array, colors: NDArray[np.uint8] | Color, width: float = PATH_WIDTH) -> None:
        """Draw the line through points (K, 3), coloured along it (K, 3) or in one colour, of a `width` [m]."""
        with self._server.atomic():
            self.node.points, self.node.colors = _segments(tip, colors)
            self.node.thickness = width


def _segments(tip: Array, colors: NDArray[np.uint8] | Color) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    along = np.broadcast_to(intensities(np.asarray(colors, dtype=np.uint8)), (len(tip), 3))
    points = np.stack([tip[:-1], tip[1:]], axis=1).astype(np.float32)
    return points, np.stack([along[:-1], along[1:]], axis=1)


class ClosestNodes:
    """The closest pairs as segments between the points where they are closest, with the distance written beside."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Start without anything to show."""
        self.server = server
        self.root = server.scene.add_frame("/closest", show_axes=False)
        self.lines = [
            server.scene.add_line_segments(
                f"/closest/{name}", np.zeros((1, 2, 3)), color, thickness=SEGMENT_WIDTH, visible=False
            )
            for name, color in (("obstacle", INK), ("links", LINKS))
        ]
        self.label = Label(server, "/closest/label")
        self.labelled = True
        self._tight = False

    def pulse(self, phase: float) -> None:
        """Draw the closest pair with an obstacle, where it is tight, as wide as at a phase of its pulse, 0 to 1."""
        swell = PULSE * 0.5 * (1.0 - np.cos(2 * np.pi * phase)) if self._tight else 0.0
        width = float(SEGMENT_WIDTH * (1.0 + swell))
        self.lines[0].thickness = width

    def show(self, pairs: Sequence[Closest | None]) -> None:
        """Draw the closest pair with an obstacle, and between links; the first that there is has a label."""
        self._tight = pairs[0] is not None and pairs[0].distance < TIGHT
        for line, pair in zip(self.lines, pairs, strict=True):
            line.visible = pair is not None
            if pair is not None:
                line.points = pair.points[None].astype(np.float32)
        if pairs[0] is not None:
            red, green, blue = clearance_colors(pairs[0].distance).tolist()
            self.lines[0].colors = np.array([red, green, blue], dtype=np.uint8)
        nearest = pairs[0] or pairs[1]
        self.label.visible = nearest is not None and self.labelled
        if nearest is not None:
            self.label.text = shortened(f"{nearest.link} – {nearest.other}: {millimetres(nearest.distance)}")
            self.label.place = nearest.points.mean(axis=0) + [0.0, 0.0, LABEL_HEIGHT]


def wxyz_of(rotation: Array) -> tuple[float, float, float, float]:
    """Return the quaternion of a rotation (3, 3), as viser writes it."""
    x, y, z, w = pin.Quaternion(rotation).coeffs().tolist()
    return w, x, y, z
