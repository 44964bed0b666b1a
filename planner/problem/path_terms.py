"""Path constraints as penalties: the axis of a link stays upright, a point of a link stays in a box.

Each constraint is one or more measures in [m] that must stay below a bound (`hinge`).

*Upright*: g = LEVER θ, with θ the angle between the axis a and the upward direction z. Its slope, dθ/dq_j = −ω_j · (a ×
z)/‖a × z‖, has length one in ω at every angle: it neither vanishes nor grows towards a half turn, where any direction
will do; at θ = 0 the hinge is inactive. *Within*: g = |u| in each axis of the box, u the position of the point in the
box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.hinge import Hinge, Measures
from hdplan.planner.robot.link_frame import link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.errors import naming
from hdplan.scenes.once import read_only
from hdplan.scenes.path_constraints import Upright, Within

LEVER = 1.0  # [m] lever arm that turns an angle into a length
BEYOND = 1.2  # of the way back to the constraint that a step aims for: damped steps fall short
UP = read_only(np.array([0.0, 0.0, 1.0]))  # in the world
PARALLEL = 1e-12  # sine below which two directions have no axis of their own


class PathTerm(Hinge):
    """A path constraint as a squared hinge on its measures."""


@dataclass(frozen=True, eq=False)
class UprightMeasure:
    """The angle between a link's axis and the upward direction, times LEVER."""

    joint: int  # of the model, that carries the link
    axis: Array  # (3,) unit, in the joint's frame
    moves: Mask  # (n,) coordinates that move the link
    bound: Array  # (1,) [m]

    def __call__(self, kinematics: KinematicsBatch) -> Measures:
        """Evaluate."""
        axis = kinematics.rotations[:, self.joint] @ self.axis
        across = np.cross(axis, UP)
        sine = np.linalg.norm(across, axis=1)
        aside = np.where(sine[:, None] > PARALLEL, across / np.maximum(sine, PARALLEL)[:, None], [1.0, 0.0, 0.0])
        angle = np.arctan2(sine, axis @ UP)
        slope = -(kinematics.angular @ aside[..., None])[..., 0] * self.moves
        return Measures(LEVER * angle[:, None], LEVER * slope[:, None])


@dataclass(frozen=True, eq=False)
class WithinMeasure:
    """The distance of a point of a link from the middle of a box, along those of its axes in which it is bounded."""

    joint: int
    point: Array  # (3,) in the joint's frame [m]
    moves: Mask  # (n,)
    centre: Array  # (3,) of the box, in the world [m]
    axes: Array  # (m, 3) of the box, in the world, where it has sides
    bound: Array  # (m,) half its edges [m]

    def __call__(self, kinematics: KinematicsBatch) -> Measures:
        """Evaluate."""
        place = kinematics.rotations[:, self.joint] @ self.point + kinematics.translations[:, self.joint]
        velocity = (kinematics.linear + np.cross(kinematics.angular, place[:, None])) * self.moves[:, None]
        off = (place - self.centre) @ self.axes.T
        return Measures(np.abs(off), np.sign(off)[..., None] * (self.axes @ velocity.transpose(0, 2, 1)))


def path_terms(setup: Setup, supports: Mask) -> tuple[PathTerm, ...]:
    """Return the terms that the scene's path constraints call for; `supports` (nj, n) as in Kinematics.

    Raises InputError for a link that the robot lacks or that does not move.
    """
    scene, robot = setup.scene, setup.robot
    given = (("path.upright", scene.path.upright), ("path.position", scene.path.position))
    with naming(scene.source):
        return tuple(
            PathTerm(field, _measure(asked, field, robot, supports), scene.planner.activation)
            for field, asked in given
            if asked is not None
        )


def to_path(terms: tuple[PathTerm, ...], kinematics: KinematicsBatch) -> tuple[Array, Array]:
    """Return the error (B, m) [m] that steps of damped least squares are to remove so that one or more constraints hold
    with their bands, 0 where they do, and its Jacobian (B, m, n)."""
    inside, slopes = zip(*(term.inside(kinematics) for term in terms), strict=True)
    return -BEYOND * np.concatenate(inside, axis=1), np.concatenate(slopes, axis=1)


def _measure(asked: Upright | Within, field: str, robot: Robot, supports: Mask) -> UprightMeasure | WithinMeasure:
    frame = robot.model.frames[link_frame(robot, asked.link, field)]
    joint, placement = int(frame.parentJoint), frame.placement
    if isinstance(asked, Upright):
        axis = placement.rotation @ np.array(asked.axis) / np.linalg.norm(asked.axis)
        return UprightMeasure(joint, axis, supports[joint], np.array([LEVER * asked.tolerance]))
    half, box = 0.5 * np.array(asked.size), asked.pose.matrix
    sides = np.isfinite(half)
    point = placement.act(np.array(asked.point))
    return WithinMeasure(joint, point, supports[joint], box[:3, 3], box[:3, :3].T[sides], half[sides])
