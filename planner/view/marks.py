"""Layers that are drawn on request: the active motion's postures as a trail, frames of the joints, obstacles' names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
import viser

from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.colors import INK, START
from hdplan.planner.view.drawing.labels import LABELS
from hdplan.planner.view.drawing.motion import ShownMotion, shortened
from hdplan.planner.view.drawing.nodes import ObstacleNode, wxyz_of
from hdplan.planner.view.drawing.skins import collision_skins
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

POSTURES = 7  # of a trail
FAINT = 0.12  # opacity of a posture
AXIS, RADIUS, LONG = 0.12, 0.004, 0.18  # [m] of a frame, and of an axis to both sides
LONGEST = 40  # characters of an obstacle's name


class Trail:
    """The robot at equal steps along a motion, seen through."""

    def __init__(self, viewer: Viewer) -> None:
        """Draw nothing yet."""
        self._viewer = viewer
        self._of: ShownMotion | None = None
        self.nodes: list[Any] = []

    def show(self, on: bool) -> None:
        """Show the trail of the active motion, if there is one, or nothing."""
        active = self._viewer.motions.active
        motion = active.motion if on and active is not None else None
        if motion is self._of:
            return
        for node in self.nodes:
            node.remove()
        self.nodes, self._of = [] if motion is None else self._drawn(motion.joints), motion

    def _drawn(self, joints: Array) -> list[Any]:
        robot, scene = self._viewer.robot, self._viewer.server.scene
        inner = np.linspace(0, len(joints) - 1, POSTURES + 2).round().astype(int)[1:-1]  # both ends are ghosts
        places: list[list[pin.SE3]] = []
        for q in robot.pin_q(joints[inner]):
            data = robot.model.createData()
            pin.forwardKinematics(robot.model, data, q)
            places.append(list(data.oMi))
        return [
            scene.add_batched_meshes_simple(
                f"/trail/{number}",
                skin.vertices,
                skin.triangles,
                np.array([wxyz_of(every[skin.joint].rotation) for every in places]),
                np.array([every[skin.joint].translation for every in places]),
                batched_colors=START,
                opacity=FAINT,
                cast_shadow=False,
                receive_shadow=False,
            )
            for number, skin in enumerate(collision_skins(robot))
            if skin.joint
        ]


class Frames:
    """The frames of the joints, red, green and blue along x, y and z, and the axis about or along which each moves."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Draw nothing yet."""
        self._scene = server.scene
        self.node: Any = None
        self.axes: Any = None

    def show(self, on: bool, robot: Robot, q: Array) -> None:
        """Show the frames of a robot at configuration `q` (n,), or nothing."""
        if not on:
            if self.node is not None:
                self.node.remove()
                self.axes.remove()
                self.node = self.axes = None
            return
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, robot.pin_q(q))
        places = list(data.oMi)[1:]
        along = np.array([_axis(model, data.oMi[number]) for number, model in enumerate(robot.model.joints) if number])
        turns, points = np.array([wxyz_of(p.rotation) for p in places]), np.array([p.translation for p in places])
        lines = np.stack([points - LONG * along, points + LONG * along], axis=1).astype(np.float32)
        if self.node is None:
            self.axes = self._scene.add_line_segments("/axes", lines, INK, thickness=0.5 * RADIUS)
            self.node = self._scene.add_batched_axes("/frames", turns, points, axes_length=AXIS, axes_radius=RADIUS)
        else:
            self.node.batched_wxyzs, self.node.batched_positions = turns, points
            self.axes.points = lines


def _axis(joint: pin.JointModel, place: pin.SE3) -> Array:
    """Return the direction (3,) of a joint's axis in the world; zeros for one that moves in several."""
    motion = np.asarray(joint.createData().S)
    if joint.nv != 1:
        return np.zeros(3)
    along, about = motion.reshape(2, 3)
    return np.asarray(place.rotation @ (about if about.any() else along))


class Names:
    """The obstacles' names, where they are."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Draw nothing yet."""
        self._scene = server.scene
        self.labels: dict[str, tuple[Any, Any]] = {}  # by node's name: label, and the node

    def show(self, on: bool, nodes: Sequence[ObstacleNode]) -> None:
        """Show the names of the scene's obstacles, or none."""
        wanted = {node.frame.name: node for node in nodes} if on else {}
        for gone in self.labels.keys() - wanted.keys():
            label, node = self.labels.pop(gone)
            if node in nodes:  # or it has gone with its node
                label.remove()
        for name, node in wanted.items():
            text = shortened(node.obstacle.name, LONGEST)
            if name not in self.labels:
                label = self._scene.add_label(f"{name}/name", text, **LABELS | {"font_screen_scale": 0.8})
                self.labels[name] = label, node
            self.labels[name][0].text = text
