"""Random requests within limits of torque, with a link upright, or with a point in a box: all that can be done?

    python benchmarks/constrained.py [--requests N] [--from J] [--kinds torque upright position] [--limit S] [--dense S]
    [--processor-time]

Each request has a robot (Panda, UR5) among random boxes, ends that are free and allowed, a tolerance, a box or a load
and torque limits of its own, and is drawn with its number as the seed. Half of the goals are poses, and half of the
motions with path constraints are timed. Each is planned within --limit seconds; what is not certified then gets a
dense search (`dense_search.py`) of --dense seconds to the configurations that may be its goal, and what that finds is
certified as it is, or planned from as a guess. Requests that are certified only so are those that planning missed; of
those without a way nothing is known. Prints a row for each kind, and the missed ones by number.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from cells import quantiles
from dense_search import DenseSearch
from problems import pose_of
from processor_time import add_processor_time, set_clock
from scipy.spatial.transform import Rotation

import hdplan
from hdplan.planner.build import problem_of
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import goal_choice, may_end
from hdplan.planner.search.roadmap import onto_path
from hdplan.planner.studies.report import Cell, markdown_text
from hdplan.planner.timing.retiming import Retimer
from hdplan.scenes.array_types import Array
from hdplan.scenes.attached import Payload
from hdplan.scenes.limits import Limits
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.path_constraints import PathConstraints, Upright, Within
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.targets import JointTarget, PoseTarget

KINDS = ("torque", "upright", "position")
ROBOTS = (("panda_carry", "panda_hand", (1.0, 6.0)), ("ur5_table", "tool0", (2.0, 8.0)))  # scene, link, loads [kg]
TOOL = (0.0, 0.0, 0.1)  # [m] of the load's centre, and of the point that stays in a box, in the link's frame
BOXES = 5  # among which a robot stands, beside the floor
DRAWN, APART = 256, 1.5  # configurations drawn for ends; between these [rad]
RATES = Limits(velocity="urdf", acceleration=10.0, jerk=500.0)


@dataclass(frozen=True)
class Outcome:
    """Outcome of one request."""

    number: int
    certified: bool  # by planning
    seconds: float
    dense: str  # the verdict of the dense search, if it was run


def request(kind: str, number: int) -> Scene:
    """Return a request: the same for the same kind and number."""
    rng = np.random.default_rng([KINDS.index(kind), number])
    name, link, loads = ROBOTS[number % len(ROBOTS)]
    bare = replace(hdplan.load_scene(name), attached=(), obstacles=())
    while True:
        scene = replace(bare, obstacles=clutter(rng))
        match kind:
            case "torque":
                scene = heavy(scene, link, loads, rng)
            case "upright":
                tolerance = float(np.exp(rng.uniform(np.log(0.02), np.log(0.4))))
                scene = replace(scene, path=PathConstraints(Upright(link, (0.0, 0.0, -1.0), tolerance)))
            case _:
                scene = replace(scene, path=PathConstraints(position=box(scene, link, rng)))
        if kind != "torque" and number // 4 % 2:
            scene = replace(scene, limits=RATES)
        if (both := ends(scene, rng)) is not None:
            break
    start, goal = both
    scene = replace(scene, start=JointTarget("start", tuple(start.tolist())))
    if number // 2 % 2:
        return scene.with_goal(PoseTarget(link, pose_of(load_scene_robot(scene), link, goal), field="goal"))
    return replace(scene, goal=JointTarget("goal", tuple(goal.tolist())))


def clutter(rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """A floor, and boxes around the robot."""
    found = [Obstacle("floor", Box((3.0, 3.0, 0.1)), Pose((0.0, 0.0, -0.15)))]
    for i in range(BOXES):
        angle, away, up = rng.uniform(-np.pi, np.pi), rng.uniform(0.35, 0.85), rng.uniform(0.0, 0.9)
        place = (away * np.cos(angle), away * np.sin(angle), up)
        turn = Rotation.from_euler("z", rng.uniform(0.0, np.pi)).as_quat()
        found.append(Obstacle(f"box{i}", Box(tuple(rng.uniform(0.05, 0.35, 3))), Pose(place, turn)))
    return tuple(found)


def heavy(scene: Scene, link: str, loads: tuple[float, float], rng: np.random.Generator) -> Scene:
    """The scene with a load, and torque limits of so much of the URDF's."""
    robot = load_scene_robot(scene)
    torque = tuple((rng.uniform(0.6, 1.0) * np.asarray(robot.model.effortLimit)).tolist())
    limits = replace(RATES, torque=torque)
    return replace(scene, limits=limits, payload=Payload(link, float(rng.uniform(*loads)), TOOL))


