"""Forward kinematics of a robot, as CasADi expressions and as fast NumPy batches.

From the joint placements and motion axes of a fixed-base pin.Model whose joints have one coordinate each. The PyPI
wheel of Pinocchio has no CasADi types, so the tree is traversed here: with X_i the fixed placement of joint i on its
parent p(i) and a_i its axis, T_i(q) = T_p(i)(q) X_i exp(a_i q_i). All in the world frame, [m] and [rad].
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from hdplan.distance.compiled.loops import C, Record, twin_of
from hdplan.planner.robot.pin_model import motion_axes
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import freeze, made_once


@dataclass(frozen=True)
class KinematicsBatch:
    """The kinematics of B configurations; nj joints (joint 0 is the world), n coordinates.

    A point p (world frame) carried by joint i has velocity sum_j supports[i, j] (linear[j] + angular[j] x p) dq_j.
    """

    placements: Array  # (B, nj, 12) world from joint: the rotation row by row, then the joint's origin [m]
    columns: Array  # (B, n, 6) per unit of each joint's speed: velocity of the world's origin, angular velocity

    @property
    def rotations(self) -> Array:
        """World from joint (B, nj, 3, 3)."""
        return self.placements[..., :9].reshape(*self.placements.shape[:2], 3, 3)

    @property
    def translations(self) -> Array:
        """Joint origins (B, nj, 3) [m]."""
        return self.placements[..., 9:]

    @property
    def linear(self) -> Array:
        """Velocity of the world's origin (B, n, 3) per unit of each joint's speed."""
        return self.columns[..., :3]

    @property
    def angular(self) -> Array:
        """Angular velocity (B, n, 3) per unit of each joint's speed."""
        return self.columns[..., 3:]


def _forward(kinematics: Kinematics, values: Array) -> tuple[Array, Array]:
    batch, n = values.shape
    placements, columns = np.empty((batch, kinematics.nj, 12)), np.empty((batch, n, 6))
    C.forward(kinematics.tree.struct, values, placements, columns)
    return placements, columns


