"""Inverse dynamics of a robot, as a CasADi expression and as fast NumPy batches.

    τ = M(q) q̈ + C(q, q̇) q̇ + g(q)

by the recursive Newton-Euler algorithm (R. Featherstone, "Rigid body dynamics algorithms", 2008, table 5.1), over the
tree of a fixed-base pin.Model as in `forward`: accelerations outwards, forces inwards, in each joint's axes. Gravity is
the model's, given in the world frame, however the base is mounted. There is no friction, as in Pinocchio's rnea.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.kinematics.forward import constant, rotation_about
from hdplan.planner.robot.loads import with_loads
from hdplan.planner.robot.pin_model import motion_axes
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.errors import naming
from hdplan.scenes.once import made_once

Spatial = tuple[ca.SX, ca.SX]  # linear and angular part of a motion; or a force and its moment about the origin


@dataclass(frozen=True)
class PathTorques:
    """Torques τ = a ü + b u̇² + c along a path q(u), at B of its points; [Nm] or [N] per unit of u's rates."""

    a: Array  # (B, n) M(q) q'
    b: Array  # (B, n) M(q) q'' + C(q, q') q'
    c: Array  # (B, n) g(q)


class InverseDynamics:
    """Inverse dynamics of one model; `function` for CasADi graphs, `torques` for NumPy batches.

    Attributes:
        n: number of coordinates.
        function: CasADi Function (q, v, a) each (n,) -> tau (n,) [Nm] or [N], of joint values, velocities and
            accelerations.
    """

    def __init__(self, model: pin.Model) -> None:
        """Build the expression of a model whose joints have one coordinate each, and compile it."""
        self.n = int(model.nv)
        q, v, a = (ca.SX.sym(name, self.n) for name in "qva")
        tau = inverse_dynamics(model, q, v, a)
        self.function = ca.Function("inverse_dynamics", [q, v, a], [tau], ["q", "v", "a"], ["tau"])
        self._rows = RowFunction(self.function)

    def torques(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return τ (B, n) for joint values, velocities and accelerations (B, n) each."""
        tables = [np.atleast_2d(np.asarray(values, dtype=np.float64)) for values in (q, v, a)]
        rows = np.arange(len(tables[0]))
        return self._rows(tables, [rows, rows, rows])[0]

    def coefficients(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> PathTorques:
        """Return the torques along a path q(u) as a function of u's own rates: exact, as τ is affine in q̈ and
        quadratic in q̇.

        q, dq, ddq: points q(u), q'(u), q''(u) of the path (B, n).
        """
        q, dq, ddq = (np.atleast_2d(np.asarray(values, dtype=np.float64)) for values in (q, dq, ddq))
        count = len(q)
        rows, still = np.arange(count), np.full(count, count)  # the tables' last row is zero
        rates = [np.vstack([values, np.zeros(self.n)]) for values in (dq, np.vstack([dq, ddq]))]
        (found,) = self._rows(
            [q, *rates],
            [
                np.tile(rows, 3),
                np.concatenate([still, still, rows]),
                np.concatenate([still + count, rows, rows + count]),
            ],
        )
        gravity, along, bent = found.reshape(3, count, self.n)
        return PathTorques(a=along - gravity, b=bent - gravity, c=gravity)


def dynamics_of(setup: Setup) -> InverseDynamics:
    """Return the dynamics of a scene's robot with its loads: built once for each, as that takes time.

    Raises InputError for loads that do not fit the robot.
    """
    scene = setup.scene
    with naming(scene.source):
        return _loaded_dynamics(setup.robot, scene.payload, scene.attached)


@made_once(8)
def _loaded_dynamics(robot: Robot, payload: Payload | None, attached: tuple[Attached, ...]) -> InverseDynamics:
    return InverseDynamics(with_loads(robot, payload, attached))


def inverse_dynamics(model: pin.Model, q: ca.SX, v: ca.SX | ca.DM, a: ca.SX | ca.DM) -> ca.SX:
    """Return τ (n,) as an expression in joint values, velocities and accelerations (n,); with structural zeros for v
    and a it is the gravity torque alone."""
    count = int(model.njoints)
    parents = [int(parent) for parent in model.parents]
    still: Spatial = (ca.SX(3, 1), ca.SX(3, 1))
    upwards: Spatial = (
        ca.SX(constant(-np.asarray(model.gravity.linear))),
        still[1],
    )  # of the world, in place of gravity
    velocity, acceleration, axes = [still], [upwards], [still]
    turns, offsets = [ca.SX.eye(3)], [still[0]]
    for index in range(1, count):
        at, parent, placement = int(model.joints[index].idx_v), parents[index], model.jointPlacements[index]
        slide, axis = motion_axes(model.joints[index])
        turn, offset = ca.SX(constant(placement.rotation)), ca.SX(constant(placement.translation))
        if np.any(axis):
            turn = turn @ rotation_about(axis, q[at])
        else:
            offset = offset + turn @ constant(slide) * q[at]
        slides, turning = ca.SX(constant(slide)), ca.SX(constant(axis))
        linear, angular = _carried(velocity[parent], turn, offset)
        pushed, spun = _carried(acceleration[parent], turn, offset)
        along, about = slides * v[at], turning * v[at]
        velocity.append((linear + along, angular + about))
        acceleration.append(
            (
                pushed + slides * a[at] + ca.cross(angular, along) + ca.cross(linear, about),
                spun + turning * a[at] + ca.cross(angular, about),
            )
        )
        axes.append((slides, turning))
        turns.append(turn)
        offsets.append(offset)
    forces = [still] + [_force(model.inertias[i], velocity[i], acceleration[i]) for i in range(1, count)]
    torques: dict[int, ca.SX] = {}
    for index in range(count - 1, 0, -1):
        at, parent = int(model.joints[index].idx_v), parents[index]
        force, moment = forces[index]
        slides, turning = axes[index]
        torques[at] = ca.dot(slides, force) + ca.dot(turning, moment) + float(model.armature[at]) * a[at]
        force = turns[index] @ force
        moment = turns[index] @ moment + ca.cross(offsets[index], force)
        forces[parent] = (forces[parent][0] + force, forces[parent][1] + moment)
    return ca.densify(ca.vertcat(*(torques[at] for at in range(len(torques)))))


def _carried(motion: Spatial, turn: ca.SX, offset: ca.SX) -> Spatial:
    """Return a parent's velocity or acceleration at its child's origin, in the child's axes."""
    linear, angular = motion
    return turn.T @ (linear + ca.cross(angular, offset)), turn.T @ angular


def _force(inertia: pin.Inertia, velocity: Spatial, acceleration: Spatial) -> Spatial:
    """Return the force and the moment about the frame's origin for such a motion of a body: I a + v ×* I v."""
    mass, lever, about = float(inertia.mass), ca.SX(constant(inertia.lever)), constant(inertia.inertia)

    def momentum(rate: Spatial) -> Spatial:
        linear = mass * (rate[0] - ca.cross(lever, rate[1]))
        return linear, about @ rate[1] + ca.cross(lever, linear)

    linear, angular = velocity
    force, moment = momentum(acceleration)
    impulse, spin = momentum(velocity)
    return force + ca.cross(angular, impulse), moment + ca.cross(angular, spin) + ca.cross(linear, impulse)
