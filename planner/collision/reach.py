"""The reach of a body: a ball around the first joint of its chain that contains it at every configuration within the
limits; and how fast at most."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.once import ReadOnly, read_only


@dataclass(frozen=True)
class Reach(ReadOnly):
    """A ball in the world that a body never leaves."""

    centre: Array  # (3,) [m]
    radius: float  # [m]

    def meets(self, boxes: Array, half_sizes: Array) -> Mask:
        """For each box (B, 4, 4) with these half sizes (B, 3) [m], such as that of a static body enlarged by its
        margin, whether the ball touches it; if not, the pair can be left out."""
        return np.asarray(self.gaps(boxes, half_sizes) <= self.radius)

    def gaps(self, boxes: Array, half_sizes: Array) -> Array:
        """Distances of the same boxes from the ball's centre (B,) [m]."""
        local = ((self.centre - boxes[:, :3, 3])[:, None] @ boxes[:, :3, :3])[:, 0]
        return np.asarray(np.linalg.norm(np.maximum(np.abs(local) - half_sizes, 0.0), axis=1))


@functools.lru_cache(maxsize=1024)
def reach_of(robot: Robot, joint: int, body: ConvexBody) -> Reach:
    """Bound the places of a body on `joint` within the robot's limits.

    The origin of a chain's first joint is fixed (apart from its own travel); each further joint's origin is at a fixed
    distance from its parent's frame, plus its travel. The triangle inequality adds these up, with the body's farthest
    point.
    """
    model = robot.model
    radius = float(np.linalg.norm(body.vertices, axis=1).max()) + body.radius
    while joint > 0:
        radius += _travel(robot, joint)
        if model.parents[joint] == 0:
            break
        radius += float(np.linalg.norm(model.jointPlacements[joint].translation))
        joint = int(model.parents[joint])
    return Reach(np.array(model.jointPlacements[joint].translation), radius)


@functools.lru_cache(maxsize=64)
def levers(robot: Robot, bodies: tuple[tuple[int, ConvexBody], ...]) -> Array:
    """Bound how fast any point of the bodies (joint, body) moves per unit of each joint's speed (n,), at any
    configuration within the robot's limits: [m] for a revolute joint, 1 for a prismatic one.

    From a joint's origin to the body's farthest point, from joint to joint, by the triangle inequality as above.
    """
    model, found = robot.model, np.zeros(robot.n)
    for joint, body in bodies:
        length, at = float(np.linalg.norm(body.vertices, axis=1).max()) + body.radius, joint
        while at > 0:
            found[at - 1] = max(found[at - 1], 1.0 if _slides(robot, at) else length + _travel(robot, at))
            length += _travel(robot, at) + float(np.linalg.norm(model.jointPlacements[at].translation))
            at = int(model.parents[at])
    return read_only(found)


def _slides(robot: Robot, joint: int) -> bool:
    return "P" in robot.model.joints[joint].shortname().removeprefix("JointModel")[:1]


def _travel(robot: Robot, joint: int) -> float:
    """Largest displacement of a prismatic joint within its limits [m]; 0 for a revolute one."""
    if not _slides(robot, joint):
        return 0.0
    return float(max(abs(robot.lower[joint - 1]), abs(robot.upper[joint - 1])))