class Kinematics:
    """Kinematics of one model; `function` for CasADi graphs, `evaluate` for NumPy batches, from any thread.

    Attributes:
        n: number of coordinates, those of joints that follow others included. nj: number of joints, world included.
        supports: (nj, n) True where coordinate j moves joint i.
        function: CasADi Function q (n,) -> R (3, 3 nj), the rotations side by side, and t (3, nj).
        tree: the same for the loops of C.
        state: CasADi Function q (n,) -> one vector: placements (nj, 12) and columns (n, 6), row by row, as in
            KinematicsBatch.
    """

    def __init__(self, model: pin.Model) -> None:
        """Build the expressions of a model whose joints have one coordinate each."""
        self.n, self.nj = int(model.nv), int(model.njoints)
        self.supports = np.zeros((self.nj, self.n), dtype=np.bool_)
        q = ca.SX.sym("q", self.n)
        rotations, translations = [ca.SX.eye(3)], [ca.SX.zeros(3, 1)]
        linear, angular = [], []
        parents, coordinates, turns, placed, axes = [], [], [], [], []
        for index in range(1, self.nj):
            parent, placement = int(model.parents[index]), model.jointPlacements[index]
            at = int(model.joints[index].idx_v)
            self.supports[index] = self.supports[parent]
            self.supports[index, at] = True
            rotation = rotations[parent] @ constant(placement.rotation)
            translation = translations[parent] + rotations[parent] @ constant(placement.translation)
            slide, axis = motion_axes(model.joints[index])
            parents.append(parent)
            coordinates.append(at)
            turns.append(bool(np.any(axis)))
            placed.append([*_rounded(placement.rotation).ravel(), *_rounded(placement.translation)])
            axes.append(_rounded(axis if turns[-1] else slide))
            if turns[-1]:
                direction = rotation @ constant(axis)
                linear.append(ca.cross(translation, direction))
                angular.append(direction)
                rotation = rotation @ rotation_about(axis, q[at])
            else:
                direction = rotation @ constant(slide)
                linear.append(direction)
                angular.append(ca.SX.zeros(3, 1))
                translation = translation + direction * q[at]
            rotations.append(rotation)
            translations.append(translation)
        counts = (np.array(each, np.int64) for each in (parents, coordinates, turns))
        places = (np.array(each, np.float64).reshape(self.nj - 1, -1) for each in (placed, axes))
        self.tree = Record("tree", self.nj, self.n, *counts, *places)
        freeze(self)
        side_by_side, origins = ca.densify(ca.horzcat(*rotations)), ca.densify(ca.horzcat(*translations))
        self.function = ca.Function("placements", [q], [side_by_side, origins], ["q"], ["R", "t"])
        placements = [
            part
            for rotation, origin in zip(rotations, translations, strict=True)
            for part in (ca.vec(rotation.T), origin)
        ]
        columns = [part for pair in zip(linear, angular, strict=True) for part in pair]
        self.state = ca.Function("state", [q], [ca.densify(ca.vertcat(*placements, *columns))], ["q"], ["state"])
        self._maps: dict[int, _MappedState] = {}

    def __getstate__(self) -> dict[str, Any]:
        """The state for another process, whose threads make their own buffers."""
        return vars(self) | {"_maps": {}}

    def evaluate(self, q: ArrayLike) -> KinematicsBatch:
        """Return the kinematics at values q (B, n) of all joints of the model, or at one (n,) as a batch of one; of a
        robot's configurations these are `Robot.expand`."""
        values = np.atleast_2d(np.ascontiguousarray(q, dtype=np.float64))
        if values.shape[1] != self.n:  # the loops would read beyond it
            raise ValueError(f"{values.shape[1]} joint values, but the model has {self.n} joints")
        return KinematicsBatch(*self._state(values))

    @twin_of(_forward)
    def _state(self, values: Array) -> tuple[Array, Array]:
        """Placements (B, nj, 12) and columns (B, n, 6)."""
        count = len(values)
        capacity = 1 << max(count - 1, 0).bit_length()  # powers of two, so that there are few buffers
        mapped = self._maps.get(capacity)
        if mapped is None:
            mapped = self._maps[capacity] = _MappedState(self.state.map(capacity))
        flat = mapped(values)
        placements, columns = flat[:, : 12 * self.nj], flat[:, 12 * self.nj :]
        return placements.reshape(count, self.nj, 12), columns.reshape(count, self.n, 6)


class _MappedState(threading.local):
    """A Function mapped over a fixed number of columns, evaluated in place on arrays that each thread makes for itself
    on its first call.

    CasADi's conversion of DM to NumPy takes some 70 times as long as the evaluation; its buffers use our memory
    directly.
    """

    def __init__(self, mapped: ca.Function) -> None:
        buffer: Any
        buffer, run = mapped.buffer()
        given, found = np.zeros(mapped.nnz_in(0)), np.zeros((mapped.size2_out(0), mapped.size1_out(0)))
        buffer.set_arg(0, given.data)
        buffer.set_res(0, found.data)
        self._own = given, run, found
        self._alive = (mapped, buffer)

    def __call__(self, values: Array) -> Array:
        """Return the outputs (B, m) for inputs (B, n), B at most the number of columns."""
        given, run, found = self._own
        given[: values.size] = values.ravel()
        run()
        return found[: len(values)].copy()


def constant(values: Array) -> ca.DM:
    """Return a constant without its rounding noise: exact zeros keep the expressions sparse."""
    return ca.sparsify(ca.DM(_rounded(values)))


def _rounded(values: Array) -> Array:
    return np.asarray(np.round(values, 15), dtype=np.float64)


def rotation_about(axis: Array, angle: ca.SX) -> ca.SX:
    """Return Rodrigues' formula a a^T + cos(angle) (I - a a^T) + sin(angle) [a]x for the unit axis a."""
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    outer = np.outer(axis, axis)
    return constant(outer) + ca.cos(angle) * constant(np.eye(3) - outer) + ca.sin(angle) * constant(cross)


@made_once(8)
def kinematics_of(robot: Robot) -> Kinematics:
    """Return the kinematics of a robot, the same object for the same robot."""
    return Kinematics(robot.model)
