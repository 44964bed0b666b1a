"""Trajectories as ROS messages: `trajectory_msgs/JointTrajectory`, and MoveIt's `RobotTrajectory` around it.

Each waypoint is a point with its `time_from_start`, in whole nanoseconds. A motion whose times are whole nanoseconds
loses nothing. Otherwise its curve is evaluated at the nearest nanoseconds, so that it stays the same motion: its rows,
except for the first and the last, move along it by at most half a nanosecond. A path without times has 0 at every
point, like MoveIt's paths before they are timed; a controller refuses it.

Joints that are held (`locked`) are not in the message. On reading, `effort` and the header are ignored, as they do not
say where the joints are; a mobile base is refused.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.scenes.errors import FieldError, InputError, nearest
from hdplan.scenes.values import Row, Whole, checked, describe, is_row, shorten, text, wrong

if TYPE_CHECKING:
    from hdplan.planner.motion.trajectory import Trajectory

NANOSECONDS = 10**9  # [ns]
MOST_SECONDS = 2**31 - 1  # in a builtin_interfaces/Duration
ROWS = ("positions", "velocities", "accelerations")
POINT = (*ROWS, "effort", "time_from_start")
UNITS = (("sec", "nanosec"), ("secs", "nsecs"))  # of a duration, in ROS 2 and in ROS 1
HEADER = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
TIME_ROUNDING = 4  # units in the last place: rounding errors of a time in whole nanoseconds


def joint_trajectory(trajectory: Trajectory) -> dict[str, Any]:
    """Return a trajectory_msgs/JointTrajectory message. Raises InputError for times that it cannot hold."""
    nanoseconds, rows = _at_nanoseconds(trajectory)
    lists = [(key, values.tolist()) for key, values in rows.items()]
    points = [
        {
            **{key: [] for key in POINT[:-1]},
            **{key: values[i] for key, values in lists},
            "time_from_start": dict(zip(UNITS[0], divmod(nanosecond, NANOSECONDS), strict=True)),
        }
        for i, nanosecond in enumerate(nanoseconds)
    ]
    return {"header": HEADER, "joint_names": list(trajectory.joint_names), "points": points}


def _at_nanoseconds(trajectory: Trajectory) -> tuple[list[int], dict[str, Any]]:
    """Return the times [ns] of the rows, and the rows there."""
    given = {key: values for key in ROWS if (values := getattr(trajectory, key)) is not None}
    times = trajectory.times
    if times is None:
        return [0] * len(trajectory), given
    if not (times[0] >= 0.0 and times[-1] <= MOST_SECONDS):
        raise InputError(
            f"times: {times[0]:g} s to {times[-1]:g} s, but ROS counts the time from the start, 0 to {MOST_SECONDS} s"
        )
    nanoseconds = np.rint(times * NANOSECONDS).astype(np.int64)
    if (same := np.flatnonzero(np.diff(nanoseconds) <= 0)).size:
        row = int(same[0])
        raise InputError(
            f"times: waypoints {row} and {row + 1} are {times[row + 1] - times[row]:g} s apart, but ROS counts whole "
            "nanoseconds"
        )
    rounded = nanoseconds / NANOSECONDS
    between = np.abs(rounded - times) > TIME_ROUNDING * np.spacing(times)
    between[[0, -1]] = False  # the ends are kept exactly, at rest
    if trajectory.velocities is not None and between.any():
        for order, key in enumerate(given):
            there = trajectory.curve.at_time(rounded[between], order)
            given[key] = given[key].copy()
            given[key][between] = there
    return nanoseconds.tolist(), given


def robot_trajectory(trajectory: Trajectory) -> dict[str, Any]:
    """Return a moveit_msgs/RobotTrajectory message. Raises InputError for times that it cannot hold."""
    multi = {"header": HEADER, "joint_names": [], "points": []}
    return {"joint_trajectory": joint_trajectory(trajectory), "multi_dof_joint_trajectory": multi}


def read_message(message: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the trajectory in a message of either kind. Raises InputError for another message, an
    unknown field, or values that make no trajectory."""
    if "joint_trajectory" in message:
        keys = _fields(message, ("joint_trajectory", "multi_dof_joint_trajectory"))
        base = keys.get("multi_dof_joint_trajectory") or {}
        if not isinstance(base, Mapping) or base.get("joint_names") or base.get("points"):
            raise FieldError("moves a base or floating joints, which is not supported", "multi_dof_joint_trajectory")
        return dict(checked(_joint_trajectory, keys["joint_trajectory"], "joint_trajectory"))
    if "points" not in message or "joint_names" not in message:
        raise InputError(
            "is neither a trajectory_msgs/JointTrajectory (joint_names, points) nor a moveit_msgs/RobotTrajectory "
            f"(joint_trajectory), found {shorten(', '.join(map(str, message))) or 'nothing'}"
        )
    return _joint_trajectory(message)


