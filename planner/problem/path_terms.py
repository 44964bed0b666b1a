"""Path constraints as penalties: the axis of a link stays upright, a point of a link stays in a box, a link keeps its
pose relative to another.

Each constraint is one or more measures in [m] that must stay below a bound (`hinge`).

*Upright*: g = LEVER θ, with θ the angle between the axis a and the upward direction z. Its slope, dθ/dq_j = −ω_j · (a ×
z)/‖a × z‖, has length one in ω at every angle: it neither vanishes nor grows towards a half turn, where any direction
will do; at θ = 0 the hinge is inactive. *Within*: g = |u| in each axis of the box, u the position of the point in the
box. *Relative*: g = ‖p − c‖, the link's origin p and the point c of the other link at which it is to be, and g = LEVER
‖φ‖, the rotation vector φ of the turn from the required rotation to the link's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, assert_never

import casadi as ca
import numpy as np
import pinocchio as pin

from hdplan.distance.symbolic.closed import ClosedForm
from hdplan.planner.geometry.rotations import vectors_of
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.hinge import Hinge, Measure, band_below
from hdplan.planner.problem.second_order import by_joints, cross_matrices, outer, point_along
from hdplan.planner.problem.symbolic_place import JointPlaces, SymbolicPlace
from hdplan.planner.robot.link_frame import link_frame, relative_links
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.once import read_only
from hdplan.scenes.path_constraints import Follow, PathConstraint, Relative, Upright, Within

LEVER = 1.0  # [m] lever arm that turns an angle into a length
OVERSHOOT = 1.2  # of the way back to the constraint, the aim of a step: damped steps fall short
UP = read_only(np.array([0.0, 0.0, 1.0]))  # in the world
NO_TURN = 1e-4  # [rad] below which the series of a rotation vector is cut off after its first terms
PARALLEL_SINE = 1e-12  # sine below which two directions have no axis of their own


class WrittenMeasure(Measure, Protocol):
    """A measure that is written in symbols too."""

    @property
    def carriers(self) -> tuple[int, ...]:
        """The joints on whose places alone it depends."""
        ...

    def written(self, place: JointPlaces) -> list[ca.MX]:
        """The m measures v (k,), with derivatives wherever their lengths are not 0."""
        ...


class PathTerm(Hinge):
    """A path constraint as a squared hinge on its measures."""

    measure: WrittenMeasure

    def written_at_sample(self, place: SymbolicPlace) -> ClosedForm:
        """Σ ½ |r|²."""
        return place.half_square(self._residual, self.measure.carriers)

    def _residual(self, place: JointPlaces) -> ca.MX:
        """r, as long as each measure has entered its band."""
        bound = self.measure.bound
        found: list[ca.MX] = []
        for vector, threshold in zip(self.measure.written(place), (bound - band_below(bound)).tolist(), strict=True):
            square = ca.sumsqr(vector)
            entered = square > threshold**2
            length = ca.sqrt(ca.if_else(entered, square, 1.0))
            found.append(ca.if_else(entered, 1 - threshold / length, 0.0) * vector)
        return ca.vertcat(*found)


@dataclass(frozen=True, eq=False)
class UprightMeasure:
    """The angle between a link's axis and the upward direction, times LEVER."""

    joint: int  # of the model, that carries the link
    axis: Array  # (3,) unit, in the joint's frame
    moves: Mask  # (n,) coordinates that move the link
    bound: Array  # (1,) [m]

    def value(self, kinematics: KinematicsBatch) -> Array:
        """LEVER θ."""
        axis = kinematics.rotations[:, self.joint] @ self.axis
        angle: Array = np.arctan2(_unit(np.cross(axis, UP))[1], axis @ UP)
        return LEVER * angle[:, None, None]

    def slope(self, kinematics: KinematicsBatch) -> Array:
        """Return the derivative of LEVER θ by the joints."""
        aside, _ = _unit(np.cross(kinematics.rotations[:, self.joint] @ self.axis, UP))
        slope: Array = -(kinematics.angular @ aside[..., None])[..., 0] * self.moves
        return LEVER * slope[:, None, None]

    def second_order(self, kinematics: KinematicsBatch) -> Array:
        """As the link turns by ω, with c the unit vector across a on the side of z: cot θ (c·ω)² − (a·ω) (c·ω); 0 where
        the angle has no derivative."""
        axis = kinematics.rotations[:, self.joint] @ self.axis
        aside, sine = _unit(np.cross(axis, UP))
        towards = np.cross(aside, axis)
        wrench, hessian = np.zeros((len(axis), 6)), np.zeros((len(axis), 6, 6))
        wrench[:, 3:] = -LEVER * aside
        mixed = outer(axis, towards)
        cot = np.where(sine > PARALLEL_SINE, axis @ UP / np.maximum(sine, PARALLEL_SINE), 0.0)
        hessian[:, 3:, 3:] = LEVER * (
            cot[:, None, None] * outer(towards, towards) - 0.5 * (mixed + mixed.swapaxes(1, 2))
        )
        return by_joints(kinematics.columns, self.moves, wrench, hessian)[:, None]

    @property
    def carriers(self) -> tuple[int, ...]:
        """The link's joint."""
        return (self.joint,)

    def written(self, place: JointPlaces) -> list[ca.MX]:
        """LEVER θ."""
        axis = place.rotation(self.joint) @ ca.DM(self.axis)
        sine = _length(ca.cross(axis, ca.MX(ca.DM(UP))))
        return [LEVER * ca.atan2(sine, ca.dot(axis, ca.DM(UP)))]


