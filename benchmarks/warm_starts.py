"""Plans made again and again from the last one, as an obstacle moves: a path, and a motion within limits of rates.

    python benchmarks/warm_starts.py DIR [--robot panda] [--every K] [--steps N] [--goals joints pose] [--time-limit S]

In each step one obstacle of a MotionBenchMaker problem, chosen at random, moves by STEP in a random direction, as far
as both ends stay free, and `hdplan.plan` gets the last trajectory as its guess. Then the same scene is planned without
a guess. Prints a row for paths and one for motions within cuRobo's limits: how many are certified, what both took in
processor time, and what the warm plan's motion costs beside the other's, by the scene's objective. One core.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from cells import milliseconds
from problems import HANDS, LIMITS, RealProblem, real_problems, with_pose_goal
from threadpoolctl import threadpool_limits

import hdplan
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.studies.report import Cell, markdown_text

STEP = 0.01  # [m] an obstacle moves at once
DRAWS = 20  # of a step that leaves both ends free


class Outcome(NamedTuple):
    """One step."""

    certified: bool
    warm: float  # [s] processor time with the guess
    cold: float  # without one
    cost: float  # of the warm motion, in shares of the other's


def moved(scene: hdplan.Scene, rng: np.random.Generator) -> hdplan.Scene:
    """The scene with one obstacle moved by STEP."""
    obstacles = list(scene.obstacles)
    chosen, way = int(rng.integers(len(obstacles))), rng.normal(size=3)
    obstacle = obstacles[chosen]
    position = np.asarray(obstacle.pose.position) + STEP * way / np.linalg.norm(way)
    pose = hdplan.Pose(position, obstacle.pose.quaternion_xyzw)
    obstacles[chosen] = dataclasses.replace(obstacle, pose=pose)
    return dataclasses.replace(scene, obstacles=tuple(obstacles))


def steps(problem: RealProblem, scene: hdplan.Scene, count: int, limit: float) -> Iterator[Outcome]:
    """Plan a scene, and again after each step."""
    rng, robot = np.random.default_rng(int(problem.number)), load_scene_robot(scene)
    last = hdplan.plan(scene, robot=robot, time_limit=limit)
    for _ in range(count):
        for _ in range(DRAWS):
            there = moved(scene, rng)
            began = time.process_time()
            try:
                warm = hdplan.plan(there, robot=robot, guess=last.trajectory, time_limit=limit)
            except hdplan.InputError:  # an end is in contact
                continue
            took, cold, cold_took = time.process_time() - began, *planned(there, robot, limit)
            both = warm.certified and cold.certified
            cost = warm.objective.value / cold.objective.value if both else np.nan
            yield Outcome(warm.certified, took, cold_took, cost)
            scene, last = there, warm
            break


def planned(scene: hdplan.Scene, robot: Robot, limit: float) -> tuple[hdplan.PlanResult, float]:
    """Plan without a guess; and what it took [s]."""
    began = time.process_time()
    result = hdplan.plan(scene, robot=robot, time_limit=limit)
    return result, time.process_time() - began


def row(kind: str, found: list[Outcome]) -> dict[str, Cell]:
    """Sum up the steps of one kind."""
    warm, cold, cost = (np.array([getattr(each, name) for each in found]) for name in ("warm", "cold", "cost"))
    return {
        "goals, kind": kind,
        "plans": len(found),
        "certified": sum(each.certified for each in found),
        "with the guess, processor time median / p95 / worst [ms]": milliseconds(warm, (0.5, 0.95, 1.0)),
        "without [ms]": milliseconds(cold, (0.5, 0.95, 1.0)),
        "cost, of that without [%], mean / worst": f"{100 * np.nanmean(cost):.1f} / {100 * np.nanmax(cost):.0f}",
    }


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--robot", choices=sorted(HANDS), default="panda")
    parser.add_argument("--every", type=int, default=10, help="take every K-th problem of a set")
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--goals", nargs="*", choices=("joints", "pose"), default=["joints", "pose"])
    parser.add_argument("--time-limit", type=float, default=10.0)
    options = parser.parse_args()
    problems = real_problems(options.folder, options.robot, options.every)
    if not problems:
        sys.exit(f"no problems found below {options.folder}")
    rows = []
    with threadpool_limits(1):
        for goals in options.goals:
            for kind in ("path", "timed"):
                found: list[Outcome] = []
                for problem in problems:
                    scene = problem.load()
                    scene = dataclasses.replace(scene, limits=LIMITS) if kind == "timed" else scene
                    scene = with_pose_goal(scene, HANDS[problem.robot]) if goals == "pose" else scene
                    mine = list(steps(problem, scene, options.steps, options.time_limit))
                    found += mine
                    took = ", ".join(f"{1e3 * each.warm:.0f}" for each in mine)
                    print(f"{goals}, {kind}: {problem.set} {problem.number}: {took} ms", file=sys.stderr)
                rows.append(row(f"{goals}, {kind}", found))
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
