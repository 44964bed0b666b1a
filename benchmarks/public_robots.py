"""Robots as they stand in public repositories: which load, and why others do not.

    python benchmarks/public_robots.py WORKSPACE

WORKSPACE holds a checkout of each repository below in a folder of its name, as the `src` of a ROS workspace; those that
are not there are left out. Every xacro and URDF that is a robot of its own is loaded; macro files are not listed.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from hdplan.planner.robot.loading import load_robot
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.errors import InputError
from hdplan.scenes.robot_spec import RobotSpec

Arguments = dict[str, str | bool | float]  # of a xacro file
UR: list[Arguments] = [
    {"ur_type": kind, "name": "ur"} for kind in ["ur3", "ur3e", "ur5", "ur5e", "ur10", "ur10e", "ur16e", "ur20", "ur30"]
]
GRIPPERS: list[Arguments] = [{}, {"gripper": "robotiq_2f_85"}, {"gripper": "robotiq_2f_140", "vision": True}]
GEN3: list[Arguments] = [{"name": "gen3", "arm": "gen3", "dof": 7, **more} for more in GRIPPERS]
XARM: list[Arguments] = [
    {"dof": 5},
    {"dof": 6},
    {"dof": 7},
    {"dof": 6, "robot_type": "lite"},
    {"dof": 6, "robot_type": "uf850"},
]
XARM += [{"dof": 6, "add_gripper": True}, {"dof": 7, "add_vacuum_gripper": True}]
ES: list[Arguments] = [{"joint_velocities_file": "$(find motoman_es_support)/config/joint_velocities_dx100.yaml"}]
# Repository, files, arguments. Neighbours that these need: ros2_robotiq_gripper (Kinova), realsense-ros (stretch).
ROBOTS: list[tuple[str, str, list[Arguments]]] = [
    ("Universal_Robots_ROS2_Description", "urdf/ur.urdf.xacro", UR),
    ("ros2_kortex", "kortex_description/robots/kinova.urdf.xacro", [*GEN3, {"name": "g", "arm": "gen3", "dof": 6}]),
    ("ros2_kortex", "kortex_description/robots/gen3_lite.urdf", [{}]),
    ("xarm_ros2", "xarm_description/urdf/xarm_device.urdf.xacro", XARM),
    ("xarm_ros2", "xarm_description/urdf/dual_xarm_device.urdf.xacro", [{}]),
    ("franka_description", "robots/*/*.urdf.xacro", [{}]),
    ("abb", "*_support/urdf/*.xacro", [{}]),
    ("fanuc", "*_support/urdf/*.xacro", [{}]),
    ("kuka_experimental", "*_support/urdf/*.xacro", [{}]),
    ("motoman", "*_support/urdf/[!e]*.xacro", [{}]),
    ("motoman", "motoman_es_support/urdf/es*.xacro", ES),
    ("moveit_resources", "*/urdf/*.urdf*", [{}]),
    ("moveit_resources", "*_moveit_config/config/*.urdf.xacro", [{}]),
    ("stretch_ros", "stretch_description/urdf/stretch_description*.xacro", [{}]),
    ("stretch_urdf", "stretch_urdf/*/*.urdf", [{}]),
]


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("workspace", type=Path)
    workspace = parser.parse_args().workspace
    rows = []
    for repository, pattern, all_arguments in ROBOTS:
        for file in sorted((workspace / repository).glob(pattern)):
            if "macro" in file.name:
                continue
            for arguments in all_arguments:
                began = time.perf_counter()
                try:
                    robot = load_robot(RobotSpec(urdf=file, xacro_args=arguments))
                    said = f"{robot.n} joints, {len(robot.links)} links"
                except InputError as error:
                    said = str(error).removeprefix(f"robot.urdf: {file}: ")
                rows.append(
                    {
                        "repository": repository,
                        "file": str(file.relative_to(workspace / repository)),
                        "arguments": ", ".join(f"{key}:={value}" for key, value in arguments.items()),
                        "loads": said,
                        "s": f"{time.perf_counter() - began:.1f}",
                    }
                )
                print(rows[-1], file=sys.stderr)
    print(markdown_text(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
