"""The problems of MotionBenchMaker: DIR/ROBOT/robot.yaml, and a folder for each set with scenes and requests."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pinocchio as pin
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.robot.setup import Setup

HANDS = {"panda": "panda_hand", "ur5": "ee_link"}  # whose poses are goals
LIMITS = hdplan.Limits(velocity="urdf", acceleration=15.0, jerk=500.0)  # those of cuRobo's published figures


@dataclass(frozen=True)
class RealProblem:
    """One problem, by its files."""

    scene_file: Path

    @property
    def robot(self) -> str:
        """The robot's folder."""
        return self.scene_file.parents[1].name

    @property
    def set(self) -> str:
        """The set's folder."""
        return self.scene_file.parent.name

    @property
    def number(self) -> str:
        """The number in its files' names."""
        return self.scene_file.stem.removeprefix("scene")

    @property
    def request_file(self) -> Path:
        """The motion plan request that goes with the scene."""
        return self.scene_file.with_name(self.scene_file.name.replace("scene", "request"))

    @property
    def robot_file(self) -> Path:
        """The `robot` section that all problems of the robot share."""
        return self.scene_file.parents[1] / "robot.yaml"

    @property
    def beside(self) -> tuple[Path, str]:
        """Its request and its robot, as they go beside the scene to hdplan's functions."""
        return self.request_file, str(self.robot_file)

    def load(self) -> hdplan.Scene:
        """Read it. Raises InputError for a bad file."""
        return hdplan.load_scene(self.scene_file, *self.beside)


def problem_parser(description: str | None) -> argparse.ArgumentParser:
    """A command line that chooses problems: the folder, --robot, --set, --every, and --time-limit for each."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", choices=("panda", "ur5", "fetch", "baxter"), action="append")
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--every", type=int, default=1, help="take every K-th problem of a set")
    parser.add_argument("--time-limit", type=float, default=30.0)
    return parser


def real_problems(folder: Path, robot: str, every: int = 1, sets: Sequence[str] = ()) -> list[RealProblem]:
    """Every K-th problem of each set (or of those named) of one robot, in the order of their names."""
    folders = sorted(path for path in (folder / robot).iterdir() if path.is_dir() and (not sets or path.name in sets))
    return [RealProblem(file) for each in folders for file in sorted(each.glob("scene*.yaml"))[::every]]


def with_pose_goal(scene: hdplan.Scene, link: str) -> hdplan.Scene:
    """The scene with the pose of a link as its goal, to which the joints of its goal bring it."""
    setup = Setup.of(scene)
    model = setup.robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, setup.robot.pin_q(setup.query.goal))
    place = data.oMf[model.getFrameId(link)]
    quaternion = Rotation.from_matrix(place.rotation).as_quat()
    return scene.with_goal(hdplan.PoseTarget(link, hdplan.Pose(place.translation, quaternion)))
