"""The poses of links, linearized, and the damped step that brings them closer to their targets.

Damped least squares, dq = Jᵀ (J Jᵀ + λ² I)⁻¹ e, within the joint limits, for many configurations at once (Nakamura &
Hanafusa, "Inverse kinematic solutions with singularity robustness", 1986). Free rotations are taken out of J and e.
`inverse_loop` has the same in C.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hdplan.distance.compiled.loops import C, Record
from hdplan.distance.poses import placement_rows
from hdplan.planner.geometry.rotations import vectors_of
from hdplan.planner.kinematics import inverse_loop
from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch, kinematics_of
from hdplan.planner.robot.link_frame import AXES, link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.targets import AllOf, PoseTarget

DAMPING = 0.02  # λ: keeps steps short near a singular configuration
LONGEST_STEP = 0.4  # [rad] or [m] of one step of a joint
PARALLEL_SINE = 1e-9  # sine below which two directions define no axis


class LinkPose(NamedTuple):
    """A target, and the link that is to reach it."""

    robot: Robot
    target: PoseTarget
    arm: Kinematics
    joint: int  # the one that carries the link
    placement: Array  # (4, 4) of the link in the joint's frame

    @classmethod
    def of(cls, robot: Robot, target: PoseTarget) -> LinkPose:
        """Take a robot and its target. Raises InputError as `link_frame`."""
        frame = robot.model.frames[link_frame(robot, target.link, target.field)]
        return cls(robot, target, kinematics_of(robot), frame.parentJoint, frame.placement.homogeneous)

    def linearized(self, q: Array) -> tuple[Array, Array]:
        """The pose error (B, 6), translation [m] and rotation [rad] in world axes, and its Jacobian (B, 6, n)."""
        return self.towards(q, self.target.pose.matrix)

    def towards(self, q: Array, wanted: Array) -> tuple[Array, Array]:
        """This target with other poses in place of its own: one (4, 4), or one for each row (B, 4, 4)."""
        place = self.moving(self.arm.evaluate(self.robot.expand(q)))
        error, kept = off_pose(place, wanted, self.target.free_rotation)
        jacobian = np.concatenate([place.linear, kept(place.angular)], axis=2).transpose(0, 2, 1)
        return error, self.robot.fold(jacobian)

    def moving(self, state: KinematicsBatch) -> Moving:
        """Return the link's poses at B configurations, and its derivatives by the joints."""
        joint, rotations = self.joint, state.rotations[:, self.joint]
        origin = rotations @ self.placement[:3, 3] + state.translations[:, joint]
        moved = self.arm.supports[joint][:, None]
        linear = state.linear + np.cross(state.angular, origin[:, None])
        return Moving(rotations @ self.placement[:3, :3], origin, linear * moved, state.angular * moved)


class Moving(NamedTuple):
    """A frame in the world at B configurations, and its velocities for each joint's."""

    rotation: Array  # (B, 3, 3)
    origin: Array  # (B, 3) [m]
    linear: Array  # (B, n, 3) of the origin
    angular: Array  # (B, n, 3)


def off_pose(place: Moving, wanted: Array, free: str) -> tuple[Array, Callable[[Array], Array]]:
    """Return the error of a frame from a pose (4, 4) or (B, 4, 4): translation and rotation (B, 6) in world axes, and
    what of angular velocities (B, n, 3) changes that, with the rotations that are free."""
    kept: Callable[[Array], Array]
    if free == "all":
        turn, kept = np.zeros_like(place.origin), np.zeros_like
    elif free in AXES:
        axis = AXES.index(free)
        along = place.rotation[:, :, axis]
        turn, kept = _turn_between(along, wanted[..., :3, axis]), functools.partial(_across, along)
    else:
        turn, kept = vectors_of(wanted[..., :3, :3] @ place.rotation.transpose(0, 2, 1)), np.asarray
    return np.concatenate([wanted[..., :3, 3] - place.origin, turn], axis=1), kept


def _across(along: Array, turning: Array) -> Array:
    """Return the parts of angular velocities (B, n, 3) across directions (B, 3)."""
    return np.asarray(turning - (turning @ along[..., None]) * along[:, None])


