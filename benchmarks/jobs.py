"""Jobs: tool paths as published with CppFlow, each followed as one stage within 0.1 mm and 0.1°, free, and proven;
sequences of the tests of MoveIt's Pilz planner, against its definition of their curves; a job's time against that of
its legs, planned one by one.

    python benchmarks/jobs.py cppflow DIR --fetch FOLDER --processor-time
    python benchmarks/jobs.py pilz DIR --prbt FOLDER
    python benchmarks/jobs.py picks DIR --count 200
    python benchmarks/jobs.py legs --count 12

DIR holds problems/*.yaml and paths/*.csv; FOLDER holds fetch.urdf, fetch.srdf and the meshes. A table is printed, with
the processor time of planning and certifying, and how many are certified; `--processor-time`: the limit is one of
processor time, too. Frames are those at which all joints are 0. What is certified is looked at again at every
pose of the path, by Pinocchio, against the path as published. Sequences of Pilz' planner: `pilz.py`; there DIR holds
its tests' *_testdata_sequence.xml, and FOLDER `prbt_support`, from which the robot comes. Random pick-and-place jobs:
`picks.py`; they, their motions and what was found are written to DIR, and resume an interrupted run; a table
by arms is printed, each job to the error stream. Legs one by one: `blended_jobs.py`.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from blended_jobs import legs
from picks import picks
from pilz import pilz
from processor_time import add_processor_time, set_clock
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.robot.link_frame import link_poses

FAR, ANGLE = 1e-4, math.radians(0.1)
LINKS = {"panda": "panda_hand", "fetch": "gripper_link"}
STARTS: dict[str, list[tuple[float, ...]]] = {  # the problems name none; where it is not free, any that is
    "panda": [(-1.5, -0.8, 0.0, -2.2, 0.0, 1.6, 0.8)],
    "fetch": [(0.1, 1.32, 1.4, -0.2, 1.72, 0.0, 1.66, 0.0)],
}
ARM = "torso_lift shoulder_pan shoulder_lift upperarm_roll elbow_flex forearm_roll wrist_flex wrist_roll"


def robot_of(name: str, fetch: Path | None) -> hdplan.RobotSpec:
    """Return the robot of a problem."""
    if name == "panda":
        return hdplan.RobotSpec(name="panda")
    if fetch is None:
        raise SystemExit("--fetch: is missing: where is the robot's folder?")
    urdf, srdf = (str(fetch / f"fetch.{ending}") for ending in ("urdf", "srdf"))
    return hdplan.RobotSpec(urdf=urdf, srdf=srdf, package_dirs=[str(fetch)], group=[f"{x}_joint" for x in ARM.split()])


def poses_of(folder: Path, problem_data: dict[str, Any], robot: hdplan.Robot) -> list[hdplan.Pose]:
    """Return the poses of a problem in the world."""
    with (folder / "paths" / f"{problem_data['path_name']}.csv").open(encoding="utf-8") as file:
        rows = np.array([[float(x) for x in row[1:]] for row in list(csv.reader(file))[1:]])
    frame, named = np.eye(4), problem_data["path_offset_frame"]
    if named != "world":
        frame = link_poses(robot, np.zeros((1, robot.n)), robot.model.getFrameId(named))[0]
    turn = Rotation.from_matrix(problem_data["path_R_offset"]).as_quat()
    frame = frame @ hdplan.Pose(problem_data["path_xyz_offset"], turn).matrix
    placed = [frame @ hdplan.Pose(row[:3], np.roll(row[3:], -1)).matrix for row in rows]  # w is the first of a row
    found = [hdplan.Pose(pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_quat()) for pose in placed]
    return [found[0], *(pose for last, pose in itertools.pairwise(found) if pose != last)]


def boxes_of(problem_data: dict[str, Any]) -> list[hdplan.Box]:
    """Return the obstacles of a problem."""
    boxes: list[hdplan.Box] = []
    for pairs in problem_data.get("obstacles") or ():
        each = {name: value for pair in pairs for name, value in pair.items()}
        place = np.array([each[axis] for axis in "xyz"]) + problem_data["obstacle_xyz_offset"]
        pose = hdplan.Pose.from_rpy(place, [each[angle] for angle in ("roll", "pitch", "yaw")])
        boxes.append(hdplan.Box([each[f"size_{axis}"] for axis in "xyz"], name=f"box{len(boxes)}", pose=pose))
    return boxes


def scene_of(folder: Path, file: Path, fetch: Path | None) -> hdplan.Scene:
    """Return a problem as a job: to its first pose, and along the others."""
    problem_data = yaml.safe_load(file.read_text(encoding="utf-8"))
    spec, link = robot_of(problem_data["robot"], fetch), LINKS[problem_data["robot"]]
    robot = hdplan.load_robot(spec)
    poses = poses_of(folder, problem_data, robot)
    job = hdplan.Job([
        hdplan.Move(hdplan.PoseTarget(link, poses[0], 0.1 * FAR, 0.1 * ANGLE), name="to the path"),
        hdplan.Along(poses, link=link, position_tolerance=FAR, orientation_tolerance=ANGLE, name="along it"),
    ])  # fmt: skip
    more: dict[str, Any] = {"robot": spec, "obstacles": boxes_of(problem_data)}
    rng = np.random.default_rng(0)
    low, high = np.maximum(robot.inner, -np.pi)[0], np.minimum(robot.inner, np.pi)[1]
    for start in [*STARTS[problem_data["robot"]], *(tuple(rng.uniform(low, high).tolist()) for _ in range(100))]:
        standing = hdplan.Scene(**more, start=start, goal=start)
        if not hdplan.check_configuration(standing, robot, start):
            break
    limits = hdplan.Limits(velocity="urdf", acceleration=5.0, jerk=500.0)
    return hdplan.Scene(**more, name=file.stem, start=start, limits=limits, job=job)


def seen_again(scene: hdplan.Scene, result: hdplan.JobResult) -> str:
    """Say which pose of the path a certified motion does not pass, in order; empty if it passes all."""
    stage, job = result.certificate.stages[-1], scene.job
    robot, motion = hdplan.load_robot(scene.robot), stage.trajectory
    assert job is not None
    along = job.stages[-1]
    assert isinstance(along, hdplan.Along)
    assert motion.times is not None
    order = [motion.joint_names.index(joint) for joint in robot.joint_names]
    rows = motion.at_time(np.arange(motion.times[0], motion.times[-1], 1e-3)).positions[:, order]
    poses, first = link_poses(robot, rows, robot.model.getFrameId(along.link)), 0
    steps = 0.6 * np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).max()
    turns = 0.6 * Rotation.from_matrix(poses[:-1, :3, :3].transpose(0, 2, 1) @ poses[1:, :3, :3]).magnitude().max()
    for number, pose in enumerate(along.poses):
        off = np.linalg.norm(poses[first:, :3, 3] - pose.position, axis=1)
        turned = Rotation.from_matrix(pose.matrix[:3, :3].T @ poses[first:, :3, :3]).magnitude()
        near = np.flatnonzero((off <= FAR + steps) & (turned <= ANGLE + turns))
        if not len(near):
            return f"pose {number} is not passed"
        first += int(near[0])
    return ""


def cppflow(folder: Path, fetch: Path | None, only: str, time_limit: float) -> None:
    """Follow all paths, and print what was found."""
    done = tried = 0
    print("| problem | poses | length of the motion [s] | processor time [s] | |\n|---|---:|---:|---:|---|")
    for file in sorted((folder / "problems").glob(f"{only}*.yaml")):
        scene = scene_of(folder, file, fetch)
        assert scene.job is not None
        along = scene.job.stages[-1]
        assert isinstance(along, hdplan.Along)
        began, length, tried = time.process_time(), "", tried + 1
        try:
            result = hdplan.plan_job(scene, time_limit=time_limit)
            seconds = time.process_time() - began
        except hdplan.HdplanError as error:
            seconds, words = time.process_time() - began, f"no: {error}"
        else:
            again = seen_again(scene, result) if result.certified else ""
            words = f"REFUTED: {again}" if again else "certified" if result.certified else f"no: {result.text}"
            length, done = f"{result.trajectory.duration:.2f}", done + (words == "certified")
        print(f"| {file.stem} | {len(along.poses)} | {length} | {seconds:.2f} | {words[:220]} |", flush=True)
    print(f"\n{done} of {tried} certified")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["cppflow", "pilz", "picks", "legs"])
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--fetch", type=Path)
    parser.add_argument("--prbt", type=Path)
    parser.add_argument("--only", default="", help="how the names of problems begin")
    parser.add_argument("--time-limit", type=float, default=60.0)
    parser.add_argument("--count", type=int, default=200, help="of random jobs")
    parser.add_argument("--first", type=int, default=0, help="the number of the first")
    add_processor_time(parser)
    options = parser.parse_args()
    set_clock(options)
    if options.what == "legs":
        legs(options.count, options.first, options.time_limit)
    elif options.folder is None:
        parser.error("DIR: is missing")
    elif options.what == "pilz":
        pilz(options.folder, options.prbt, options.only, options.time_limit)
    elif options.what == "picks":
        picks(options.folder, options.count, options.first, options.time_limit)
    else:
        cppflow(options.folder, options.fetch, options.only, options.time_limit)
