"""How a plan grows with the number of waypoints and of obstacles: times, and the peak of memory.

    python benchmarks/scaling.py [--picture FILE.png] [--repeat R]

A Panda moves around a post and between random boxes with edges of 2 to 6 cm, placed 5 cm clear of the straight line,
which meets the post, of the motion that is found with the post alone, and of all between the two: so the problem stays
as hard as it is while it grows. Waypoints 20 to 200 among 50 boxes; boxes 10 to 10,000 at the default number of
waypoints; and 200 waypoints among 10,000 boxes.
Every point runs in a process of its own, which plans once to warm up; given is the least of R plans. "In all" is the
processor's time, the phases are the clock's. Memory is the peak of the whole process, libraries included. The slope is
that of log time over log size between the ends: 1 is linear.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from memory import most_memory

import hdplan
from hdplan.planner.build import build
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.targets import JointTarget

WAYPOINTS = (20, 32, 50, 100, 200)
BOXES = (10, 30, 100, 300, 1000, 3000, 10_000)
FEW_BOXES = 50  # while waypoints vary
ROOM = np.array([[-0.9, -0.9, 0.0], [0.9, 0.9, 1.2]])  # [m] where boxes are
SIDES = (0.02, 0.06)  # [m]
POST = Obstacle("post", Box((0.08, 0.08, 0.9)), Pose((0.55, 0.0, 0.45)))
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the way from the line to the motion found
APART = 0.05  # [m] of the boxes from either motion, about
START = (-0.9, 0.2, 0.0, -1.9, 0.0, 2.1, 0.8)
GOAL = (0.9, 0.2, 0.0, -1.9, 0.0, 2.1, 0.8)
DRAW = 3000  # boxes drawn at a time


@dataclass(frozen=True)
class Point:
    """One measurement."""

    waypoints: int
    boxes: int
    build: float  # [s] robot known, kernels compiled
    solve: float  # [s]
    iterations: int
    certify: float  # [s]
    total: float  # [s] of the processor
    certified: bool
    peak: float  # [MB]


def scene_of(waypoints: int, boxes: int) -> Scene:
    """The Panda among random boxes."""
    empty = hdplan.load_scene("empty")
    start, goal = JointTarget("start", START), JointTarget("goal", GOAL)
    scene = dataclasses.replace(empty, start=start, goal=goal, name="clutter", obstacles=(POST,))
    found = hdplan.plan(scene)
    line = np.linspace(START, GOAL, len(found.trajectory))
    motions = np.vstack([_halved(line + share * (found.trajectory.positions - line)) for share in SHARES])
    rng, kept, number = np.random.default_rng(0), [POST], itertools.count()
    while len(kept) < boxes:
        drawn = [_random_box(f"box {next(number)}", rng) for _ in range(DRAW)]
        apart = dataclasses.replace(empty.planner, clearance=APART - empty.planner.activation)
        problem = build(dataclasses.replace(scene, obstacles=tuple(drawn), planner=apart))
        met: set[str] = set()
        if term := problem.terms.obstacles:
            inside = term.inside(problem.kinematics.evaluate(motions))
            met = {problem.halfspace_bodies[b].name for b in term.pairs.halfspace_body[inside.pair].tolist()}
        kept += [box for box in drawn if box.name not in met]
    settings = dataclasses.replace(empty.planner, waypoints=waypoints)
    return dataclasses.replace(scene, obstacles=tuple(kept[:boxes]), planner=settings)


def _halved(motion: np.ndarray) -> np.ndarray:
    """The motion with a waypoint in the middle of every interval."""
    return np.insert(motion, np.arange(1, len(motion)), (motion[1:] + motion[:-1]) / 2, axis=0)


def _random_box(name: str, rng: np.random.Generator) -> Obstacle:
    quaternion = rng.normal(size=4)
    turn = tuple((quaternion / np.linalg.norm(quaternion)).tolist())
    return Obstacle(name, Box(tuple(rng.uniform(*SIDES, 3).tolist())), Pose(tuple(rng.uniform(*ROOM).tolist()), turn))


def measure(warm: Scene, scene: Scene, repeat: int) -> Point:
    """Plan in this process."""
    hdplan.plan(warm)
    waypoints, boxes = scene.planner.waypoints, len(scene.obstacles)
    results, totals = [], []
    for _ in range(repeat):
        began = time.process_time()
        results.append(hdplan.plan(scene, time_limit=120.0))
        totals.append(time.process_time() - began)
    times = [result.times for result in results]
    build_s, solve_s, certify_s = np.min([(t.build + t.compile, t.solve, t.certify) for t in times], axis=0).tolist()
    rest = certify_s, min(totals), results[0].certified, most_memory() / 1e6
    return Point(waypoints, boxes, build_s, solve_s, results[0].iterations, *rest)


def in_a_process(waypoints: int, boxes: int, repeat: int) -> Point:
    """Measure in a process of its own, which is given the scenes: for the peak of memory of planning alone."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(measure, scene_of(20, 10), scene_of(waypoints, boxes), repeat).result()