def box(scene: Scene, link: str, rng: np.random.Generator) -> Within:
    """A box around a place that the tool reaches, turned anyhow, infinite along some axes."""
    robot = load_scene_robot(scene)
    size = np.where(rng.random(3) < 0.5, inf, np.exp(rng.uniform(np.log(0.004), np.log(0.4), 3)))
    if np.isinf(size).all():
        size[0] = 0.02
    centre = pose_of(robot, link, robot.draw(rng, 1)[0]).matrix @ np.array([*TOOL, 1.0])
    return Within(link, tuple(size.tolist()), Pose(centre[:3], Rotation.random(random_state=rng).as_quat()), TOOL)


def ends(scene: Scene, rng: np.random.Generator) -> tuple[Array, Array] | None:
    """Two configurations in which a motion of the scene may begin and end; None where few are found."""
    robot = load_scene_robot(scene)
    drawn = robot.draw(rng, DRAWN)
    start, goal = (JointTarget(field, tuple(q.tolist())) for field, q in zip(("start", "goal"), drawn, strict=False))
    setup = Setup.of(replace(scene, start=start, goal=goal), robot)
    if scene.path != PathConstraints():
        drawn = onto_path(problem_of(setup), drawn)
    certifier = Certifier(setup)
    fit = (q for q in drawn if may_end(certifier, q))
    first = next(fit, None)
    if first is None:
        return None
    last = next((q for q in fit if np.linalg.norm(q - first) >= APART), None)
    return None if last is None else (first, last)


# --- planning ---------------------------------------------------------------------------------------------------------


def run(kind: str, number: int, limit: float, dense: float) -> Outcome:
    """Plan one request, and search for it where that fails."""
    scene, began = request(kind, number), time.perf_counter()
    try:
        result = hdplan.plan(scene, time_limit=limit)
        certified, why = result.certified, result.certificate.text
    except hdplan.InputError as error:
        certified, why = False, str(error)
    seconds = time.perf_counter() - began
    found = "" if certified else searched(scene, dense)
    words = f"{seconds:.2f} s" + ("" if certified else f", {why.split(':')[0]}; dense search: {found}")
    print(f"{kind} {number}: {'certified' if certified else 'not certified'}, {words}", file=sys.stderr, flush=True)
    return Outcome(number, certified, seconds, found)


def searched(scene: Scene, seconds: float) -> str:
    """Say whether a dense search finds a motion, and how it was certified."""
    try:
        goals = goal_choice(Certifier(Setup.of(scene))).goals
    except hdplan.InputError:
        return "no goal"
    until, way = time.perf_counter() + seconds, None
    for left, goal in zip(range(len(goals), 0, -1), goals, strict=True):
        setup = Setup.of(scene).aiming_at(goal)
        way = DenseSearch(problem_of(setup), (until - time.perf_counter()) / left).run()
        if way is not None:
            break
    if way is None:
        return "no way"
    robot = setup.robot
    motion = Trajectory(robot.joint_names, way, robot.locked)
    try:
        timed = Retimer(setup)(motion).trajectory if scene.timed else motion
        if Certifier(setup).certify(timed).certified:
            return "certified as it is"
    except hdplan.HdplanError:
        pass
    again = hdplan.plan(scene, guess=motion, time_limit=seconds)
    return "certified from its way" if again.certified else f"a way, not certified ({again.certificate.status.value})"


def row(kind: str, found: list[Outcome]) -> dict[str, Cell]:
    """Sum up the requests of one kind."""
    missed = [outcome for outcome in found if outcome.dense.startswith("certified")]
    return {
        "kind": kind,
        "requests": len(found),
        "certified": sum(outcome.certified for outcome in found),
        "missed": " ".join([f"{len(missed)}", *(f"({outcome.number})" for outcome in missed)]),
        "a way, not certified": sum(outcome.dense.startswith("a way") for outcome in found),
        "no way known": sum(outcome.dense.startswith("no") for outcome in found),
        "time median / p95 [s]": quantiles([outcome.seconds for outcome in found], digits=2),
    }


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--requests", type=int, default=50, help="of each kind")
    parser.add_argument("--from", type=int, default=0, dest="first", help="number of the first")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--limit", type=float, default=5.0, help="[s] of planning")
    parser.add_argument("--dense", type=float, default=60.0, help="[s] of a dense search")
    add_processor_time(parser)
    options = parser.parse_args()
    set_clock(options)
    numbers = range(options.first, options.first + options.requests)
    found = {kind: [run(kind, number, options.limit, options.dense) for number in numbers] for kind in options.kinds}
    print(markdown_text([row(kind, outcomes) for kind, outcomes in found.items()]))


if __name__ == "__main__":
    main()
