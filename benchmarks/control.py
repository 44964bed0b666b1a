"""The controller measured: solvers of its quadratic program, time of one step, and contacts from random starts.

    python benchmarks/control.py solvers | steps | updates | starts [--starts 1000]

`solvers` needs quadprog, piqp, proxsuite and osqp beside daqp (pip install them; hdplan needs daqp alone). `starts`
proves every simulated motion by the certificate, between its samples too: real meshes, the scene's own shapes.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from cells import milliseconds

from hdplan.control import BarrierSettings, Controller, ControlSettings, PoseTask, simulate, standing
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Array
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.obstacles import Obstacle, SteadyMotion
from hdplan.scenes.poses import Pose
from hdplan.scenes.robot_spec import RobotSpec
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Shape, Sphere
from hdplan.scenes.targets import JointTarget, PoseTarget

Solver = Callable[[Array, Array, Array, Array, Array, Array], Array]

RATE, SPEED = 200.0, 0.5  # [Hz] of the random starts, and share of the speed limits
READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)


def random_scene(rng: np.random.Generator, count: int) -> Scene:
    """Return a Panda among obstacles of every kind, none within 25 cm of its base."""
    obstacles = []
    for index in range(count):
        a, b, c = rng.uniform(0.03, 0.15, 3).tolist()
        shapes: tuple[Shape, ...] = (Box((2 * a, 2 * b, 2 * c)), Sphere(a), Cylinder(a, 2 * b), Capsule(a / 2, 2 * b))
        turn, direction = rng.normal(size=4), rng.normal(size=3)
        where = direction / np.linalg.norm(direction) * rng.uniform(0.35, 0.9)
        pose = Pose((where[0], where[1], abs(where[2]) + 0.05), tuple((turn / np.linalg.norm(turn)).tolist()))
        obstacles.append(Obstacle(f"body{index}", shapes[index % 4], pose))
    ends = (JointTarget("start", READY), JointTarget("goal", READY))
    return Scene("random", Path("random"), RobotSpec("panda"), tuple(obstacles), *ends)


def starts(count: int) -> None:
    """Count contacts over simulated motions from random collision-free starts toward random targets."""
    rng, settings = np.random.default_rng(0), ControlSettings(period=1.0 / RATE, speed=SPEED)
    verdicts: Counter[str] = Counter()
    modes: Counter[str] = Counter()
    least, begun_inside, reached = np.inf, 0, 0
    robot, promise = load_scene_robot(random_scene(rng, 0)), ""
    for number in range(count):
        scene, certifier, q = free_start(rng, robot)
        controller = Controller.of(scene, settings, robot)
        promise = "nothing" if controller.assured is None else f"{1e3 * controller.assured:.1f} mm"
        run = simulate(controller, q, task(rng, robot, number), 3.0)
        begun_inside += bool(len(run.slacks)) and run.slacks[0] < 0
        reached += run.met is not None
        modes.update(mode.value for mode in run.modes)
        if len(run.positions) < 2:
            verdicts["no motion"] += 1
            continue
        moved = np.append(True, np.abs(np.diff(run.positions, axis=0)).max(axis=1) > 0)
        rows = run.positions[moved] if moved.sum() > 1 else run.positions[:2]
        certificate = certifier.certify(Trajectory(robot.joint_names, rows, robot.locked), check_ends=False)
        verdicts[certificate.status.value] += 1
        if certificate.clearance is not None and run.slacks[0] >= 0:
            least = min(least, certificate.clearance)
    rows = [
        (f"starts at {RATE:g} Hz and {SPEED:g} of the speed limits", count),
        *((f"of their motions, by the certificate: {status}", number) for status, number in verdicts.items()),
        ("starts inside a margin", begun_inside),
        ("targets reached in 3 s", reached),
        *((f"periods: {mode}", f"{number:,}") for mode, number in modes.items()),
        ("least proven clearance of motions from outside every margin", f"{1e3 * least:.1f} mm"),
        ("clearance that the rule promises", promise),
    ]
    print(markdown_text([{"of the controller": words, "found": value} for words, value in rows]))


def free_start(rng: np.random.Generator, robot: Robot, count: int | None = None) -> tuple[Scene, Certifier, Array]:
    """Return a random scene of 3 to 10 obstacles, or of so many, and a configuration that touches nothing, exactly."""
    while True:  # another scene where the shoulder itself is in the way
        scene = random_scene(rng, int(rng.integers(3, 11)) if count is None else count)
        certifier = Certifier(Setup.of(scene, robot))
        for q in robot.draw(rng, 30):
            if not certifier.contacts(q):
                return scene, certifier, q


def task(rng: np.random.Generator, robot: Robot, number: int) -> Any:
    """Return a random configuration, or a pose, as the target."""
    if number % 2:
        return replace(standing(robot.draw(rng, 1)[0], gain=4.0), tolerance=0.05)
    turn, way = rng.normal(size=4), rng.uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 0.9])
    pose = Pose(tuple(way.tolist()), tuple((turn / np.linalg.norm(turn)).tolist()))
    return PoseTask(robot, PoseTarget("panda_hand", pose, 0.01, 0.05, field="target"), gain=4.0)


def steps(obstacles: int = 10, runs: int = 20) -> None:
    """Time single steps."""
    rows = []
    exact = BarrierSettings("euclidean", growth=0.0, self_growth=0.0)
    for name, settings in (
        ("HD-SDF", ControlSettings()),
        ("HD-SDF, without the look-ahead", ControlSettings(look_ahead=False)),
        ("exact Euclidean distance", ControlSettings(exact, 0.01, 0.005)),
    ):
        rng = np.random.default_rng(1)
        robot = load_scene_robot(random_scene(rng, 0))
        distance, program, whole, cpu, pairs = [], [], [], [], 0
        for number in range(runs):
            scene, _, q = free_start(rng, robot, obstacles)
            controller, goal = Controller.of(scene, settings, robot), task(rng, robot, number)
            pairs, last = controller.barriers.count, None
            for _ in range(100):
                began, used = perf_counter(), process_time()
                step = controller.step(q, goal, 0.0, last)
                cpu.append(process_time() - used)
                whole.append(perf_counter() - began)
                distance.append(step.distance_seconds)
                program.append(step.program_seconds)
                q, last = q + settings.period * step.velocity, step.command
        late = (100.0 * np.mean(np.array(cpu) > over) for over in (1e-3, 2e-3))
        row = {
            f"a Panda, {obstacles} obstacles": name,
            "pairs": pairs,
            "distance, median [ms]": 1e3 * float(np.median(distance)),
            "quadratic program, median [ms]": 1e3 * float(np.median(program)),
            "step, median / 95 % / worst [ms]": _spread(whole),
            "CPU time of a step [ms]": _spread(cpu),
            "over 1 ms / 2 ms [%]": " / ".join(f"{share:.2f}" for share in late),
        }
        rows.append(row)
    print(markdown_text(rows))


def updates(count: int = 20) -> None:
    """Time the controller's update of its world."""
    rng = np.random.default_rng(2)
    table = np.column_stack([rng.uniform((0.3, -1.0), (1.2, 1.0), (50_000, 2)), np.zeros(50_000)])
    wall = np.column_stack([np.full(50_000, 1.2), rng.uniform((-1.0, 0.0), (1.0, 1.2), (50_000, 2))])
    room = np.vstack([table, wall])
    places, sizes = rng.uniform((-0.8, -0.8, 0.1), (0.8, 0.8, 1.5), (20, 3)), rng.uniform(0.05, 0.2, (20, 3))

    def boxes(moving: bool) -> list[Obstacle]:
        motion = SteadyMotion((0.1, 0.0, 0.0)) if moving else None
        off = rng.normal(0.0, 0.01, places.shape)
        return [Obstacle(f"box{i}", Box(sizes[i]), Pose(places[i] + off[i]), motion=motion) for i in range(20)]

    def cloud(points: Array) -> list[Obstacle]:
        return [Obstacle("cloud", Cloud(points, 0.005))]

    controller, rows = Controller.of(random_scene(rng, 0)), []
    looks: dict[str, Callable[[], list[Obstacle]]] = {
        "20 boxes": lambda: boxes(moving=False),
        "20 boxes that move": lambda: boxes(moving=True),
        "100,000 points of a table and a wall": lambda: cloud(room + rng.normal(0.0, 1e-3, room.shape)),
        "50,000 points that fill a room": lambda: cloud(rng.uniform(-1.0, 1.0, (50_000, 3))),
    }
    for name, look in looks.items():
        used, step_used, pairs = list[float](), list[float](), 0
        for _ in range(count):
            seen = look()
            began = process_time()
            updated = controller.update(seen)
            used.append(process_time() - began)
            began, pairs = process_time(), updated.barriers.count
            updated.step(np.array(READY), standing(np.array(READY)))
            step_used.append(process_time() - began)
        times = {"CPU time of update, median / 95 % / worst [ms]": used, "of the step after it": step_used}
        spreads = {words: _spread(seconds) for words, seconds in times.items()}
        rows.append({"what is seen": name, "pairs": pairs} | spreads)
    print(markdown_text(rows))


