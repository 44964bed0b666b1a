"""A motion executed by a simulated robot: forward dynamics under computed-torque control, with saturated torques.

The controller samples the motion a thousand times a second, as a real one would, and commands

    τ = M(q_d) (q̈_d + ω² e + 2 ω ė) + C(q_d, q̇_d) q̇_d + g(q_d),   e = q_d − q

with the reference in the middle of the step, and the error measured at its beginning. The torque is held over the step;
the motion is integrated with Pinocchio's articulated-body algorithm and the fourth-order Runge-Kutta method. No
friction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array

LONGEST_STEP = 1e-3  # [s] at most
FREQUENCY = 100.0  # ω [rad/s] of the controller, critically damped
LOST_ERROR = 1e-2  # [rad] or [m] tracking error beyond which tracking is lost and the execution ends


@dataclass(frozen=True, eq=False)
class Execution:
    """The executed motion, at the beginnings of k steps and at the end of the last."""

    times: Array  # (k + 1,) [s]
    positions: Array  # (k + 1, n)
    errors: Array  # (k + 1, n) tracking errors e [rad] or [m]
    commanded: Array  # (k, n) commanded τ [Nm] or [N], before saturation at the limits
    lost: bool  # whether it ended before the motion did, as tracking was lost
    velocity_errors: Array  # (k + 1, n) ė [rad/s] or [m/s]

    @property
    def step(self) -> float:
        """Duration of a step [s]."""
        return float(self.times[1] - self.times[0])


class Arm:
    """A robot with its loads, moved by torques."""

    def __init__(self, model: pin.Model, robot: Robot) -> None:
        """Take the model with all loads (`loads.loaded_model`) and its robot, for the order of joints."""
        self.model, self.data, self.robot = model, model.createData(), robot
        self.plain = model.nq == model.nv  # joint values are Pinocchio's configuration: the usual case, and faster

    def needed(self, q: Array, v: Array, a: Array) -> Array:
        """Return the torques (n,) for accelerations a (n,) at q and v (n,)."""
        return np.asarray(pin.rnea(self.model, self.data, self._configuration(q), v, a)).copy()

    def moved(self, q: Array, v: Array, torque: Array, step: float) -> tuple[Array, Array]:
        """Return joint values and velocities (n,) after a step with a constant torque (n,)."""

        def pushed(values: Array, speed: Array) -> Array:
            return np.asarray(pin.aba(self.model, self.data, self._configuration(values), speed, torque)).copy()

        half = 0.5 * step
        v1, a1 = v, pushed(q, v)
        v2 = v + half * a1
        a2 = pushed(q + half * v1, v2)
        v3 = v + half * a2
        a3 = pushed(q + half * v2, v3)
        v4 = v + step * a3
        a4 = pushed(q + step * v3, v4)
        return q + step / 6 * (v1 + 2 * v2 + 2 * v3 + v4), v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)

    def energy(self, q: Array, v: Array) -> float:
        """Return kinetic and potential energy [J]."""
        return float(pin.computeMechanicalEnergy(self.model, self.data, self._configuration(q), v))

    def _configuration(self, q: Array) -> Array:
        return q if self.plain else self.robot.pin_q(q)


def execute(arm: Arm, curve: Curve, limits: Array) -> Execution:
    """Execute a curve of the robot's planned joints with torques of at most `limits` (n,) [Nm] or [N].

    The curve must have times; the robot starts on it, with its velocity.
    """
    count = max(int(np.ceil(curve.widths.sum() / LONGEST_STEP - 1e-9)), 1)
    times = np.linspace(*_span(curve), count + 1)
    wanted, wanted_speed = (curve.at_time(times, order) for order in range(2))
    middle = 0.5 * (times[:-1] + times[1:])
    q_d, v_d, a_d = (curve.at_time(middle, order) for order in range(3))
    step, stiffness, damping = times[1] - times[0], FREQUENCY**2, 2 * FREQUENCY
    q, v = wanted[0], wanted_speed[0]
    positions, errors, velocity_errors, commanded = [q], [np.zeros_like(q)], [np.zeros_like(q)], []
    for k in range(count):
        push = a_d[k] + stiffness * errors[-1] + damping * (wanted_speed[k] - v)
        commanded.append(arm.needed(q_d[k], v_d[k], push))
        q, v = arm.moved(q, v, np.clip(commanded[-1], -limits, limits), float(step))
        positions.append(q)
        errors.append(wanted[k + 1] - q)
        velocity_errors.append(wanted_speed[k + 1] - v)
        if not np.abs(errors[-1]).max() <= LOST_ERROR:
            break
    done = len(positions)
    lost = bool(np.abs(errors[-1]).max() > LOST_ERROR)
    return Execution(
        times[:done], np.array(positions), np.array(errors), np.array(commanded), lost, np.array(velocity_errors)
    )


def _span(curve: Curve) -> tuple[float, float]:
    if curve.times is None:
        raise ValueError("a path without times cannot be executed")
    return float(curve.times[0]), float(curve.times[-1])
