"""ROS messages of a trajectory as YAML, as accepted by `ros2 topic pub` and printed by `ros2 topic echo`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from hdplan.planner.motion.ros_message import ROWS, joint_trajectory, read_message, robot_trajectory
from hdplan.planner.motion.ros_stages import refuse_stages
from hdplan.scenes.errors import InputError
from hdplan.scenes.yaml_text import flow_style
from hdplan.scenes.yaml_values import MOST_VALUES, read_mapping

if TYPE_CHECKING:
    from hdplan.planner.motion.trajectory import Trajectory

FURTHER_VALUES = 16  # further values in a point, beside its rows: keys, durations, lists


def write_joint_trajectory(trajectory: Trajectory, _: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Return a trajectory_msgs/JointTrajectory. Raises InputError for a trajectory that it cannot hold."""
    _check_trajectory(trajectory)
    return "\n".join(["# trajectory_msgs/msg/JointTrajectory", *_lines(joint_trajectory(trajectory)), ""]).encode()


def write_robot_trajectory(trajectory: Trajectory, _: Mapping[str, Mapping[str, Any]]) -> bytes:
    """Return a moveit_msgs/RobotTrajectory. Raises InputError for a trajectory that it cannot hold."""
    _check_trajectory(trajectory)
    inner, base = robot_trajectory(trajectory).values()
    lines = [
        "# moveit_msgs/msg/RobotTrajectory",
        "joint_trajectory:",
        *(f"  {line}" for line in _lines(inner)),
        f"multi_dof_joint_trajectory: {flow_style(base)}",
        "",
    ]
    return "\n".join(lines).encode()


def _lines(message: Mapping[str, Any]) -> list[str]:
    """Return a JointTrajectory, one line per point; in brackets, so that a truncated file is not read as a shorter
    motion."""
    points = ",\n".join(f"  {flow_style(point)}" for point in message["points"]).split("\n")
    return [*(f"{key}: {flow_style(message[key])}" for key in ("header", "joint_names")), "points: [", *points, "  ]"]


def check_size(waypoints: int, joints: int, rows: int = len(ROWS)) -> None:
    """Raise InputError for a motion that could not be read again: so many waypoints, each with `rows` rows of values
    for its `joints`: positions, and velocities and accelerations if there are times."""
    count = waypoints * (rows * joints + FURTHER_VALUES)
    if count > MOST_VALUES:
        raise InputError(
            f"{waypoints} waypoints are {count} values, at most {MOST_VALUES} are read as YAML: write .mcap"
        )


def _check_trajectory(trajectory: Trajectory) -> None:
    refuse_stages(trajectory)
    rows = sum(getattr(trajectory, key) is not None for key in ROWS)
    check_size(len(trajectory), len(trajectory.joint_names), rows)


def read_ros_yaml(data: bytes) -> dict[str, Any]:
    """Return the fields of the trajectory in a file; its keys determine the type of message.

    Raises InputError saying what is wrong.
    """
    return read_message(read_mapping(data))
