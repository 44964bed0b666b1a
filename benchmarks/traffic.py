"""Crossing traffic: random scenes in which things move through the robot's way, and how they are planned.

    python benchmarks/traffic.py [--scenes 50] [--seed 0] [--time-limit 10]

Panda and UR5 in turn, one to four movers: boxes, plates, spheres and hooks (a mesh that is not convex) that go straight
on, on a circle, or from pose to pose. Every scene is built around a motion that solves it with 20 mm to spare, by the
certificate, and is kept only if the straight line at its usual pace is hit.

* *wait*, 2 of 4 scenes: a fence through the robot's base, with a beam above, parts start and goal; a gate in it opens
  late, and in every third scene closes again. The motion is the straight line, begun when the gate opens.
* *hurry*, 1 of 4: the same backwards in time. The gate closes early.
* *around*, 1 of 4: each mover comes to where the arm is on the straight line, when it is. The motion makes a bend.

Times are of the processor. Prints a table; to the error stream, a line for each scene.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from cells import quantiles
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.studies.report import markdown_text
from hdplan.planner.timing.retiming import Retimer
from hdplan.planner.timing.time_laws import MinimumJerk
from hdplan.scenes.array_types import Array
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Mesh, Shape, Sphere
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import shipped_scenes

HOOK = shipped_scenes()["empty"].with_name("hook.obj")
WAYPOINTS = 40
SPARE = 0.02  # [m] that the built motion keeps from everything
LOOKS = 60  # times at which a mover is tested, before the certificate judges the whole scene
ROBOTS, KINDS = ("panda", "ur5"), ("around", "hurry")
READY = {  # postures that reach ahead of the base
    "panda": (0.0, 0.3, 0.0, -1.9, 0.0, 2.2, 0.785),
    "ur5": (0.0, -1.2, 1.6, -1.9, -1.571, 0.0),
}
FLOOR = Obstacle("floor", Box((3.0, 3.0, 0.1)), Pose((0.0, 0.0, -0.06)))
BEAM = Obstacle("beam", Box((0.5, 0.3, 0.1)), Pose((0.0, 0.0, 0.85)))
GAP, REACH, HEIGHT = 0.16, 1.4, 1.6  # [m] of the fence: from the base's axis, outwards, and upwards


@dataclass(frozen=True)
class Traffic:
    """One scene, and how it was built."""

    scene: Scene
    kind: str  # wait, hurry or around
    built: Array  # (N, n) the waypoints of the motion around which it was built


def traffic(seed: int, k: int) -> Traffic:
    """Return scene k of a seed; it depends on these two alone."""
    rng, kind, count = np.random.default_rng([seed, k]), ("wait", KINDS[k // 4 % 2])[k // 2 % 2], 1 + k // 8 % 4
    robot = hdplan.load_robot(ROBOTS[k % 2])
    while True:
        bare, line = _open(rng, robot) if kind == "around" else _gated(rng, robot)
        share = rng.uniform(0.45, 0.75)  # of the time
        built = {"wait": _late, "hurry": _early, "around": _around}[kind](rng, line, share)
        built = np.clip(built, *robot.inner)
        duration = rng.uniform(1.1, 1.6) * max(1.5, _least_duration(bare, robot, built))
        bare = replace(bare, timing=Timing(duration=round(duration, 2)))
        scene = bare if kind == "around" else _with_gate(rng, bare, share, kind == "hurry", k % 3 == 0)
        if not _keeps(scene, robot, built, SPARE):
            continue
        for i in range(len(scene.moving), count):
            movers = _crossing(rng, robot, bare, line, i)
            scene = next(_that_fit(movers, scene, robot, built, line if kind == "around" else None), scene)
        if len(scene.moving) == count and _certified(scene, robot, built) and not _certified(scene, robot, line, 0.0):
            return Traffic(replace(scene, name=f"traffic_{seed}_{k}"), kind, built)


def _open(rng: np.random.Generator, robot: Robot) -> tuple[Scene, Array]:
    """A scene without traffic, and its straight line (N, n), which is far and free."""
    while True:
        start, goal = np.clip(robot.draw(rng, 2), -2.6, 2.6)
        goal = np.clip(start + rng.uniform(1.5, 3.0) * (goal - start) / np.linalg.norm(goal - start), *robot.inner)
        scene = Scene(robot=robot.name, obstacles=[FLOOR], start=start.tolist(), goal=goal.tolist())
        if _free(scene, robot, line := np.linspace(start, goal, WAYPOINTS)):
            return scene, line


def _gated(rng: np.random.Generator, robot: Robot) -> tuple[Scene, Array]:
    """The same with a fence at the robot's back, and a place for a gate along the world's x axis, between the ends."""
    fence = Obstacle("fence", Box((REACH - GAP, 0.04, HEIGHT)), Pose((-(REACH + GAP) / 2, 0.0, HEIGHT / 2)))
    while True:
        ends = READY[robot.name] + rng.normal(scale=0.35, size=(2, robot.n))
        ends[:, 0] = rng.uniform(0.5, 1.2, 2) * rng.permutation([-1.0, 1.0])
        start, goal = np.clip(ends, *robot.inner)
        scene = Scene(robot=robot.name, obstacles=[FLOOR, BEAM, fence], start=start.tolist(), goal=goal.tolist())
        if _free(scene, robot, line := np.linspace(start, goal, WAYPOINTS)):
            return scene, line


def _with_gate(rng: np.random.Generator, scene: Scene, share: float, backwards: bool, closes: bool) -> Scene:
    """The scene with a gate that opens at about a share of the time, and perhaps closes at its end; or backwards."""
    shut = Pose(((REACH + GAP) / 2, 0.0, HEIGHT / 2))
    away = np.array([(REACH, 0.0, 0.0), (0.0, 0.0, HEIGHT), (0.0, 0.0, -HEIGHT)][rng.integers(3)])
    opened = _pose(np.array(shut.position) + away, Rotation.identity())
    shares, poses = share + np.array([-0.1, 0.05]), [shut, opened]
    if closes:
        shares, poses = np.append(shares, [0.92, 1.0]), [*poses, opened, shut]
    if backwards:
        shares, poses = 1 - shares[::-1], poses[::-1]
    motion = TimedPoses((scene.end_time * shares).tolist(), poses)
    gate = Obstacle("gate", Box((REACH - GAP, rng.uniform(0.03, 0.3), HEIGHT)), motion=motion)
    return replace(scene, obstacles=(*scene.obstacles, gate))


def _late(rng: np.random.Generator, line: Array, share: float) -> Array:
    """The straight line (N, n), begun after a share of the time, and then with minimum jerk."""
    law = MinimumJerk(1.0)
    times = law.time_at(np.linspace(0.0, 1.0, len(line)))
    along = law(np.clip((times - share) / (1.0 - share), 0.0, 1.0))[0]
    late: Array = line[0] + along[:, None] * (line[-1] - line[0])
    return late


def _early(rng: np.random.Generator, line: Array, share: float) -> Array:
    """The same backwards in time: its end is reached early."""
    return _late(rng, line[::-1], share)[::-1]


def _around(rng: np.random.Generator, line: Array, share: float) -> Array:
    """A bend (N, n) beside the straight line, farthest from it at a share of the way."""
    bend = rng.normal(size=line.shape[1])
    bend *= rng.uniform(0.8, 1.6) / float(np.linalg.norm(bend))
    u = np.linspace(0.0, 1.0, len(line)) ** (np.log(0.5) / np.log(share))
    way: Array = line + np.sin(np.pi * u)[:, None] ** 2 * bend
    return way


def _least_duration(scene: Scene, robot: Robot, way: Array) -> float:
    """In which no joint exceeds its greatest velocity along waypoints (N, n) with the planner's time law [s]."""
    setup = Setup.of(replace(scene, timing=Timing(duration=1.0)), robot)
    curve = Retimer(setup)(Trajectory(robot.joint_names, way, robot.locked)).trajectory.curve
    return float((curve.over_time(1).largest() / setup.limits["velocity"]).max())


