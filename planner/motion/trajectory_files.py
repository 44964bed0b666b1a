"""The formats of trajectory files, by the endings of their names: this table is the one list of them.

| ending | what it holds |
|---|---|
| .json | everything, to the last bit; what else there is to say beside it (`verdict`, `steps`) |
| .npz | everything, to the last bit |
| .csv | all but the joints that stand still, to the last bit |
| .joint_trajectory.yaml, .robot_trajectory.yaml, .mcap | ROS messages: as .csv, times in whole nanoseconds |

A ROS message is read from any .yaml or .yml file: which one it is, its keys say.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdplan.planner.motion.csv_format import read_csv, write_csv
from hdplan.planner.motion.json_format import read_json, write_json
from hdplan.planner.motion.npz_format import read_npz, write_npz
from hdplan.planner.motion.ros_bag import check_installed, read_bag, write_bag
from hdplan.planner.motion.ros_yaml import check_size, read_ros_yaml, write_joint_trajectory, write_robot_trajectory
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.output import check_writable, ending_of

if TYPE_CHECKING:
    from hdplan.planner.motion.trajectory import Trajectory

Writer = Callable[["Trajectory", Mapping[str, Mapping[str, Any]]], bytes]
Reader = Callable[[bytes], dict[str, Any]]

WRITERS: Mapping[str, Writer] = {
    ".json": write_json,
    ".csv": write_csv,
    ".npz": write_npz,
    ".joint_trajectory.yaml": write_joint_trajectory,
    ".robot_trajectory.yaml": write_robot_trajectory,
    ".mcap": write_bag,
}
READERS: Mapping[str, Reader] = {
    ".json": read_json,
    ".csv": read_csv,
    ".npz": read_npz,
    ".yaml": read_ros_yaml,
    ".yml": read_ros_yaml,
    ".mcap": read_bag,
}
FORMATS = tuple(WRITERS)


def check_output(path: Path) -> None:
    """Say early that no trajectory can be written to `path`. Raises InputError for another ending than FORMATS, a path
    that cannot be written, or a library that is missing."""
    check_writable(path, FORMATS)
    if ending_of(path, FORMATS) == ".mcap":
        with naming(path):
            check_installed()


def check_length(path: Path, waypoints: int, joints: int) -> None:
    """Say early that a motion in time of so many waypoints and joints is too long for the format of `path`. Raises
    InputError."""
    if path.suffix.lower() == ".yaml":
        with naming(path):
            check_size(waypoints, joints)


def format_of(path: Path, formats: Mapping[str, Any]) -> Any:
    """Return what stands in a table of formats for the ending of a file; raises InputError for another ending."""
    if (ending := ending_of(path, formats)) is None:
        raise InputError(f"{path}: ending '{path.suffix}', a trajectory file ends with one of {', '.join(formats)}")
    return formats[ending]
