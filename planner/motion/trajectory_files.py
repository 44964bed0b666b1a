"""The formats of trajectory files, by file extension: the one list of them.

| extension | content |
|---|---|
| .json | everything, to the last bit; also `verdict` and `steps` |
| .npz | everything, to the last bit |
| .csv | all but the locked joints, to the last bit; of a job the stage of each row |
| .joint_trajectory.yaml, .robot_trajectory.yaml, .mcap | ROS messages: as .csv, times in whole nanoseconds |

A job is several messages, which .mcap alone holds, to be played; its motion is read from the first three.

A ROS message is read from any .yaml or .yml file; its keys determine its type.
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
    """Check early that a trajectory can be written to `path`. Raises InputError for an extension not in FORMATS, a path
    that cannot be written, or a missing library."""
    check_writable(path, FORMATS)
    if ending_of(path, FORMATS) == ".mcap":
        with naming(path):
            check_installed()


def check_stages(path: Path) -> None:
    """Check early that the format of `path` can hold a job. Raises InputError otherwise."""
    if path.suffix.lower() == ".yaml":
        raise InputError(f"{path}: one message holds one motion, and a job is several: write .mcap, .json or .csv")


def check_length(path: Path, waypoints: int, joints: int) -> None:
    """Check early that the format of `path` can hold a timed motion of so many waypoints and joints. Raises InputError
    otherwise."""
    if path.suffix.lower() == ".yaml":
        with naming(path):
            check_size(waypoints, joints)


def format_of(path: Path, formats: Mapping[str, Any]) -> Any:
    """Return a table's entry for the extension of a file; raises InputError for an unknown extension."""
    if (ending := ending_of(path, formats)) is None:
        raise InputError(f"{path}: ending '{path.suffix}', a trajectory file ends with one of {', '.join(formats)}")
    return formats[ending]