@dataclass(frozen=True, eq=False)
class WithinMeasure:
    """The distance of a point of a link from the middle of a box, along those of its axes in which it is bounded."""

    joint: int
    point: Array  # (3,) in the joint's frame [m]
    moves: Mask  # (n,)
    centre: Array  # (3,) of the box, in the world [m]
    axes: Array  # (m, 3) of the box, in the world, where it has sides
    bound: Array  # (m,) half its edges [m]

    def value(self, kinematics: KinematicsBatch) -> Array:
        """u, an axis at a time."""
        off: Array = (self._place(kinematics) - self.centre) @ self.axes.T
        return off[..., None]

    def slope(self, kinematics: KinematicsBatch) -> Array:
        """The velocity of the point along each axis."""
        place = self._place(kinematics)
        velocity = (kinematics.linear + np.cross(kinematics.angular, place[:, None])) * self.moves[:, None]
        slope: Array = self.axes @ velocity.transpose(0, 2, 1)
        return slope[..., None, :]

    def _place(self, kinematics: KinematicsBatch) -> Array:
        """The point (B, 3) in the world."""
        place: Array = kinematics.rotations[:, self.joint] @ self.point + kinematics.translations[:, self.joint]
        return place

    def second_order(self, kinematics: KinematicsBatch) -> Array:
        """Velocity of the point along each axis."""
        place = self._place(kinematics)
        signs = np.sign((place - self.centre) @ self.axes.T)
        along = [sign[:, None] * axis for sign, axis in zip(signs.T, self.axes, strict=True)]
        return np.stack(
            [by_joints(kinematics.columns, self.moves, *point_along(place, axis)) for axis in along], axis=1
        )

    @property
    def carriers(self) -> tuple[int, ...]:
        """The link's joint."""
        return (self.joint,)

    def written(self, place: JointPlaces) -> list[ca.MX]:
        """u, an axis at a time."""
        point = place.rotation(self.joint) @ ca.DM(self.point) + place.origin(self.joint)
        return ca.vertsplit(ca.DM(self.axes) @ (point - ca.DM(self.centre)))


