"""Every robot that goes by name: what it costs to fit, build, solve and certify random motions among random obstacles.

    python benchmarks/robots.py [NAME ...] [--motions N] [--limit SECONDS] [--seed N]

Prints a Markdown table, a row for each robot as soon as it is there; without names, of all robots. Each robot runs in a
process of its own, ended at the limit of processor time. Times are seconds of processor time: fit and load once (fit
with an empty cache), build, solve and certify for a motion, at the median; a plan's time is split among them as the
clock has them. Ends are random configurations that touch nothing: anywhere within the limits, or, where a robot of
many limbs nearly always touches itself there, around a configuration in which it does not, the wider the better.
Obstacles leave the robot room to stand there. A robot for which none is found says so, as does one that cannot be
loaded.
"""

from __future__ import annotations

import argparse
import itertools
import os
import resource
import statistics
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import numpy as np
import pinocchio as pin

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.collision.link_bodies import fit_report
from hdplan.planner.result import PlanResult
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.errors import HdplanError, InputError, TimeLimitError
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_files.library import robot_names
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Sphere

HEAD = ("robot", "joints", "links", "bodies", "outside mm", "certified", "load", "fit", "build", "solve", "certify")
TRIES = 200  # random configurations that an end is looked for among
SPREADS = (1.0, 0.5, 0.25, 0.1, 0.05)  # share of the way from a free configuration to random ones
CHANGED = 0.15  # share of the joints that are drawn again
PLACES = 20  # that are tried for an obstacle
OBSTACLES = 4
PLAN_LIMIT = 20.0  # [s] for one plan


def row(name: str, motions: int, seed: int) -> list[str]:
    """Return a robot's row. Raises HdplanError where it can have none."""
    began = time.process_time()
    robot = load_robot(name)
    loaded = time.process_time()
    report = fit_report(robot)
    fitted = time.process_time()
    if not report:
        raise InputError("no link has collision geometry: it can touch nothing")
    rng = np.random.default_rng(seed)
    certified, times = 0, []
    for _ in range(motions):
        scene = random_scene(name, robot, rng)
        began_plan = time.process_time()
        try:
            result = hdplan.plan(scene, seed=seed, time_limit=PLAN_LIMIT)
        except TimeLimitError:
            continue
        certified += result.certified
        times.append(split(result, time.process_time() - began_plan))
    if not times:
        raise InputError(f"no motion within {PLAN_LIMIT:g} s, of {motions} tried")
    return [
        *(name, str(robot.n), str(len(robot.links)), str(sum(each.bodies for each in report))),
        f"{1e3 * statistics.fmean(each.mean_outside for each in report):.1f}",
        f"{certified} of {motions}",
        *(f"{seconds:.2f}" for seconds in (loaded - began, fitted - loaded)),
        *(f"{statistics.median(each[step] for each in times):.2f}" for step in ("build", "solve", "certify")),
    ]


def split(result: PlanResult, spent: float) -> dict[str, float]:
    """Return the processor time [s] of a plan's steps: of the whole, the share that each has of the clock."""
    clock: dict[str, float] = result.summary()["time_s"]
    steps = {step: clock[step] for step in ("load", "build", "compile", "solve", "certify") if step in clock}
    return {step: spent * seconds / sum(steps.values()) for step, seconds in steps.items()}


