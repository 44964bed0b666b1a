"""The problems of MotionBenchMaker: DIR/ROBOT/robot.yaml, and a folder for each set with scenes and requests."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.robot.link_frame import frames_of, link_poses
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.yaml_format.reader import shipped_scenes

SHIPPED = "shipped scenes"
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
    def name(self) -> str:
        """Robot, set and number."""
        return f"{self.robot} {self.set} {self.number}"

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


def problem_parser(description: str | None, time_limit: float = 30.0) -> argparse.ArgumentParser:
    """A command line that chooses problems: the folder, --robot, --set, --every, and --time-limit for each."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", choices=("panda", "ur5", "fetch", "baxter"), action="append")
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--every", type=int, default=1, help="take every K-th problem of a set")
    parser.add_argument("--time-limit", type=float, default=time_limit, help="[s] for each plan")
    return parser


def mixed_parser(description: str | None) -> argparse.ArgumentParser:
    """A command line that chooses among `mixed_problems`: the folder, if any, and --every."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, metavar="DIR")
    parser.add_argument("--every", type=int, default=10, help="take every K-th problem of a set")
    return parser


def mixed_problems(
    folder: Path | None, every: int, robots: Sequence[str] = ("panda", "ur5"), sets: Sequence[str] = ()
) -> Iterator[tuple[str, str, Callable[[], hdplan.Scene]]]:
    """Yield group, name and loader of all shipped scenes and, with a folder, of every K-th problem of some robots."""
    for name in shipped_scenes():
        yield SHIPPED, name, partial(hdplan.load_scene, name)
    for robot in robots if folder else ():
        for problem in real_problems(folder, robot, every, sets):  # type: ignore[arg-type]
            yield robot, f"{problem.set} {problem.number}", problem.load


def real_problems(folder: Path, robot: str, every: int = 1, sets: Sequence[str] = ()) -> list[RealProblem]:
    """Every K-th problem of each set (or of those named) of one robot, in the order of their names."""
    folders = sorted(path for path in (folder / robot).iterdir() if path.is_dir() and (not sets or path.name in sets))
    return [RealProblem(file) for each in folders for file in sorted(each.glob("scene*.yaml"))[::every]]


def with_pose_goal(scene: hdplan.Scene, link: str) -> hdplan.Scene:
    """The scene with the pose of a link as its goal, to which the joints of its goal bring it."""
    setup = Setup.of(scene)
    return scene.with_goal(hdplan.PoseTarget(link, pose_of(setup.robot, link, setup.query.goal)))


def pose_of(robot: Robot, link: str, q: Array) -> hdplan.Pose:
    """The pose to which a configuration (n,) brings a link."""
    place = link_poses(robot, q[None], frames_of(robot)[link])[0]
    return hdplan.Pose(place[:3, 3], Rotation.from_matrix(place[:3, :3]).as_quat())