def _free(scene: Scene, robot: Robot, way: Array) -> bool:
    """True if waypoints (N, n) without times keep clear."""
    certifier = Certifier(Setup.of(scene, robot))
    return certifier.certify(Trajectory(robot.joint_names, way, robot.locked), required=SPARE).certified


def _certified(scene: Scene, robot: Robot, way: Array, required: float = SPARE) -> bool:
    """True if the motion in time through waypoints (N, n) is certified."""
    setup = Setup.of(scene, robot)
    return Certifier(setup).certify(_timed(setup, way), required=required).certified


def _timed(setup: Setup, way: Array) -> Trajectory:
    return Retimer(setup)(Trajectory(setup.robot.joint_names, way, setup.robot.locked)).trajectory


def _keeps(scene: Scene, robot: Robot, way: Array, distance: float) -> bool:
    """True if the motion in time through waypoints (N, n) keeps a distance [m] at LOOKS times."""
    setup = Setup.of(scene, robot)
    certifier, shares = Certifier(setup), np.linspace(0.0, 1.0, LOOKS)
    places = zip(_timed(setup, way).at(shares), (scene.end_time * shares).tolist(), strict=True)
    return not any(certifier.too_close(q, distance, when) for q, when in places)


def _that_fit(
    movers: Iterator[Obstacle], scene: Scene, robot: Robot, built: Array, hit: Array | None
) -> Iterator[Scene]:
    """Yield the scene with one of the movers, that keep clear of the built motion (N, n) and hit the other."""
    for mover in movers:
        alone = replace(scene, obstacles=(mover,))
        if _keeps(alone, robot, built, SPARE) and (hit is None or not _keeps(alone, robot, hit, 0.0)):
            yield replace(scene, obstacles=(*scene.obstacles, mover))


