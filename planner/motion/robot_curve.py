"""A trajectory's curve for one robot: joints matched by name, in the robot's order, within their limits, and locked
joints at rest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.planner.motion.curve import FARTHEST_VALUE, Curve, halves
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.errors import InputError, nearest

BEYOND_LIMIT = 1e-9  # [rad] or [m] by which a motion may be beyond a joint limit: rounding
MOST_HALVINGS = 40  # of an interval, to distinguish a curve that grazes a limit from one that passes it
SAME_LOCKED = 1e-6  # [rad] or [m] between a locked joint's value in trajectory and scene


def curve_of(robot: Robot, trajectory: Trajectory) -> Curve:
    """Return the trajectory's curve, with its joints in the order of the robot's planned ones.

    Locked joints must stay at the values at which the robot holds them, and joints that follow others must follow them.
    Raises InputError for joints that are missing, unknown or at another value.
    """
    names, curve = trajectory.joint_names, trajectory.curve
    if missing := [name for name in robot.joint_names if name not in names]:
        raise InputError(f"trajectory: joint '{missing[0]}' of {robot.name} is missing{nearest(missing[0], names)}")
    held: Mapping[str, ArrayLike] = {
        name: curve.control[:, :, column] for column, name in enumerate(names) if name not in robot.joint_names
    }
    for name, values in {**trajectory.locked, **held}.items():
        if name in robot.followers:
            continue
        if name not in robot.locked:
            known = (*robot.joint_names, *robot.followers, *robot.locked)
            raise InputError(f"trajectory: joint '{name}' is not one of {robot.name}{nearest(name, known)}")
        away = np.asarray(values) - robot.locked[name]
        if np.abs(away).max() > SAME_LOCKED:
            found = np.asarray(values).flat[np.abs(away).argmax()]
            raise InputError(
                f"trajectory: joint '{name}' is at {found:g}, the scene holds it at {robot.locked[name]:g}"
            )
    curve = curve.columns([names.index(name) for name in robot.joint_names])
    if robot.linkage is not None:
        every = zip(robot.linkage.names, np.moveaxis(robot.expand(curve.control), 2, 0), strict=True)
        _check_following({**trajectory.locked, **held}, dict(every))
    far = np.abs(curve.control)
    if far.max() > FARTHEST_VALUE:
        interval, point, joint = np.unravel_index(far.argmax(), far.shape)
        row = interval + (point == curve.degree)  # the last control point is the next waypoint's
        raise InputError(
            f"trajectory: waypoint {row}, joint '{robot.joint_names[joint]}': {far.max():g} exceeds {FARTHEST_VALUE:g}"
        )
    return curve


def unfolded_curve(robot: Robot, curve: Curve) -> Curve:
    """Return the curve of all joints of the model, those that follow others included: exact, as the control points of a
    polynomial follow as its values do. The curve itself where nothing follows."""
    return curve if robot.linkage is None else Curve(robot.expand(curve.control), curve.times)


def _check_following(given: Mapping[str, ArrayLike], every: Mapping[str, NDArray[np.float64]]) -> None:
    """Refuse what a trajectory says of joints that follow others where it is not that of `every` joint of the model."""
    for name in [name for name in given if name in every]:
        off = float(np.abs(np.asarray(given[name]) - every[name]).max())
        if not off <= SAME_LOCKED:
            raise InputError(f"trajectory: joint '{name}' is up to {off:g} from where it would follow other joints")


def beyond_limits(curve: Curve, robot: Robot) -> str | None:
    """Return the place, in words, at which a motion is beyond the position limits; None if there is none.

    A part of the curve lies within the hull of its control points, the first and last of which are on the curve. So a
    part whose hull exceeds a limit is halved, until a point on the curve exceeds it, or no hull does.
    """
    interval, control = np.arange(len(curve) - 1), curve.control  # (k,), (k, d + 1, n)
    for halving in range(MOST_HALVINGS + 1):
        excess = np.maximum(robot.lower - control, control - robot.upper)
        open_ = ~(excess <= BEYOND_LIMIT).all(axis=(1, 2))
        if not open_.any():
            return None
        if not (excess[:, [0, -1]] <= BEYOND_LIMIT).all() or halving == MOST_HALVINGS:
            break
        interval, control = np.repeat(interval[open_], 2), halves(control[open_])
    on_curve = excess[:, [0, -1]]
    part, end, joint = (int(i) for i in np.unravel_index(int(on_curve.argmax()), on_curve.shape))
    where = f"waypoint {interval[part] + end}" if not halving else f"the curve after waypoint {interval[part]}"
    return (
        f"{where} has joint '{robot.joint_names[joint]}' at {control[part, -end, joint]:.10g}, "
        f"its limits are [{robot.lower[joint]:g}, {robot.upper[joint]:g}]"
    )
