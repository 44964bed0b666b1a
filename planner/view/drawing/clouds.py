"""Clouds in the browser: a point for each ball, coloured by height or by clearance.

The points are sent once. Browsers do not tell which point is under the mouse: what is clicked on are boxes around them,
which can be seen only where the cloud is selected or in contact.
"""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
import viser
from numpy.typing import NDArray

from hdplan.planner.geometry.clouds import balls_in
from hdplan.planner.geometry.drawn_shapes import boxes_mesh
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.colors import clearance_colors, height_colors
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.nodes import ObstacleNode
from hdplan.planner.view.drawing.skins import collision_skins
from hdplan.scenes.array_types import Array
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.lazy_imports import scipy, trimesh
from hdplan.scenes.obstacles import Obstacle

MOST_POINTS = 200_000  # that are drawn of a cloud, evenly chosen: 3 MB for a browser
OVER = 0.25  # opacity of the boxes around what is selected or in contact
SMALLER = 0.35  # times as large are points between the eye and the robot
MOMENTS, APART = 24, 0.015  # of a motion at which distances to the robot are measured; [m] of points on its surface


class CloudNode(ObstacleNode):
    """A cloud of points."""

    def __init__(self, server: viser.ViserServer, index: int, obstacle: Obstacle) -> None:
        """Send the points, and the boxes around them."""
        super().__init__(server, index, obstacle)
        assert isinstance(obstacle.shape, Cloud)
        balls = balls_in(obstacle.shape).array
        self._balls = balls[:: -(-len(balls) // MOST_POINTS)]
        self._upward, self._size = self.place[2, :3], 2.0 * float(np.median(self._balls[:, 3]))
        self.points = server.scene.add_point_cloud(
            f"/obstacles/{index}/points",
            self._balls[:, :3].astype(np.float32),
            self._by_height(),
            point_size=self._size,
            point_shape="circle",
            precision="float32",
        )
        self._coloured: object = None  # by which motion, and where
        self._paint()

    def _mesh(self, obstacle: Obstacle) -> TriangleMesh:
        """Return boxes around its parts, few, as browsers look at all of them whenever the mouse moves."""
        return TriangleMesh(*boxes_mesh(self.parts[:, 0], self.parts[:, 1]))

    def color(self, robot: Robot, motion: ShownMotion | None) -> None:
        """Colour the points by how close a motion comes to them, or without one by height."""
        by = None if motion is None else (motion, self.place.tobytes())
        if by != self._coloured:
            self._coloured = by
            self.points.colors = self._by_height() if motion is None else self._by_clearance(robot, motion)

    def fade(self, faded: bool) -> None:
        """Let it be seen through, as it stands between the eye and the robot, or be solid again."""
        size = self._size * (SMALLER if faded else 1.0)
        self.points.point_size = size

    @property
    def opacity(self) -> float:
        """Opacity of the boxes."""
        return OVER if self._in_contact or self._selected else 0.0

    def _by_height(self) -> NDArray[np.uint8]:
        height = self._balls[:, :3] @ self._upward
        low, high = float(height.min()), float(height.max())
        return height_colors((height - low) / max(high - low, 1e-9))

    def _by_clearance(self, robot: Robot, motion: ShownMotion) -> NDArray[np.uint8]:
        """By the distance of each ball from points of the robot's surface along a motion: about, as they lie some
        centimetres apart."""
        along = _links_along(robot, motion.joints[np.linspace(0, len(motion.joints) - 1, MOMENTS).astype(int)])
        world = self._balls[:, :3] @ self.place[:3, :3].T + self.place[:3, 3]
        return clearance_colors(scipy.spatial.cKDTree(along).query(world)[0] - self._balls[:, 3])


def _links_along(robot: Robot, rows: Array) -> Array:
    """Return points of what moves of a robot's surface (m, 3) in the world, at each of its configurations (k, n)."""
    data, found = robot.model.createData(), []
    for q in rows:
        pin.forwardKinematics(robot.model, data, robot.pin_q(q))
        for joint, points in _surface(robot):
            found.append(points @ data.oMi[joint].rotation.T + data.oMi[joint].translation)
    return np.concatenate(found) if found else np.full((1, 3), np.inf)


@functools.lru_cache(maxsize=8)
def _surface(robot: Robot) -> tuple[tuple[int, Array], ...]:
    """Return points of each link's surface (m, 3) in the frame of its joint, APART from one another in the mean."""
    found = []
    for skin in collision_skins(robot):
        if skin.joint:
            mesh = trimesh.Trimesh(skin.vertices, skin.triangles, process=False)
            points, _ = trimesh.sample.sample_surface(mesh, int(mesh.area / APART**2) + 1, seed=0)
            found.append((skin.joint, np.asarray(points)))
    return tuple(found)
