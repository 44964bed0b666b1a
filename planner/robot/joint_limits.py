"""Joint limits as arrays: the scene's `limits` section, resolved with the robot's URDF.

Scene and robot -> one value for each planned joint, in their order, of every quantity that the scene limits. Units are
those of the joint: rad, or m for a prismatic one; Nm or N.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.tracking import tracking_of_all
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.limits import QUANTITIES, JointValues
from hdplan.scenes.scene import Scene

DERIVATIVES = {name: rate.order for name, rate in QUANTITIES.items() if rate.order is not None}
"""Velocity, acceleration and jerk: the order of the time derivative that each is."""


def joint_limits(scene: Scene, robot: Robot) -> dict[str, Array]:
    """Return the greatest absolute values (n,) that a scene allows, for every quantity that it limits, by name:
    `limits_of_all`, those of the planned joints lower where what follows them needs it.

    Raises:
        InputError: wrong number of values, unknown names, or a value that neither scene nor URDF gives.
    """
    found = limits_of_all(scene, robot)
    return found if robot.linkage is None else {name: robot.linkage.tightest(most) for name, most in found.items()}


def limits_of_all(scene: Scene, robot: Robot) -> dict[str, Array]:
    """Return the greatest absolute values (m,) of all joints of the model, infinite for none. Velocities are limited as
    soon as the motion is timed, by the URDF's values if the scene has no others.

    Joints that follow others are kept within limits, too: within one number for all joints, or else within the URDF's
    own values, if it has any. Raises InputError as `joint_limits`.
    """
    found = {quantity: _resolved(quantity, given, scene, robot) for quantity, given in requested_limits(scene).items()}
    if robot.linkage is not None:
        found = {quantity: _with_followers(quantity, most, scene, robot) for quantity, most in found.items()}
    if "velocity" in found and scene.robot.tracking is not None:
        found["velocity"] = _less_lag(found["velocity"], scene, robot)
    return found


def _less_lag(most: Array, scene: Scene, robot: Robot) -> Array:
    """Return velocities (m,) of a motion, less than `most` by what the joints' own may be off. Raises InputError where
    that leaves none."""
    lag = tracking_of_all(scene, robot, "velocity")
    if (gone := ~(lag < most)).any():
        i = int(gone.argmax())
        raise InputError(
            f"{scene.source}: robot.tracking.velocity: {lag[i]:g} of joint '{robot.model.names[i + 1]}' leaves nothing "
            f"of its limit {most[i]:g}"
        )
    return most - lag


def requested_limits(scene: Scene) -> dict[str, JointValues]:
    """Return a scene's entry for each quantity that it limits, by name."""
    given = {quantity: getattr(scene.limits, quantity) for quantity in QUANTITIES}
    if scene.timed and given["velocity"] is None:
        given["velocity"] = "urdf"
    return {quantity: values for quantity, values in given.items() if values is not None}


def _resolved(quantity: str, given: JointValues, scene: Scene, robot: Robot) -> Array:
    where = f"{scene.source}: limits.{quantity}"
    if isinstance(given, float):
        return np.full(robot.n, given)
    if isinstance(given, tuple):
        return robot.one_each(given, where)
    result = np.full(robot.n, np.nan)
    for joint, value in given.items() if isinstance(given, Mapping) else ():
        if scene.from_request and joint in robot.locked:  # a request's limits are of whole robots; it stands still
            continue
        result[robot.index_of(joint, where)] = value
    for i in np.flatnonzero(np.isnan(result)).tolist():
        result[i] = _of_urdf(quantity, i, robot, where)
    return result


def _with_followers(quantity: str, most: Array, scene: Scene, robot: Robot) -> Array:
    """Return the limits (m,) of planned joints, `most` (n,), and of those that follow them. Raises InputError for
    torques: nothing says how a linkage shares them."""
    assert robot.linkage is not None
    if quantity not in DERIVATIVES:
        raise InputError(f"{scene.source}: limits.{quantity}: {robot.linkage.no_torques}")
    every = np.full(robot.model.nv, np.inf)
    if isinstance(given := requested_limits(scene)[quantity], float):
        every[:] = given
    elif quantity == "velocity":
        every = _velocities_of_all(robot)
    every[robot.coordinates] = most
    return every


def urdf_velocities(robot: Robot) -> Array:
    """Return the greatest speeds (n,) that the URDF gives the planned joints, and what follows them; a follower without
    a limit has none."""
    every = _velocities_of_all(robot)
    return every if robot.linkage is None else robot.linkage.tightest(every)


def _velocities_of_all(robot: Robot) -> Array:
    """Return the URDF's greatest speeds (m,) of all joints of the model, infinite for followers without a limit."""
    every = np.array(robot.model.velocityLimit)
    return every if robot.linkage is None else np.where(robot.linkage.follows & ~(every > 0.0), np.inf, every)


def _of_urdf(quantity: str, index: int, robot: Robot, where: str) -> float:
    """Return the URDF's limit of a planned joint."""
    in_urdf = {"velocity": robot.model.velocityLimit, "torque": robot.model.effortLimit}
    joint = robot.joint_names[index]
    if quantity not in in_urdf:
        raise InputError(f"{where}: no value for joint '{joint}', and a URDF has none: give all {robot.n} joints one")
    value = float(in_urdf[quantity][robot.coordinates[index]])
    if not 0.0 < value < np.inf:
        raise InputError(f"{where}: the URDF gives joint '{joint}' no limit (found {value:g}): give it one by name")
    return value