def random_scene(name: str, robot: Robot, rng: np.random.Generator) -> Scene:
    """Return a scene with obstacles within the robot's reach, clear of it where it stands, and two free ends."""
    rest = standing(name, robot, rng)
    alone = Scene(robot=RobotSpec(name=name), start=rest, goal=rest)
    reach = max(0.3, float(np.abs([p for q in robot.draw(rng, 20) for p in positions(robot, q)]).max()))
    obstacles: list[Obstacle] = []
    for i in range(OBSTACLES):
        size = rng.uniform(0.03, 0.15) * reach
        shape = Box(tuple((2 * size * rng.uniform(0.5, 1.0, 3)).tolist())) if i % 2 else Sphere(size)
        for direction, far in zip(rng.normal(size=(PLACES, 3)), rng.uniform(0.4, 1.0, PLACES), strict=True):
            place = direction / np.linalg.norm(direction) * far * reach
            placed = Obstacle(f"obstacle{i}", shape, Pose(tuple(place.tolist())))
            if is_free(replace(alone, obstacles=(placed,)), robot)(rest):
                obstacles.append(placed)
                break
    scene = replace(alone, obstacles=tuple(obstacles))
    free = is_free(scene, robot)
    for spread in SPREADS:
        around = (rest + spread * (q - rest) for q in robot.draw(rng, TRIES))
        ends = list(itertools.islice(filter(free, around), 2))
        if len(ends) == 2:
            return scene.with_start(ends[0]).with_goal(ends[1])
    raise InputError(f"fewer than two of {TRIES} configurations are free, even within {SPREADS[-1]:g} of a free one")


def standing(name: str, robot: Robot, rng: np.random.Generator) -> np.ndarray:
    """Return a configuration in which the robot touches nothing of itself: a named state, all joints at 0 or in the
    middle of their limits, or else what comes of the best of them when some joints at a time are drawn again."""
    zero = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
    bounded = np.isfinite(robot.lower) & np.isfinite(robot.upper)
    middle = np.where(bounded, np.where(bounded, robot.lower + robot.upper, 0.0) / 2, zero)
    states, names = robot.named_states.values(), robot.joint_names
    named = [np.array([values.get(joint, zero[i]) for i, joint in enumerate(names)]) for values in states]
    certifier = Certifier(Setup.of(Scene(robot=RobotSpec(name=name), start=zero, goal=zero), robot))
    known = [np.clip(q, robot.lower, robot.upper) for q in (*named, zero, middle)]
    best: np.ndarray
    best, least = min(((q, certifier.contacts(q)) for q in known), key=lambda each: len(each[1]))
    for drawn in robot.draw(rng, TRIES):
        if not least:
            return best
        trial = np.where(rng.random(robot.n) < CHANGED, drawn, best)
        if len(found := certifier.contacts(trial)) <= len(least):
            best, least = trial, found
    if not least:
        return best
    pairs = ", ".join(f"{contact.link} and {contact.other}" for contact in least)
    raise InputError(f"it touches itself wherever it was tried ({TRIES} times); in the best place {pairs} touch")


def is_free(scene: Scene, robot: Robot) -> Callable[[np.ndarray], bool]:
    """Return whether a configuration touches nothing, as a function of it."""
    certifier = Certifier(Setup.of(scene, robot))
    return lambda q: not certifier.contacts(q)


def positions(robot: Robot, q: np.ndarray) -> list[np.ndarray]:
    """Return the positions of all frames' origins [m]."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.pin_q(q))
    return [pose.translation.copy() for pose in data.oMf]


def alone(name: str, motions: int, seed: int, limit: float) -> list[str]:
    """Return a robot's row, or why it has none, from a process of its own with an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        started = partial(begin, cache, int(limit))
        with ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=started) as pool:
            try:
                found: list[str] = pool.submit(row, name, motions, seed).result()
                return found
            except BrokenProcessPool:
                return [name, f"ended after {limit:g} s of processor time"]
            except HdplanError as error:
                return [name, str(error)]


def begin(cache: str, limit: int) -> None:
    """Begin a process with a cache of its own and a limit of processor time [s]."""
    os.environ["HDPLAN_CACHE"] = cache
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))


def line(cells: list[str]) -> str:
    return f"| {' | '.join([*cells, *[''] * (len(HEAD) - len(cells))])} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--motions", type=int, default=5)
    parser.add_argument("--limit", type=float, default=300.0, help="seconds of processor time for a robot")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(line(list(HEAD)))
    print(f"|{' --- |' * len(HEAD)}")
    for name in given.names or robot_names():
        print(line(alone(name, given.motions, given.seed, given.limit)), flush=True)


if __name__ == "__main__":
    main()