@dataclass(frozen=True, eq=False)
class RelativeMeasure:
    """Offset of a link from its pose in another link's frame: the way to its place, and the rotation vector of the
    turn to it, times LEVER. Joints that carry both links change neither."""

    joints: tuple[int, int]  # of the model, that carry the link and the other one
    placements: tuple[Array, Array]  # (4, 4) in their frames: of the link, and of where it is to be
    moves: tuple[Mask, Mask]  # (n,) coordinates that move the one and not the other
    bound: Array  # (2,) [m]

    def value(self, kinematics: KinematicsBatch) -> Array:
        """p − c, and LEVER φ."""
        (place, turned), (target, wanted) = self._placed(kinematics)
        return np.stack([place - target, LEVER * vectors_of(turned @ wanted.transpose(0, 2, 1))], axis=1)

    def slope(self, kinematics: KinematicsBatch) -> Array:
        """The velocity of the one place past the other, and how φ changes as the links turn."""
        linear, angular = [], []
        (place, turned), (target, wanted) = self._placed(kinematics)
        for point, moves in zip((place, target), self.moves, strict=True):
            linear.append((kinematics.linear + np.cross(kinematics.angular, point[:, None])) * moves[:, None])
            angular.append(kinematics.angular * moves[:, None])
        turn = turned @ wanted.transpose(0, 2, 1)
        faster = angular[0] - angular[1] @ turn.transpose(0, 2, 1)
        turning = LEVER * _rate(vectors_of(turn)) @ faster.transpose(0, 2, 1)
        return np.stack([(linear[0] - linear[1]).transpose(0, 2, 1), turning], axis=1)

    def second_order(self, kinematics: KinematicsBatch) -> Array:
        """With u the direction of the way and ṗ the velocity of the place: that of the place along u, and (|ṗ|² −
        (u·ṗ)²)/‖p − c‖. As the link turns by ω, u the axis of φ: ½ cot(‖φ‖/2) (|ω|² − (u·ω)²)."""
        (place, turned), (target, wanted) = self._placed(kinematics)
        moves = self.moves[0].astype(np.float64) - self.moves[1]
        unit, length = _unit(place - target)
        wrench, hessian = point_along(place, unit)
        velocity = np.concatenate([np.broadcast_to(np.eye(3), turned.shape), -cross_matrices(place)], axis=2)
        hessian = hessian + velocity.swapaxes(1, 2) @ _across(unit, length) @ velocity
        torque, bent = np.zeros_like(wrench), np.zeros_like(hessian)
        unit, angle = _unit(vectors_of(turned @ wanted.swapaxes(1, 2)))
        torque[:, 3:], bent[:, 3:, 3:] = LEVER * unit, LEVER * _across(unit, 2 * np.tan(0.5 * angle))
        found = [by_joints(kinematics.columns, moves, *each) for each in ((wrench, hessian), (torque, bent))]
        return np.stack(found, axis=1)

    @property
    def carriers(self) -> tuple[int, ...]:
        """The joints of both links."""
        return self.joints

    def written(self, place: JointPlaces) -> list[ca.MX]:
        """p − c, and LEVER φ with φ = θ/sin θ times half of what is skew in the turn."""
        (point, turned), (target, wanted) = (
            (rotation @ ca.DM(placement[:3, 3]) + place.origin(joint), rotation @ ca.DM(placement[:3, :3]))
            for joint, placement in zip(self.joints, self.placements, strict=True)
            for rotation in [place.rotation(joint)]
        )
        turn = turned @ wanted.T
        skew = ca.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]) / 2
        sine = _length(skew)
        angle = ca.atan2(sine, (ca.trace(turn) - 1) / 2)
        small = sine < NO_TURN
        factor = ca.if_else(
            ca.logic_and(small, angle < 1), 1 + ca.sumsqr(skew) / 6, angle / ca.if_else(small, NO_TURN, sine)
        )
        return [point - target, LEVER * factor * skew]

    def _placed(self, kinematics: KinematicsBatch) -> list[tuple[Array, Array]]:
        """Origins (B, 3) and rotations (B, 3, 3) in the world: of the link, and of where it is to be."""
        found = []
        for joint, placement in zip(self.joints, self.placements, strict=True):
            rotation = kinematics.rotations[:, joint]
            place = rotation @ placement[:3, 3] + kinematics.translations[:, joint]
            found.append((place, rotation @ placement[:3, :3]))
        return found