def _shape(rng: np.random.Generator) -> Shape:
    kind = rng.integers(4)
    if kind == 0:
        return Sphere(float(rng.uniform(0.08, 0.25)))
    if kind == 1:
        return Box(tuple(rng.uniform(0.1, 0.5, 3).tolist()))
    if kind == 2:
        return Box((0.04, *rng.uniform(0.4, 1.2, 2).tolist()))
    return Mesh(HOOK, scale=float(rng.uniform(1.5, 3.0)))


def _pose(place: Array, turn: Rotation) -> Pose:
    return Pose(tuple(place.tolist()), tuple(turn.as_quat().tolist()))


def _crossing(rng: np.random.Generator, robot: Robot, scene: Scene, line: Array, i: int) -> Iterator[Obstacle]:
    """Yield things that come to where one of the last links is on the straight line, when it is there: straight on,
    from pose to pose, or on a circle."""
    end, kinematics = scene.end_time, kinematics_of(robot)
    for _ in range(100):
        when = rng.uniform(0.25, 0.75) * end
        q = line[0] + MinimumJerk(end)(np.array([when]))[0] * (line[-1] - line[0])
        met = kinematics.evaluate(q[None]).translations[0, -rng.integers(1, 4)] + rng.normal(scale=0.04, size=3)
        turn, kind, shape, name = Rotation.random(random_state=rng), rng.integers(3), _shape(rng), f"mover {i}"
        velocity = rng.normal(size=3) * (1.0, 1.0, 0.4)
        velocity *= rng.uniform(0.2, 0.8) / np.linalg.norm(velocity)
        if kind == 0:
            spin = rng.uniform(-1.0, 1.0, 3)
            begins = _pose(met - when * velocity, Rotation.from_rotvec(-when * spin) * turn)
            yield Obstacle(name, shape, begins, motion=SteadyMotion(velocity.tolist(), spin.tolist()))
            continue
        if kind == 1:
            times = np.array([0.0, when / 2, when, (when + end) / 2, end])
            places = met + np.cumsum(rng.normal(scale=0.35, size=(5, 3)), axis=0)
            places += met - places[2]
            turns = [turn * Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)) for _ in times]
        else:
            times, axis = np.linspace(0.0, end, 13), np.array([0.0, 0.0, rng.choice([-1.0, 1.0])])
            outwards = np.cross(axis, velocity)
            outwards *= rng.uniform(0.4, 1.0) / np.linalg.norm(outwards)
            angles = (times - when) * np.linalg.norm(velocity) / np.linalg.norm(outwards)
            turned = [Rotation.from_rotvec(angle * axis) for angle in angles]
            places = np.array([met - outwards + each.apply(outwards) for each in turned])
            turns = [each * turn for each in turned]
        poses = [_pose(place, each) for place, each in zip(places, turns, strict=True)]
        yield Obstacle(name, shape, motion=TimedPoses(times.tolist(), poses))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--time-limit", type=float, default=10.0)
    given = parser.parse_args()
    plans: dict[str, list[tuple[bool, float, int]]] = {kind: [] for kind in ("wait", *KINDS)}
    for k in range(given.scenes):
        made = traffic(given.seed, k)
        began = time.process_time()
        result = hdplan.plan(made.scene, time_limit=given.time_limit)
        seconds = time.process_time() - began
        plans[made.kind].append((result.certified, seconds, result.attempts))
        movers = ", ".join(type(each.shape).__name__.lower() for each in made.scene.moving)
        line = f"{k:3d} {result.robot:5s} {made.kind:6s} {made.scene.end_time:5.2f} s: {movers}"
        print(f"{line:60s} {seconds:5.2f} s, {result.attempts} attempts, {result.certificate.text}", file=sys.stderr)
    plans["all"] = [plan for each in plans.values() for plan in each]
    print(markdown_text([row(kind, found) for kind, found in plans.items() if found]))


def row(kind: str, plans: list[tuple[bool, float, int]]) -> dict[str, str | int]:
    """Return a row of the table from what was certified, the times [s] and the attempts."""
    certified, seconds, attempts = zip(*plans, strict=True)
    return {
        "scenes": kind,
        "certified": f"{sum(certified)} of {len(plans)}",
        "attempts, median / most": f"{np.median(attempts):g} / {max(attempts)}",
        "plan and proof, median / 95 % / most [s]": quantiles(seconds, (0.5, 0.95, 1.0), 2),
    }


if __name__ == "__main__":
    main()
