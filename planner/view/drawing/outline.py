"""The outline of a robot for cameras: the boxes around its bodies, in any configuration."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array

INSIDE = 0.8  # of the way from a body's middle to a corner of its box, which is not in the body itself
NO_EDGE = [0, 3, 5, 6]  # corners of a box, of which no two have an edge in common


class Outline:
    """The boxes around a robot's bodies."""

    def __init__(self, robot: Robot) -> None:
        """Bound its collision geometry."""
        self._robot, self._data = robot, robot.model.createData()
        signs = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
        self._boxes = []
        for item in robot.collision.geometryObjects:
            item.geometry.computeLocalAABB()
            box, place = item.geometry.aabb_local, item.placement
            corners = np.where(signs, box.max_, box.min_) @ place.rotation.T + place.translation
            self._boxes.append((int(item.parentJoint), corners))

    def at(self, q: Array) -> Array:
        """Return their corners (g, 8, 3) in the world at configuration `q` (n,)."""
        pin.forwardKinematics(self._robot.model, self._data, self._robot.pin_q(q))
        places = self._data.oMi
        return np.array(
            [corners @ places[joint].rotation.T + places[joint].translation for joint, corners in self._boxes]
        ).reshape(-1, 8, 3)

    def middles(self, q: Array) -> Array:
        """Return the middles (m, 3) of those that move."""
        return np.asarray(self._moving(q).mean(axis=1))

    def inside(self, q: Array) -> Array:
        """Return points (4 m, 3) all over those that move, which tell whether a part of one is hidden."""
        corners = self._moving(q)
        middles = corners.mean(axis=1, keepdims=True)
        return np.asarray(middles + INSIDE * (corners[:, NO_EDGE] - middles)).reshape(-1, 3)

    def _moving(self, q: Array) -> Array:
        """The corners (m, 8, 3) of those that move."""
        return self.at(q)[[joint > 0 for joint, _ in self._boxes]]
