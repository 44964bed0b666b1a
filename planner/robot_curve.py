"""A trajectory's curve as one robot's: joints found by their names, in the robot's order, within their limits; joints
that the robot holds stand still."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from hdplan.planner.curve import Curve
from hdplan.planner.robot import Robot
from hdplan.planner.trajectory import Trajectory
from hdplan.scenes.errors import InputError, nearest

FARTHEST = 1e6  # [rad] or [m] beyond which a waypoint drowns in rounding
AT_LIMIT = 1e-3  # [rad] or [m] by which an end may lie beyond a joint limit: scenes sit on limits to rounding
BEYOND_LIMIT = 1e-9  # the same for all other waypoints
SAME_LOCKED = 1e-6  # [rad] or [m] between a locked joint's value in trajectory and scene


def curve_of(robot: Robot, trajectory: Trajectory) -> Curve:
    """Return the trajectory's curve, its joints in the order of the robot's planned ones.

    Joints that the robot holds must stand still at the value at which it holds them. Raises InputError for joints that
    are missing, unknown or held elsewhere.
    """
    names, curve = trajectory.joint_names, trajectory.curve
    if missing := [name for name in robot.joint_names if name not in names]:
        raise InputError(f"trajectory: joint '{missing[0]}' of {robot.name} is missing{nearest(missing[0], names)}")
    held: Mapping[str, ArrayLike] = {
        name: curve.control[:, :, column] for column, name in enumerate(names) if name not in robot.joint_names
    }
    for name, values in {**trajectory.locked, **held}.items():
        if name not in robot.locked:
            known = (*robot.joint_names, *robot.locked)
            raise InputError(f"trajectory: joint '{name}' is not one of {robot.name}{nearest(name, known)}")
        away = np.asarray(values) - robot.locked[name]
        if np.abs(away).max() > SAME_LOCKED:
            found = np.asarray(values).flat[np.abs(away).argmax()]
            raise InputError(
                f"trajectory: joint '{name}' is at {found:g}, the scene holds it at {robot.locked[name]:g}"
            )
    curve = curve.columns([names.index(name) for name in robot.joint_names])
    far = np.abs(curve.control)
    if far.max() > FARTHEST:
        interval, point, joint = np.unravel_index(far.argmax(), far.shape)
        row = interval + (point == curve.degree)  # the last control point is the next waypoint's
        raise InputError(
            f"trajectory: waypoint {row}, joint '{robot.joint_names[joint]}': {far.max():g} is larger than {FARTHEST:g}"
        )
    return curve


def beyond_limits(curve: Curve, robot: Robot) -> str | None:
    """Say where a motion is beyond the limits of position; None if it is not.

    Looks at the waypoints alone where straight lines join them: a box is convex, so they stay within the limits, too;
    or else at bounds of the curve after each.
    """
    straight = curve.degree == 1
    low, high = (curve.rows, curve.rows) if straight else curve.bounds()
    slack = np.full((len(low), 1), BEYOND_LIMIT)
    slack[[0, -1]] = AT_LIMIT
    below, above = robot.lower - low, high - robot.upper
    beyond = np.maximum(below, above) - slack
    row, joint = (int(i) for i in np.unravel_index(int(beyond.argmax()), beyond.shape))
    if beyond[row, joint] <= 0.0:
        return None
    found = low[row, joint] if below[row, joint] > above[row, joint] else high[row, joint]
    return (
        f"{'' if straight else 'the curve after '}waypoint {row} has joint '{robot.joint_names[joint]}' at "
        f"{found:g}, its limits are [{robot.lower[joint]:g}, {robot.upper[joint]:g}]"
    )
