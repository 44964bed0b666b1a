"""Path constraints on random problems: how many are solved, from which guess, and how long that takes.

    python benchmarks/path_constraints.py [--problems N]

For a Panda and a UR5 among a floor, a post and a bar: a tool axis held upright, or a tool point held in a slab parallel
to a wall, at two tolerances each. Start and goal of a problem are the ends of a walk of small steps on the constraint
towards random configurations, clear of everything (the links' outer bodies), so each has a solution; they lie 3 rad or
more apart in joint space. The verdict is the certificate's.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from math import inf

import numpy as np
from cells import milliseconds

import hdplan
from hdplan.planner.build import build
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.problem.problem import Problem
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.roadmap import onto_path
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.path_constraints import PathConstraints, Upright, Within
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.targets import JointTarget

LEGS, STEPS, STEP, APART = 20, 60, 0.08, 3.0  # of a walk: legs, steps of each, their length; the ends' distance [rad]
OBSTACLES = (
    Obstacle("floor", Box((3.0, 3.0, 0.1)), Pose((0.0, 0.0, -0.15))),
    Obstacle("post", Box((0.1, 0.1, 1.0)), Pose((0.5, 0.3, 0.4))),
    Obstacle("bar", Box((0.6, 0.05, 0.05)), Pose((0.5, -0.3, 0.6))),
)
ROBOTS = (("panda_carry", "panda_hand", 0.45), ("ur5_table", "tool0", 0.4))  # scene of the robot, link, wall at x [m]


def cases() -> Iterator[tuple[str, Scene]]:
    """Name and scene of every kind of problem."""
    for name, link, wall in ROBOTS:
        bare = replace(hdplan.load_scene(name), obstacles=OBSTACLES, attached=())
        for angle in (0.1, 0.02):
            path = PathConstraints(Upright(link, (0.0, 0.0, -1.0), angle))
            yield f"{name.split('_')[0]}: upright within {angle} rad", replace(bare, path=path)
        for width in (0.02, 0.004):
            path = PathConstraints(position=Within(link, (width, inf, inf), Pose((wall, 0.0, 0.0)), (0.0, 0.0, 0.1)))
            yield f"{name.split('_')[0]}: in a slab of {width * 1e3:g} mm", replace(bare, path=path)


def walk(problem: Problem, rng: np.random.Generator) -> tuple[Array, Array] | None:
    """Both ends of a walk; None where it has no beginning."""
    drawn = onto_path(problem, problem.robot.draw(rng, 256))
    begins = drawn[problem.depth(drawn) == 0.0]
    if not len(begins):
        return None
    at = begins[:1]
    for _ in range(LEGS):
        target = problem.robot.draw(rng, 1)
        for _ in range(STEPS):
            way = target - at
            there = onto_path(problem, at + way * min(1.0, STEP / max(float(np.linalg.norm(way)), STEP)))
            if problem.depth(there)[0] > 0.0 or np.abs(there - at).max() > 3 * STEP:
                break
            at = there
    return begins[0], at[0]


def problems(scene: Scene, count: int) -> Iterator[Scene]:
    """The random problems of one kind."""
    robot, rng = load_scene_robot(scene), np.random.default_rng(0)
    problem, certifier = build(scene, robot), Certifier(Setup.of(scene, robot))
    assert certifier.path is not None
    while count:
        ends = walk(problem, rng)
        if ends is None or np.linalg.norm(ends[1] - ends[0]) < APART:
            continue
        if any(certifier.contacts(q) or certifier.path.at(q) for q in ends):
            continue
        count -= 1
        start, goal = (JointTarget(field, tuple(q.tolist())) for field, q in zip(("start", "goal"), ends, strict=True))
        yield replace(scene, start=start, goal=goal)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=24, help="of each kind")
    count, rows = parser.parse_args().problems, []
    for name, scene in cases():
        results = [hdplan.plan(each, time_limit=10.0) for each in problems(scene, count)]
        good = [result for result in results if result.certified]
        row = {
            "constraint": name,
            "problems": count,
            "certified": len(good),
            "from the straight line": sum(result.attempts == 1 for result in good),
            "solve median / worst [ms]": milliseconds([result.times.solve for result in results], (0.5, 1.0)),
            "certify [ms]": milliseconds([result.times.certify / result.attempts for result in results], (0.5,)),
        }
        rows.append(row)
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
