"""How good motions are under limits of rates: their time, length and jerk, on the problems of MotionBenchMaker.

    python benchmarks/quality.py DIR [--robot panda] [--every K] [--goals pose joints] [--polish N ...]

Limits are cuRobo's: the URDF's velocities, 15 rad/s², 500 rad/s³. With `pose`, the goal is the pose to which the
request's joints bring the hand. Prints a row for every kind of goal and every number of rounds of polishing: certified
problems, mean time of the motion and mean length of its path, the largest jerk, and what planning and proving took.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
from problems import real_problems
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.motion.robot_curve import curve_of
from hdplan.planner.robot.setup import Setup
from hdplan.planner.studies.report import markdown_text

HANDS = {"panda": "panda_hand", "ur5": "ee_link"}
LIMITS = hdplan.Limits(velocity="urdf", acceleration=15.0, jerk=500.0)


def with_pose_goal(scene: hdplan.Scene, link: str) -> hdplan.Scene:
    """The scene with the pose of a link as its goal, to which the joints of its goal bring it."""
    setup = Setup.of(scene)
    model = setup.robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, setup.robot.pin_q(setup.query.goal))
    place = data.oMf[model.getFrameId(link)]
    quaternion = Rotation.from_matrix(place.rotation).as_quat()
    return scene.with_goal(hdplan.PoseTarget(link, hdplan.Pose(place.translation, quaternion)))


def row(scenes: list[hdplan.Scene], label: str, limit: float) -> dict[str, object]:
    """Plan all, and sum up."""
    took, proofs, seconds, lengths, jerks, failed = [], [], [], [], [], []
    for scene in scenes:
        began = time.perf_counter()
        try:
            result = hdplan.plan(scene, time_limit=limit)
        except hdplan.InputError as error:
            failed.append(str(error))
            continue
        wall = time.perf_counter() - began
        if not result.certified:
            failed.append(result.certificate.text)
            continue
        took.append(wall - result.times.certify)
        proofs.append(result.times.certify)
        seconds.append(result.trajectory.duration)
        lengths.append(np.linalg.norm(np.diff(result.trajectory.positions, axis=0), axis=1).sum())
        curve = curve_of(Setup.of(scene).robot, result.trajectory)
        jerks.append(np.abs(curve.at_time(np.linspace(0.0, seconds[-1], 2001), 3)).max())
        print(f"{label}: {seconds[-1]:.3f} s, {lengths[-1]:.2f} rad, {1e3 * wall:.0f} ms", file=sys.stderr)
    print(*failed, sep="\n", file=sys.stderr)
    return {
        "goals, rounds": label,
        "problems": len(scenes),
        "certified": len(took),
        "motion time mean [s]": f"{np.mean(seconds):.3f}",
        "path mean [rad]": f"{np.mean(lengths):.2f}",
        "largest jerk [rad/s³]": f"{max(jerks):.0f}",
        "plan median / p95 [ms]": _spread(took),
        "proofs median / p95 [ms]": _spread(proofs),
    }


def _spread(seconds: list[float]) -> str:
    return " / ".join(f"{1e3 * value:.0f}" for value in np.quantile(seconds, [0.5, 0.95]))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", choices=sorted(HANDS), default="panda")
    parser.add_argument("--every", type=int, default=10, help="take every K-th problem of a set")
    parser.add_argument("--goals", nargs="*", choices=("pose", "joints"), default=["pose", "joints"])
    parser.add_argument("--polish", nargs="*", type=int, default=[0])
    parser.add_argument("--time-limit", type=float, default=30.0)
    options = parser.parse_args()
    rows = []
    for kind in options.goals:
        for rounds in options.polish:
            scenes = []
            for problem in real_problems(options.folder, options.robot, options.every):
                scene = dataclasses.replace(problem.load(), limits=LIMITS)
                scene = dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, polish=rounds))
                scenes.append(with_pose_goal(scene, HANDS[options.robot]) if kind == "pose" else scene)
            hdplan.plan(scenes[0], time_limit=options.time_limit)  # warm
            rows.append(row(scenes, f"{kind}, {rounds}", options.time_limit))
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