class Aim(NamedTuple):
    """Poses that one configuration is to reach together, one for each of k links."""

    links: tuple[LinkPose, ...]
    tolerances: Array  # (k, 2) [m] and [rad]
    loops: inverse_loop.Loops | None  # in C; None without a compiler, and where joints follow others

    @classmethod
    def at(cls, robot: Robot, target: PoseTarget | AllOf) -> Aim:
        """Take a robot and its goal. Raises InputError as `link_frame`."""
        tolerances = [(pose.position_tolerance, pose.orientation_tolerance) for pose in target.poses]
        links = tuple(LinkPose.of(robot, pose) for pose in target.poses)
        return cls(links, np.array(tolerances), _loops(links, np.array(tolerances)))

    def elsewhere(self, target: PoseTarget | AllOf) -> Aim:
        """Return a copy with other poses for the same links, as freely turned."""
        links = tuple(link._replace(target=pose) for link, pose in zip(self.links, target.poses, strict=True))
        return Aim(links, self.tolerances, _loops(links, self.tolerances))

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.links[0].robot

    @property
    def arm(self) -> Kinematics:
        """Kinematics of the arm."""
        return self.links[0].arm

    @property
    def moving(self) -> Mask:
        """The joints (n,) that move one of the links."""
        supports = np.any([self.arm.supports[link.joint] for link in self.links], axis=0)
        return np.asarray(self.robot.fold(supports[None].astype(np.float64))[0] != 0.0)

    def linearized(self, q: Array) -> tuple[Array, Array]:
        """The pose errors (B, 6 k), one link after the other, and their Jacobian (B, 6 k, n)."""
        if self.loops:
            return self.loops.linearized(q)
        errors, jacobians = zip(*(link.linearized(q) for link in self.links), strict=True)
        return np.concatenate(errors, axis=1), np.concatenate(jacobians, axis=1)

    def sizes(self, error: Array) -> Array:
        """Distance [m] and angle [rad] of each link from its target (B, k, 2)."""
        return np.asarray(np.linalg.norm(self._parts(error), axis=3))

    def within(self, error: Array, share: float) -> Mask:
        """True if all errors are within a share of the tolerances (B,)."""
        return np.asarray((self.sizes(error) <= share * self.tolerances).all(axis=(1, 2)))

    def beyond(self, error: Array, share: float) -> Array:
        """The part of the errors (B, 6 k) beyond a share of the tolerances."""
        left = np.maximum(0.0, 1.0 - share * self.tolerances / np.maximum(self.sizes(error), 1e-300))
        return np.asarray(self._parts(error) * left[..., None]).reshape(error.shape)

    def _parts(self, error: Array) -> Array:
        return error.reshape(len(error), len(self.links), 2, 3)


def _loops(links: tuple[LinkPose, ...], tolerances: Array) -> inverse_loop.Loops | None:
    robot, arm = links[0].robot, links[0].arm
    if C is None or robot.linkage is not None:
        return None
    joints = np.array([link.joint for link in links], np.int64)
    freedoms = np.array([("x", "y", "z", "none", "all").index(link.target.free_rotation) for link in links], np.int64)
    placed, wanted = (
        placement_rows(np.array(matrices))
        for matrices in ([link.placement for link in links], [link.target.pose.matrix for link in links])
    )
    limits, rule = (tolerances.ravel(), robot.lower, robot.upper), np.array([PARALLEL_SINE, DAMPING, LONGEST_STEP])
    moved = arm.supports[joints].astype(np.int64)
    goal = Record("goal", arm.tree, joints, freedoms, moved, placed, wanted, *limits, rule)
    return inverse_loop.Loops(goal, len(links), arm.n)


def damped_step(robot: Robot, q: Array, error: Array, jacobian: Array, longest: float = LONGEST_STEP) -> Array:
    """One step of damped least squares from q (B, n), within the limits: error (B, m), jacobian (B, m, n); no joint
    moves by more than `longest`."""
    square = jacobian @ jacobian.transpose(0, 2, 1) + DAMPING**2 * np.eye(error.shape[1])
    step = np.einsum("bij,bi->bj", jacobian, np.linalg.solve(square, error[..., None])[..., 0])
    step *= np.minimum(1.0, longest / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
    moved: Array = np.clip(q + step, robot.lower, robot.upper)
    return moved


def self_motion(way: Array, jacobian: Array) -> Array:
    """The part of ways (B, n) that moves no link that counts, to first order: (I − J⁺ J) way, J (B, m, n), damped."""
    square = jacobian @ jacobian.transpose(0, 2, 1) + DAMPING**2 * np.eye(jacobian.shape[1])
    lost = np.linalg.solve(square, jacobian @ way[..., None])
    return np.asarray(way - (jacobian.transpose(0, 2, 1) @ lost)[..., 0])


def _turn_between(directions: Array, wanted: Array) -> Array:
    """The shortest rotations (B, 3) [rad] that take unit vectors (B, 3) to wanted ones, (3,) or (B, 3); a half turn for
    opposite ones."""
    cross = np.cross(directions, wanted)
    sine = np.linalg.norm(cross, axis=1, keepdims=True)
    across = np.cross(wanted, np.eye(3)[np.abs(wanted).argmin(axis=-1)])
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    axis = np.where(sine > PARALLEL_SINE, cross / np.maximum(sine, PARALLEL_SINE), across)
    cosine = np.sum(directions * wanted, axis=1, keepdims=True)
    turn: Array = axis * np.arctan2(sine, cosine)
    return turn
