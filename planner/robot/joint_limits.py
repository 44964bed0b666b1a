"""What each joint can do, as arrays: the scene's `limits` section, resolved against the robot's URDF.

Scene and robot -> one value for each planned joint, in their order, or None where the scene does not call for it. Units
are those of the joint: rad, or m where it slides; Nm or N.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import InputError
from hdplan.scenes.limits import JointValues
from hdplan.scenes.scene import Scene

Array = NDArray[np.float64]

RATES = ("velocity", "acceleration", "jerk")  # the first three derivatives of a joint's value by time


def velocity_limits(scene: Scene, robot: Robot) -> Array | None:
    """Return the greatest speeds (n,) [rad/s or m/s]: the scene's, or the URDF's as soon as the motion is timed.

    Raises:
        InputError: wrong number of values, unknown names, or a value that neither scene nor URDF gives.
    """
    given = scene.limits.velocity
    return _resolved("velocity", "urdf" if given is None and scene.timed else given, scene, robot)


def acceleration_limits(scene: Scene, robot: Robot) -> Array | None:
    """Return the greatest accelerations (n,) [rad/s² or m/s²], None if the scene gives none; raises as above."""
    return _resolved("acceleration", scene.limits.acceleration, scene, robot)


def jerk_limits(scene: Scene, robot: Robot) -> Array | None:
    """Return the greatest jerks (n,) [rad/s³ or m/s³], None if the scene gives none; raises as above."""
    return _resolved("jerk", scene.limits.jerk, scene, robot)


def rate_limits(scene: Scene, robot: Robot) -> tuple[Array | None, Array | None, Array | None]:
    """Return the limits of all RATES, in their order; raises as above."""
    return velocity_limits(scene, robot), acceleration_limits(scene, robot), jerk_limits(scene, robot)


def torque_limits(scene: Scene, robot: Robot) -> Array | None:
    """Return the greatest torques or forces (n,) [Nm or N], None if the scene gives none; raises as above."""
    return _resolved("torque", scene.limits.torque, scene, robot)


def _resolved(quantity: str, given: JointValues | None, scene: Scene, robot: Robot) -> Array | None:
    if given is None:
        return None
    where, joints = f"{scene.source}: limits.{quantity}", robot.joint_names
    if isinstance(given, float):
        return np.full(robot.n, given)
    if isinstance(given, tuple):
        if len(given) != robot.n:
            raise InputError(
                f"{where}: {len(given)} values, but {robot.name} plans {robot.n} joints: {', '.join(joints)}"
            )
        return np.array(given)
    result = np.full(robot.n, np.nan)
    for joint, value in given.items() if isinstance(given, Mapping) else ():
        result[robot.index_of(joint, where)] = value
    for i in np.flatnonzero(np.isnan(result)).tolist():
        result[i] = _of_urdf(quantity, i, robot, where)
    return result


def _of_urdf(quantity: str, index: int, robot: Robot, where: str) -> float:
    """Return what the URDF says of a planned joint; joint i is coordinate i of the model's tangent space."""
    in_urdf = {"velocity": robot.model.velocityLimit, "torque": robot.model.effortLimit}
    joint = robot.joint_names[index]
    if quantity not in in_urdf:
        raise InputError(f"{where}: no value for joint '{joint}', and a URDF holds none: give all {robot.n} joints one")
    value = float(in_urdf[quantity][index])
    if not 0.0 < value < np.inf:
        raise InputError(f"{where}: the URDF gives joint '{joint}' no limit (found {value:g}): give it one by name")
    return value