def solvers() -> None:
    """Time the quadratic program alone, 7 joints and bounds on them."""
    missing = [name for name in SOLVERS if importlib.util.find_spec(name) is None]
    if missing:
        sys.exit(f"not installed: {', '.join(missing)}")
    rng, lines = np.random.default_rng(0), []
    for rows in (20, 60, 100):
        problems = []
        for _ in range(200):
            jacobian = rng.normal(size=(6, 7))
            matrix, bound = 0.3 * rng.normal(size=(rows, 7)), -0.5 * rng.uniform(0.0, 0.3, rows)
            problems.append((jacobian.T @ jacobian + 0.01 * np.eye(7), 0.5 * rng.normal(size=7), matrix, bound))
        first: list[Array] = []
        for name, solve in SOLVERS.items():
            seconds, answers = [], []
            for hessian, linear, matrix, bound in problems:
                began = process_time()
                answers.append(solve(hessian, linear, matrix, bound, np.full(7, -0.5), np.full(7, 0.5)))
                seconds.append(process_time() - began)
            first = first or answers
            error = max(float(np.abs(a - b).max()) for a, b in zip(first, answers, strict=True))
            row = {"rows": rows, "solver": name, "CPU time, median / 95 % / worst [ms]": _spread(seconds)}
            lines.append(row | {"largest difference from the first": f"{error:.0e}"})
    print(markdown_text(lines))


