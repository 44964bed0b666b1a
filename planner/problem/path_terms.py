"""Path constraints as penalties: the axis of a link stays upright, a point of a link stays in a box, a link keeps its
pose relative to another.

Each constraint is one or more measures in [m] that must stay below a bound (`hinge`).

*Upright*: g = LEVER θ, with θ the angle between the axis a and the upward direction z. Its slope, dθ/dq_j = −ω_j · (a ×
z)/‖a × z‖, has length one in ω at every angle: it neither vanishes nor grows towards a half turn, where any direction
will do; at θ = 0 the hinge is inactive. *Within*: g = |u| in each axis of the box, u the position of the point in the
box. *Relative*: g = ‖p − c‖, the link's origin p and the point c of the other link at which it is to be, and g = LEVER
‖φ‖, the rotation vector φ of the turn from the rotation that is asked for to the link's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.hinge import Hinge, Measure, Measures
from hdplan.planner.robot.link_frame import link_frame, relative_links
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.errors import naming
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.once import read_only
from hdplan.scenes.path_constraints import Relative, Upright, Within

LEVER = 1.0  # [m] lever arm that turns an angle into a length
BEYOND = 1.2  # of the way back to the constraint that a step aims for: damped steps fall short
UP = read_only(np.array([0.0, 0.0, 1.0]))  # in the world
NO_TURN = 1e-4  # [rad] below which the series of a rotation vector is cut off after its first terms
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
        return Measures(LEVER * angle[:, None, None], LEVER * slope[:, None, None])


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
        return Measures(off[..., None], (self.axes @ velocity.transpose(0, 2, 1))[..., None, :])


@dataclass(frozen=True, eq=False)
class RelativeMeasure:
    """How far a link is from its pose in another link's frame: the way to its place, and the rotation vector of the
    turn to it, times LEVER. Joints that carry both links change neither."""

    joints: tuple[int, int]  # of the model, that carry the link and the other one
    placements: tuple[Array, Array]  # (4, 4) in their frames: of the link, and of where it is to be
    moves: tuple[Mask, Mask]  # (n,) coordinates that move the one and not the other
    bound: Array  # (2,) [m]

    def __call__(self, kinematics: KinematicsBatch) -> Measures:
        """Evaluate."""
        places, turns, linear, angular = [], [], [], []
        for joint, placement, moves in zip(self.joints, self.placements, self.moves, strict=True):
            rotation = kinematics.rotations[:, joint]
            place = rotation @ placement[:3, 3] + kinematics.translations[:, joint]
            places.append(place)
            turns.append(rotation @ placement[:3, :3])
            linear.append((kinematics.linear + np.cross(kinematics.angular, place[:, None])) * moves[:, None])
            angular.append(kinematics.angular * moves[:, None])
        turn = turns[0] @ turns[1].transpose(0, 2, 1)
        vector = scipy.spatial.transform.Rotation.from_matrix(turn).as_rotvec()
        faster = angular[0] - angular[1] @ turn.transpose(0, 2, 1)
        return Measures(
            np.stack([places[0] - places[1], LEVER * vector], axis=1),
            np.stack(
                [(linear[0] - linear[1]).transpose(0, 2, 1), LEVER * _rate(vector) @ faster.transpose(0, 2, 1)], axis=1
            ),
        )


def _rate(vector: Array) -> Array:
    """The derivative (B, 3, 3) of a rotation vector φ (B, 3) by the angular velocity, both in the outer frame:
    I − ½ [φ]× + (1/θ² − cot(θ/2)/(2 θ)) [φ]×²."""
    angle = np.linalg.norm(vector, axis=1)
    small = angle < NO_TURN
    wide = np.where(small, 1.0, angle)
    share = np.where(small, 1.0 / 12.0, 1.0 / wide**2 - 0.5 / (wide * np.tan(0.5 * wide)))
    cross = np.cross(vector[:, None], np.eye(3)).transpose(0, 2, 1)
    return np.eye(3) - 0.5 * cross + share[:, None, None] * (cross @ cross)


def path_terms(setup: Setup, supports: Mask) -> tuple[PathTerm, ...]:
    """Return the terms that the scene's path constraints call for; `supports` (nj, n) as in Kinematics.

    Raises InputError for a link that the robot lacks or that does not move.
    """
    scene = setup.scene
    path = scene.path
    given = (("path.upright", path.upright), ("path.position", path.position), ("path.relative", path.relative))
    with naming(scene.source):
        return tuple(
            PathTerm(field, _measure(asked, field, setup, supports), scene.planner.activation)
            for field, asked in given
            if asked is not None
        )


def to_path(terms: tuple[PathTerm, ...], kinematics: KinematicsBatch) -> tuple[Array, Array]:
    """Return the error (B, m) [m] that steps of damped least squares are to remove so that one or more constraints hold
    with their bands, 0 where they do, and its Jacobian (B, m, n)."""
    inside, slopes = zip(*(term.inside(kinematics) for term in terms), strict=True)
    return -BEYOND * np.concatenate(inside, axis=1), np.concatenate(slopes, axis=1)


def _measure(asked: Upright | Within | Relative, field: str, setup: Setup, supports: Mask) -> Measure:
    robot = setup.robot
    if isinstance(asked, Relative):
        joints, (own, other), pose = relative_links(setup.scene, robot, asked)
        first, second = (supports[joint] for joint in joints)
        bound = np.array([asked.position_tolerance, LEVER * asked.orientation_tolerance])
        return RelativeMeasure(joints, (own, other @ pose), (first & ~second, second & ~first), bound)
    frame = robot.model.frames[link_frame(robot, asked.link, field)]
    joint, placement = int(frame.parentJoint), frame.placement
    if isinstance(asked, Upright):
        axis = placement.rotation @ np.array(asked.axis) / np.linalg.norm(asked.axis)
        return UprightMeasure(joint, axis, supports[joint], np.array([LEVER * asked.tolerance]))
    half, box = 0.5 * np.array(asked.size), asked.pose.matrix
    sides = np.isfinite(half)
    point = placement.act(np.array(asked.point))
    return WithinMeasure(joint, point, supports[joint], box[:3, 3], box[:3, :3].T[sides], half[sides])
