"""The poses of links, linearized, and the damped step that brings them closer to their targets.

Damped least squares, dq = Jᵀ (J Jᵀ + λ² I)⁻¹ e, within the joint limits, for many configurations at once (Nakamura &
Hanafusa, "Inverse kinematic solutions with singularity robustness", 1986). Free rotations are taken out of J and e.
`inverse_loop` has the same in C.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hdplan.distance.compiled.loops import Record, library
from hdplan.planner.geometry.rotations import vectors_of
from hdplan.planner.kinematics import inverse_loop
from hdplan.planner.kinematics.forward import Kinematics, kinematics_of
from hdplan.planner.robot.link_frame import AXES, link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.targets import AllOf, PoseTarget

DAMPING = 0.02  # λ: keeps steps short near a singular configuration
LONGEST_STEP = 0.4  # [rad] or [m] of one step of a joint
PARALLEL = 1e-9  # sine below which two directions define no axis


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
        return self.towards(q, self.target.pose.matrix[None])

    def towards(self, q: Array, wanted: Array) -> tuple[Array, Array]:
        """The same with other poses in the place of the target's: one (1, 4, 4), or one for each row (B, 4, 4)."""
        state, joint = self.arm.evaluate(self.robot.expand(q)), self.joint
        rotation = state.rotations[:, joint] @ self.placement[:3, :3]
        origin = state.rotations[:, joint] @ self.placement[:3, 3] + state.translations[:, joint]
        linear = state.linear + np.cross(state.angular, origin[:, None])
        turning = state.angular
        if self.target.free_rotation == "all":
            turn, turning = np.zeros_like(origin), np.zeros_like(turning)
        elif self.target.free_rotation in AXES:
            axis = AXES.index(self.target.free_rotation)
            along = rotation[:, :, axis]
            turn = _turn_between(along, wanted[:, :3, axis])
            turning = turning - (turning @ along[..., None]) * along[:, None]
        else:
            turn = vectors_of(wanted[:, :3, :3] @ rotation.transpose(0, 2, 1))
        moved = self.arm.supports[joint][:, None]
        jacobian = (np.concatenate([linear, turning], axis=2) * moved).transpose(0, 2, 1)
        return np.concatenate([wanted[:, :3, 3] - origin, turn], axis=1), self.robot.fold(jacobian)


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

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.links[0].robot

    @property
    def arm(self) -> Kinematics:
        """Its kinematics."""
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
        """How far each link is away [m], and turned away [rad] (B, k, 2)."""
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
    functions, robot, arm = library(), links[0].robot, links[0].arm
    if functions is None or robot.linkage is not None:
        return None
    joints = np.array([link.joint for link in links], np.int64)
    freedoms = np.array([("x", "y", "z", "none", "all").index(link.target.free_rotation) for link in links], np.int64)
    placed, wanted = (
        np.array([[*matrix[:3, :3].ravel(), *matrix[:3, 3]] for matrix in matrices])
        for matrices in ([link.placement for link in links], [link.target.pose.matrix for link in links])
    )
    limits, rule = (tolerances.ravel(), robot.lower, robot.upper), np.array([PARALLEL, DAMPING, LONGEST_STEP])
    moved = arm.supports[joints].astype(np.int64)
    goal = Record("goal", arm.tree, joints, freedoms, moved, placed, wanted, *limits, rule)
    return inverse_loop.Loops(functions, goal, len(links), arm.n)


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
    """The shortest rotations (B, 3) [rad] that take unit vectors (B, 3) to wanted ones (B, 3), or all to one (1, 3); a
    half turn for opposite ones."""
    cross = np.cross(directions, wanted)
    sine = np.linalg.norm(cross, axis=1, keepdims=True)
    across = np.cross(wanted, np.eye(3)[np.abs(wanted).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    axis = np.where(sine > PARALLEL, cross / np.maximum(sine, PARALLEL), across)
    turn: Array = axis * np.arctan2(sine, (directions * wanted).sum(axis=1, keepdims=True))
    return turn