def table(title: str, points: list[Point], size: str) -> str:
    """Markdown, and the slope of each time where there are several points."""
    rows = [
        {
            title: getattr(p, size),
            "build [ms]": 1e3 * p.build,
            "solve [ms]": 1e3 * p.solve,
            "iterations": p.iterations,
            "per iteration [ms]": 1e3 * p.solve / max(p.iterations, 1),
            "certify [ms]": 1e3 * p.certify,
            "in all [ms]": 1e3 * p.total,
            "certified": "yes" if p.certified else "no",
            "peak [MB]": p.peak,
        }
        for p in points
    ]
    first, last = points[0], points[-1]
    if first is last:
        return f"{markdown_text(rows)}\n"
    span = np.log(getattr(last, size) / getattr(first, size))
    per = [(p.solve / max(p.iterations, 1)) for p in (first, last)]
    slopes = {
        "per iteration": np.log(per[1] / per[0]) / span,
        "certify": np.log(last.certify / first.certify) / span,
        "in all": np.log(last.total / first.total) / span,
    }
    words = ", ".join(f"{name} {value:.2f}" for name, value in slopes.items())
    return f"{markdown_text(rows)}\nSlope of log time against log size: {words}\n"


def draw(by_waypoints: list[Point], by_boxes: list[Point], file: Path) -> None:
    """Two panels: time over waypoints and over boxes, with the memory beneath."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9, 5.5), sharex="col", height_ratios=(3, 1), layout="constrained")
    for column, (points, size, words) in enumerate(
        ((by_waypoints, "waypoints", f"waypoints, among {FEW_BOXES} boxes"), (by_boxes, "boxes", "boxes, 32 waypoints"))
    ):
        x = [getattr(p, size) for p in points]
        above, below = axes[0, column], axes[1, column]
        for name, colour, marker in (("solve", "#0072b2", "o"), ("certify", "#d55e00", "s"), ("build", "#009e73", "^")):
            above.loglog(x, [1e3 * getattr(p, name) for p in points], color=colour, marker=marker, label=name)
        above.loglog(x, [1e3 * p.solve / p.iterations for p in points], "o--", color="#0072b2", label="per iteration")
        reference = 1e3 * points[0].solve / points[0].iterations
        above.loglog(x, [reference * value / x[0] for value in x], ":", color="0.5", label="linear growth")
        above.set_ylabel("time [ms]")
        above.grid(alpha=0.3, which="both")
        below.semilogx(x, [p.peak for p in points], "o-", color="#444444")
        below.axhline(500, color="#cc79a7", linestyle="--")
        below.text(x[0], 510, "500 MB", color="#cc79a7", fontsize=8, va="bottom")
        below.set_ylim(0, 650)
        below.set_ylabel("peak [MB]")
        below.set_xlabel(words)
        below.set_xticks(x, [str(value) for value in x])
        below.minorticks_off()
        below.grid(alpha=0.3)
        above.set_title(f"More {size}", loc="left", fontsize=10, weight="bold")
    figure.suptitle("How time and memory grow with the problem", fontsize=12, weight="bold")
    handles = axes[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    figure.savefig(file, dpi=130)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5, help="plans per point; the fastest counts")
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    default = hdplan.load_scene("empty").planner.waypoints
    by_waypoints = [in_a_process(count, FEW_BOXES, options.repeat) for count in WAYPOINTS]
    by_boxes = [in_a_process(default, count, options.repeat) for count in BOXES]
    print(table(f"waypoints, {FEW_BOXES} boxes", by_waypoints, "waypoints"))
    print(table(f"boxes, {default} waypoints", by_boxes, "boxes"))
    both = in_a_process(WAYPOINTS[-1], BOXES[-1], options.repeat)
    print(table(f"waypoints, {BOXES[-1]:,} boxes", [both], "waypoints"))
    if options.picture:
        draw(by_waypoints, by_boxes, options.picture)


if __name__ == "__main__":
    main()