def _unit(vectors: Array) -> tuple[Array, Array]:
    """Vectors (B, 3) of length one, and their lengths (B,); any direction where there is hardly a length."""
    length = np.linalg.norm(vectors, axis=1)
    unit = np.where(
        length[:, None] > PARALLEL_SINE, vectors / np.maximum(length, PARALLEL_SINE)[:, None], [1.0, 0.0, 0.0]
    )
    return unit, length


def _length(vector: ca.MX) -> ca.MX:
    """The length of a vector in symbols, of which derivatives are 0 where there is hardly a length."""
    square = ca.sumsqr(vector)
    there = square > PARALLEL_SINE**2
    return ca.if_else(there, ca.sqrt(ca.if_else(there, square, 1.0)), 0.0)


def _across(unit: Array, length: Array) -> Array:
    """(I − u uᵀ)/l (B, 3, 3), how u turns as the end of a vector of length l moves."""
    result: Array = (np.eye(3) - outer(unit, unit)) / np.maximum(length, PARALLEL_SINE)[:, None, None]
    return result


def _rate(vector: Array) -> Array:
    """The derivative (B, 3, 3) of a rotation vector φ (B, 3) by the angular velocity, both in the outer frame:
    I − ½ [φ]× + (1/θ² − cot(θ/2)/(2 θ)) [φ]×²."""
    angle = np.linalg.norm(vector, axis=1)
    small = angle < NO_TURN
    wide = np.where(small, 1.0, angle)
    share = np.where(small, 1.0 / 12.0, 1.0 / wide**2 - 0.5 / (wide * np.tan(0.5 * wide)))
    cross = cross_matrices(vector)
    return np.eye(3) - 0.5 * cross + share[:, None, None] * (cross @ cross)


def path_terms(setup: Setup, supports: Mask) -> tuple[PathTerm, ...]:
    """Return the terms of the scene's path constraints; `supports` (nj, n) as in Kinematics.

    Raises InputError for a link that the robot lacks or that does not move.
    """
    scene = setup.scene
    with naming(scene.source):
        return tuple(
            PathTerm(field, _measure(constraint, field, setup, supports), scene.planner.activation)
            for field, constraint in scene.path.given.items()
        )


def to_path(terms: tuple[PathTerm, ...], kinematics: KinematicsBatch) -> tuple[Array, Array]:
    """Return the error (B, m) [m] that steps of damped least squares are to remove so that one or more constraints hold
    with their bands, 0 where they do, and its Jacobian (B, m, n)."""
    inside, slopes = zip(*(term.inside(kinematics) for term in terms), strict=True)
    return -OVERSHOOT * np.concatenate(inside, axis=1), np.concatenate(slopes, axis=1)


def _measure(constraint: PathConstraint, field: str, setup: Setup, supports: Mask) -> WrittenMeasure:
    robot = setup.robot
    match constraint:
        case Relative():
            joints, (own, other), pose = relative_links(setup.scene, robot, constraint)
            first, second = (supports[joint] for joint in joints)
            bound = np.array([constraint.position_tolerance, LEVER * constraint.orientation_tolerance])
            return RelativeMeasure(joints, (own, other @ pose), (first & ~second, second & ~first), bound)
        case Upright():
            joint, placement = _carrier(robot, constraint.link, field)
            axis = placement.rotation @ np.array(constraint.axis) / np.linalg.norm(constraint.axis)
            return UprightMeasure(joint, axis, supports[joint], np.array([LEVER * constraint.tolerance]))
        case Within():
            joint, placement = _carrier(robot, constraint.link, field)
            half, box = 0.5 * np.array(constraint.size), constraint.pose.matrix
            sides = np.isfinite(half)
            point = placement.act(np.array(constraint.point))
            return WithinMeasure(joint, point, supports[joint], box[:3, 3], box[:3, :3].T[sides], half[sides])
        case Follow():
            raise InputError(f"{field}: a single motion is not planned along a curve; a stage of a job is")
        case _:
            assert_never(constraint)


def _carrier(robot: Robot, link: str, field: str) -> tuple[int, pin.SE3]:
    """Return the joint that carries a link, and the link's frame in that joint's."""
    frame = robot.model.frames[link_frame(robot, link, field)]
    return int(frame.parentJoint), frame.placement
