"""A replanner among random boxes, by the rule of SPARROWS' experiments with a single arm (arXiv 2402.08857).

    python benchmarks/replanning_boxes.py [--boxes N ...] [--trials N] [--from SEED] [--seconds S] [--robot FILE]

Start and goal are drawn within the joints' limits (continuous ones within a turn), free of the robot itself. N cubes of
20 cm, aligned with the world, stand where the hand is at further random configurations, 1 cm or more away from the
robot at start and goal; they may overlap. Nothing says that there is a way. The robot is to come to rest at the goal
within S seconds (75, as their 150 periods of half a second); steps and ways take as long as the processor takes, which
the time limits of ways count, too, and all boxes are known from the beginning. Theirs is easier in some: it is at the
goal within 0.1 rad, and boxes stand 1 cm away from the boxes around links; and harder in one: two failures end a trial.

Theirs is a Kinova Gen3, whose description (gen3.urdf of zonopy-robots) comes with no package that hdplan needs: name it
by --robot (URDF or MJCF).
By default it is a Panda by the same rule, with its own limits; the shares are then not comparable with theirs. Contacts
are looked for without hdplan, by Pinocchio and coal, every 5 ms.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from replanning import CHECK, LATENCY, NEAREST, PERIOD, Beside
from replanning_world import LIMITS, Gaps, Judge

import hdplan
from hdplan.planner.robot.link_frame import end_effector, frames_of, link_poses
from hdplan.planner.studies.report import markdown_text

SIDE, APART = 0.2, 0.01  # [m] of a cube; between it and the robot at start and goal
TRIES = 200  # of a draw


def scene_of(seed: int, count: int, spec: hdplan.RobotSpec) -> tuple[hdplan.Scene, list[np.ndarray]]:
    """Return a trial's scene, and where its boxes are."""
    rng = np.random.default_rng([seed, count])
    limits = LIMITS if spec.name == "panda" else hdplan.Limits(velocity="urdf", acceleration=10, jerk=5000)
    robot = hdplan.load_robot(spec)
    hand = frames_of(robot)[end_effector(robot, "robot")]
    ends: list[np.ndarray] = []
    bare = hdplan.Scene(robot=spec, start=[0.0] * robot.n, goal=[0.0] * robot.n, limits=limits)
    while len(ends) < 2:
        q = robot.draw(rng, 1)[0]
        if not hdplan.check_configuration(bare, robot, q):
            ends.append(q)
    judge, places = Judge(robot, floor=False), list[np.ndarray]()
    for _ in range(TRIES * count):
        at = link_poses(robot, robot.draw(rng, 1), hand)[0, :3, 3]
        if all(judge.distance(q, [box(0, at)]) > APART for q in ends):
            places.append(at)
        if len(places) == count:
            break
    cubes = [hdplan.Obstacle(f"box{i}", hdplan.Box([SIDE] * 3), pose=at) for i, at in enumerate(places)]
    start, goal = (q.tolist() for q in ends)
    return hdplan.Scene(robot=spec, obstacles=cubes, start=start, goal=goal, limits=limits), places


def box(index: int, at: np.ndarray) -> Any:
    """Return a cube as the judge takes it."""
    return SimpleNamespace(name=f"box{index}", shape=hdplan.Box([SIDE] * 3), at=at, turn=np.eye(3), lever=SIDE)


def trial(seed: int, count: int, spec: hdplan.RobotSpec, seconds: float) -> dict[str, Any]:
    """Return the outcome of one trial."""
    scene, places = scene_of(seed, count, spec)
    beside, clock = Beside(), [0.0, 0.0]

    def now() -> float:
        return clock[0] + time.process_time() - clock[1] - beside.spent

    replanner = hdplan.Replanner(scene, period=PERIOD, latency=LATENCY, clock=now, executor=beside)
    gaps, cubes = Gaps(Judge(replanner.robot, floor=False), speed=0.0), [box(i, at) for i, at in enumerate(places)]
    least, t, steps, mode = NEAREST, 0.0, list[float](), ""
    while t < seconds and mode != "arrived":
        beside.advance(t)
        clock[0], clock[1], beside.spent = t, time.process_time(), 0.0
        command = replanner.step(t)
        steps.append(now() - t)
        mode = command.mode.value
        after = t + max(PERIOD, steps[-1])
        found = command.at(np.arange(t, after, CHECK))
        for q, dq in zip(found.positions, found.velocities, strict=True):
            gaps.move(q, CHECK)
            if dq.any():
                least = min(least, gaps.below(cubes, max(least, 0.0) + 1e-9))
        t = after
    return {"arrived": mode == "arrived", "seconds": t, "least": least, "cycle": np.quantile(steps, [0.5, 0.99])}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--boxes", type=int, nargs="+", default=[10, 20, 40])
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--from", dest="first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=75.0)
    parser.add_argument("--robot", default="panda")
    options = parser.parse_args()
    time.perf_counter = time.process_time  # by which a search sees its limit: other work of the machine does not count
    spec = hdplan.RobotSpec(options.robot) if options.robot == "panda" else hdplan.RobotSpec(urdf=Path(options.robot))
    rows = []
    for count in options.boxes:
        own = []
        for seed in range(options.first, options.first + options.trials):
            own.append(trial(seed, count, spec, options.seconds))
            print(count, seed, own[-1], file=sys.stderr, flush=True)
        reached = [each["seconds"] for each in own if each["arrived"]]
        median, high = 1e3 * np.median([each["cycle"] for each in own], axis=0)
        row = {
            f"cubes around a {Path(options.robot).stem}": count,
            "trials": len(own),
            "goals reached": len(reached),
            "with a contact": sum(each["least"] <= 0.0 for each in own),
            "seconds to the goal, median": float(np.median(reached)) if reached else None,
            "cycle median / 99 % [ms]": f"{median:.1f} / {high:.1f}",
        }
        rows.append(row)
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