def _joint_trajectory(message: object) -> dict[str, Any]:
    keys = _fields(message, ("header", "joint_names", "points"))
    joints = checked(Row(text, of="joint names"), keys.get("joint_names"), "joint_names")
    points = keys.get("points")
    if not is_row(points) or not len(points):
        raise wrong("a list of points", points).within("points")
    read = [checked(_point, point, f"points[{i}]") for i, point in enumerate(points)]
    nanoseconds = [nanosecond for nanosecond, _ in read]
    found: dict[str, Any] = {"joint_names": joints}
    for key in ROWS:
        found[key] = _column(key, [rows[key] for _, rows in read], len(joints))
    found["times"] = [nanosecond / NANOSECONDS for nanosecond in nanoseconds] if any(nanoseconds) else None
    return found


def _column(key: str, rows: Sequence[list[float]], count: int) -> list[list[float]] | None:
    """Return one quantity of all points; None if no point has it."""
    if key != "positions" and not any(rows):
        return None
    for i, row in enumerate(rows):
        if len(row) != count:
            found = f"found {len(row)}" + " while others have some" * (not row and key != "positions")
            raise FieldError(f"must be {count} numbers, one for each of joint_names, {found}", f"points[{i}].{key}")
    return list(rows)


def _point(point: object) -> tuple[int, dict[str, list[float]]]:
    """Return when a point is reached [ns], and its numbers."""
    keys = _fields(point, POINT)
    return (
        checked(_nanoseconds, keys.get("time_from_start"), "time_from_start"),
        {key: checked(_numbers, keys.get(key), key) for key in ROWS},
    )


def _nanoseconds(duration: object) -> int:
    if duration is None:  # ROS fills in 0 for what is missing
        return 0
    ros1 = isinstance(duration, Mapping) and not duration.keys().isdisjoint(UNITS[1])
    seconds, nanoseconds = UNITS[1] if ros1 else UNITS[0]
    keys = _fields(duration, (seconds, nanoseconds))
    return int(
        checked(Whole(0, MOST_SECONDS), keys.get(seconds, 0), seconds) * NANOSECONDS
        + checked(Whole(0, NANOSECONDS - 1), keys.get(nanoseconds, 0), nanoseconds)
    )


def _numbers(values: object) -> list[float]:
    if values is None:
        return []
    if not is_row(values):
        raise wrong("a list of numbers", values)
    return [_number(value, i) for i, value in enumerate(values)]


def _number(value: object, i: int) -> float:
    """Return a finite number; C++ writes 1e-05, which YAML 1.1 reads as text."""
    try:
        if not isinstance(value, bool) and math.isfinite(number := float(value)):  # type: ignore[arg-type]
            return number
    except (TypeError, ValueError, OverflowError):
        pass
    raise wrong("a finite number", value).within(f"[{i}]")


def _fields(message: object, allowed: Collection[str]) -> Mapping[str, Any]:
    if not isinstance(message, Mapping):
        raise FieldError(f"must be a mapping with the keys {', '.join(allowed)}, found {describe(message)}")
    for key in message:
        if key not in allowed:
            raise FieldError(f"unknown key {shorten(repr(key))}{nearest(str(key), allowed)}")
    return message