def _spread(seconds: list[float]) -> str:
    return milliseconds(seconds, (0.5, 0.95, 1.0), 3)


def _daqp(hessian: Array, linear: Array, matrix: Array, bound: Array, low: Array, high: Array) -> Array:
    import daqp

    upper = np.concatenate([high, np.full(len(matrix), 1e30)])
    sense = np.zeros(len(upper), dtype=np.int32)
    return np.array(daqp.solve(hessian, linear, matrix, upper, np.concatenate([low, bound]), sense)[0])


def _quadprog(hessian: Array, linear: Array, matrix: Array, bound: Array, low: Array, high: Array) -> Array:
    import quadprog

    rows = np.vstack([matrix, np.eye(7), -np.eye(7)])
    return np.asarray(quadprog.solve_qp(hessian, -linear, rows.T, np.concatenate([bound, low, -high]))[0])


def _piqp(hessian: Array, linear: Array, matrix: Array, bound: Array, low: Array, high: Array) -> Array:
    import piqp

    solver = piqp.DenseSolver()
    solver.settings.verbose = False
    solver.setup(hessian, linear, None, None, matrix, bound, None, low, high)
    solver.solve()
    return np.array(solver.result.x)


def _proxsuite(hessian: Array, linear: Array, matrix: Array, bound: Array, low: Array, high: Array) -> Array:
    import proxsuite

    rows, upper = np.vstack([matrix, np.eye(7)]), np.concatenate([np.full(len(matrix), 1e20), high])
    result = proxsuite.proxqp.dense.solve(
        H=hessian, g=linear, A=None, b=None, C=rows, l=np.concatenate([bound, low]), u=upper, eps_abs=1e-9
    )
    return np.array(result.x)


def _osqp(hessian: Array, linear: Array, matrix: Array, bound: Array, low: Array, high: Array) -> Array:
    import osqp
    from scipy.sparse import csc_matrix

    solver = osqp.OSQP()
    rows, upper = csc_matrix(np.vstack([matrix, np.eye(7)])), np.concatenate([np.full(len(matrix), np.inf), high])
    lower = np.concatenate([bound, low])
    solver.setup(csc_matrix(hessian), linear, rows, lower, upper, verbose=False, eps_abs=1e-7, eps_rel=1e-7,
                 max_iter=20000)  # fmt: skip
    return np.array(solver.solve().x)


SOLVERS: dict[str, Solver] = {
    **{"daqp": _daqp, "quadprog": _quadprog, "piqp": _piqp, "proxsuite": _proxsuite, "osqp": _osqp}
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("solvers", "steps", "updates", "starts"))
    parser.add_argument("--starts", type=int, default=1000)
    given = parser.parse_args()
    if given.what == "starts":
        starts(given.starts)
    else:
        {"solvers": solvers, "steps": steps, "updates": updates}[given.what]()


if __name__ == "__main__":
    main()
