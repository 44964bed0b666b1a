"""Every configuration of a pose: the time that it takes, and how many are found, beside ssik and EAIK if installed.

Arms are those that ssik ships, by its own forward kinematics; poses are those of random configurations, without limits.
A branch of ssik's counts as missed if no configuration of ours is within 1e-4 rad of it, whole turns aside; of an arm
with seven joints ssik's eight nearest to the configuration itself are looked for, with the joint that is held as there.
EAIK takes arms of six joints whose geometry it knows. Times are medians for one pose, in C or C++ called from Python;
that of `hdplan.inverse_kinematics`, proofs included, is measured for robots that hdplan knows by name.

    python benchmarks/inverse_kinematics.py [--poses N] [ARM ...]      # pip install ssik eaik, to compare
"""

from __future__ import annotations

import argparse
import importlib
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pinocchio as pin

import hdplan
from hdplan.distance.poses import placement_rows
from hdplan.planner.kinematics import closed_form_loop
from hdplan.planner.kinematics.closed_form import Joints, choice
from hdplan.planner.robot.link_frame import end_effector, link_frame, link_poses
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Array

ARMS = ("ur5", "z1", "puma560", "irb120", "kr6_r900", "jaco2", "xarm6", "franka_panda", "iiwa14", "gen3")
ROBOTS = ("ur3", "ur5", "ur10", "z1", "kinova", "talos_left_arm", "panda", "xarm7")
POSES, NEAREST, SAME = 100, 8, 1e-4


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arms", nargs="*", default=ARMS)
    parser.add_argument("--poses", type=int, default=POSES)
    given = parser.parse_args()
    print(f"hdplan.inverse_kinematics(…, all_branches=True)\n\n{markdown_text(list(proven(given.poses)))}")
    if ssik := _installed("ssik"):
        rows = [against(ssik, name, given.poses) for name in given.arms]
        print(f"The loop alone\n\n{markdown_text(rows)}")


def proven(poses: int) -> Iterator[dict[str, Any]]:
    """Rows for robots by name: with limits, proofs and all."""
    for name in ROBOTS:
        robot, rng = hdplan.load_robot(name), np.random.default_rng(0)
        link = end_effector(robot, "link")
        drawn, seeds, times, counts = robot.draw(rng, poses), robot.draw(rng, poses), [], []
        for place, seed in zip(link_poses(robot, drawn, link_frame(robot, link, "")), seeds, strict=True):
            turn = pin.Quaternion(place[:3, :3]).normalized().coeffs()
            pose = hdplan.Pose(tuple(place[:3, 3].tolist()), tuple(turn.tolist()))
            before = time.process_time()
            counts.append(len(hdplan.inverse_kinematics(robot, pose, link, seed=seed, all_branches=True)))
            times.append(time.process_time() - before)
        none = sum(count == 0 for count in counts)
        yield {"robot": name, "branches": sum(counts), "poses without": none, "median ms": _ms(times)}


def against(ssik: Any, name: str, poses: int) -> dict[str, Any]:
    """One arm of ssik's."""
    arm = ssik.Manipulator.from_prebuilt(name)
    joints = _joints_of(arm.fk, arm.dof)
    ways = choice(joints)
    assert ways
    free = np.full(arm.dof, np.inf)
    chains, held = [way.chain(joints, -free, free) for way in ways], list(ways[0].held)
    ours, theirs, count, missed = [], [], 0, 0
    drawn = np.random.default_rng(0).uniform(-np.pi, np.pi, (poses, arm.dof))
    for q in drawn:
        place = arm.fk(q)
        wanted = placement_rows(place)
        near = {"q_seed": q, "max_solutions": NEAREST} if held else {}
        before = time.process_time()
        others = [each.q for each in arm.solve(place, respect_limits=False, enumerate_windings=False, **near)]
        theirs.append(time.process_time() - before)
        count += len(others)
        for other in others if held else others[:1]:
            before = time.process_time()
            found = np.vstack([closed_form_loop.branches(x, wanted, other[None, held], other) for x in chains])
            ours.append(time.process_time() - before)
            missed += _missed(found, [other] if held else others)
    row = {"arm": name, "solved by": ways[0].kind.name.lower(), "ssik's branches": count, "missed": missed}
    return {**row, "ms": _ms(ours), "ssik ms": _ms(theirs), "EAIK ms": _eaik(joints, [arm.fk(q) for q in drawn])}


def _missed(found: Array, others: list[Array]) -> int:
    ways = [np.abs((found - other + np.pi) % (2 * np.pi) - np.pi) for other in others]
    return sum(not len(way) or way.max(axis=1).min() > SAME for way in ways)


def _joints_of(forward: Callable[[Array], Array], n: int) -> Joints:
    """The joints of a forward kinematics, by a quarter turn of each."""
    tip = forward(np.zeros(n))
    directions, points = np.empty((n, 3)), np.empty((n, 3))
    for joint in range(n):
        motion = forward(np.pi / 2 * np.eye(n)[joint]) @ np.linalg.inv(tip)
        turn = motion[:3, :3] - motion[:3, :3].T
        directions[joint] = 0.5 * np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        rows = np.vstack([np.eye(3) - motion[:3, :3], directions[joint]])
        points[joint] = np.linalg.lstsq(rows, np.append(motion[:3, 3], 0.0), rcond=None)[0]
    return Joints(np.arange(n), np.ones(n, np.int64), directions, points, tip)


def _eaik(joints: Joints, places: list[Array]) -> str:
    """The median time of EAIK, or why there is none."""
    module = _installed("eaik.IK_HP")
    if module is None:
        return "not installed"
    if len(joints.turns) != 6:
        return "-"
    steps = np.diff(np.vstack([np.zeros(3), joints.points, joints.tip[:3, 3]]), axis=0)
    robot = module.HPRobot(joints.directions, steps)
    if not robot.hasKnownDecomposition():
        return "unknown"
    times, turn = [], np.eye(4)
    turn[:3, :3] = joints.tip[:3, :3]
    for place in places:
        wanted = place @ turn.T  # without the link's own rotation
        before = time.process_time()
        robot.IK(wanted)
        times.append(time.process_time() - before)
    return _ms(times)


def _installed(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _ms(seconds: list[float]) -> str:
    return f"{1e3 * float(np.median(seconds)):.3f}"


if __name__ == "__main__":
    main()
