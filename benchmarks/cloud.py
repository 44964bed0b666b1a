"""Plan real problems whose obstacles are only known as points, as cameras would give them, and re-check each motion
by brute force over every point.

    python benchmarks/cloud.py DIR [--robot panda] [--every K] [--view all|cameras] [--points N ...] [--no-recheck]

DIR as of mbm.py. `all`: the obstacles' surfaces, sampled every 5 mm from all sides. `cameras`: what three cameras see
of them, with 2 mm of noise along the ray and 1 % of the points up to 5 cm off. `--points` is the number of points in
place of a spacing of 5 mm. Each point is a ball of 5 mm. A cloud is written to a .ply file; reading it counts. "Next
cloud": the same points with 0.5 mm of noise, planned for by `hdplan.plan` with the motion as guess, to the proof.
"Controller": the time of its steps while it follows the motion through the cloud, 200 steps a second for 2 s. The
memory is the most so far. Prints a table; to the error stream, a line per problem.
"""

from __future__ import annotations

import contextlib
import itertools
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from cells import milliseconds
from memory import most_memory
from problems import RealProblem, problem_parser, real_problems
from recheck import touching

import hdplan
from hdplan import control
from hdplan.planner.geometry.opened import opened
from hdplan.planner.studies.report import markdown_text
from hdplan.planner.view.drawing.skins import obstacle_mesh
from hdplan.scenes.array_types import Array

SPACING, RADIUS = 0.005, 0.005  # [m]
NOISE, OUTLIERS, OFF = 0.002, 0.01, 0.05  # [m] along the ray, share of the points, [m] by at most which these are off
JITTER = 0.0005  # [m] by which points of the next cloud are elsewhere
CAMERAS = ((1.6, 1.2, 1.4), (1.6, -1.2, 1.4), (-0.4, 0.0, 2.2))  # [m] three eyes, around the robot
TIMES = {"read + build + solve": "plan", "certificate": "certify", "next cloud": "next"}
AIM = (0.5, 0.0, 0.5)
FOLLOWED, WARM = 2.0, 5  # [s], steps
PIXELS, OPENING = 480, np.radians(60.0)  # along both sides of each picture, and its opening


def surfaces(scene: hdplan.Scene, count: int | None, seed: int) -> Array:
    """Points on all obstacles' surfaces (m, 3) in the world."""
    rng = np.random.default_rng(seed)
    meshes = []
    for each in opened(scene).obstacles:
        mesh = obstacle_mesh(each)
        meshes.append(trimesh.Trimesh(mesh.vertices, mesh.triangles).apply_transform(each.pose.matrix))
    whole = trimesh.util.concatenate(meshes)
    wanted = count or int(whole.area / SPACING**2)
    return np.asarray(trimesh.sample.sample_surface(whole, wanted, seed=rng.integers(1 << 31))[0])


def seen(points: Array, seed: int) -> Array:
    """View of depth cameras of densely sampled surfaces: the nearest point of each pixel, with noise."""
    rng, found = np.random.default_rng(seed), []
    for eye in np.array(CAMERAS):
        ahead = (AIM - eye) / np.linalg.norm(AIM - eye)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        local = (points - eye) @ np.stack([right, np.cross(ahead, right), ahead], axis=1)
        pixel = np.floor((local[:, :2] / local[:, 2:] / np.tan(0.5 * OPENING) + 1.0) * 0.5 * PIXELS).astype(np.int64)
        inside = ((pixel >= 0) & (pixel < PIXELS)).all(axis=1) & (local[:, 2] > 0.1)
        key, depth = pixel[inside] @ [PIXELS, 1], local[inside, 2]
        order = np.lexsort((depth, key))
        first = order[np.concatenate([[True], np.diff(key[order]) > 0])]
        shown = points[inside][first]
        ray = (shown - eye) / np.linalg.norm(shown - eye, axis=1, keepdims=True)
        off = rng.normal(scale=NOISE, size=len(shown))
        off += np.where(rng.random(len(shown)) < OUTLIERS, rng.uniform(-OFF, OFF, len(shown)), 0.0)
        found.append(shown + off[:, None] * ray)
    return np.concatenate(found)


def run(problem: RealProblem, view: str, count: int | None, check: bool, limit: float, folder: Path) -> dict[str, Any]:
    """Plan one problem, the reading of its cloud's file included."""
    scene = problem.load()
    if view == "all":
        points = surfaces(scene, count, 0)
    else:
        points = seen(surfaces(scene, 8 * (count or 100_000), 0), 1)
        points = points[:: max(1, len(points) // (count or len(points)))]
    file = folder / "scan.ply"
    trimesh.PointCloud(points).export(file)
    scan = replace(scene, obstacles=(hdplan.Obstacle("scan", hdplan.Cloud(file, RADIUS)),))
    began = time.perf_counter()
    try:
        result = hdplan.plan(scan, time_limit=limit)
    except hdplan.InputError as error:
        return {"points": len(points), "status": "refused", "words": str(error)}
    whole = time.perf_counter() - began
    found: dict[str, Any] = {
        "points": len(points),
        "status": result.certificate.status.value,
        "words": result.certificate.text,
        "plan": whole - result.times.certify,
        "certify": result.times.certify,
        "attempts": result.attempts,
    }
    if result.certified:
        moved = points + np.random.default_rng(2).normal(scale=JITTER, size=points.shape)
        scan = replace(scene, obstacles=(hdplan.Obstacle("scan", hdplan.Cloud(moved, RADIUS)),))
        began = time.perf_counter()
        with contextlib.suppress(hdplan.InputError):  # a close end may be in contact now
            hdplan.plan(scan, time_limit=limit, guess=result.trajectory)
            found["next"] = time.perf_counter() - began
        found["steps"] = steps_along(scan, result.trajectory)
    if check and result.certified:
        result.save(folder / "motion.json")
        kept = trimesh.load(file).vertices  # as single precision has them
        hit = touching(folder / "motion.json", problem.request_file, problem.robot_file, np.asarray(kept), RADIUS)
        found["recheck"] = f"refuted: {hit}" if hit else "free"
    return found


def steps_along(scene: hdplan.Scene, motion: hdplan.Trajectory) -> Array:
    """Follow a motion by the controller, at one pace; return how long its steps take [s], without the first ones."""
    controller, rows = control.Controller.of(scene), motion.positions
    pace, period, times = (len(rows) - 1) / FOLLOWED, controller.settings.period, []

    def wanted(at: float) -> tuple[Array, Array]:
        first = min(int(at * pace), len(rows) - 2)
        speed = (rows[first + 1] - rows[first]) * pace
        return rows[first] + speed * (at - first / pace), speed

    task, q = control.TrackTask(wanted, end=FOLLOWED), rows[0]
    for step in range(int(FOLLOWED / period)):
        began = time.perf_counter()
        command = controller.step(q, task, step * period)
        times.append(time.perf_counter() - began)
        q = q + period * command.velocity
    return np.array(times[WARM:])


def main() -> None:
    """Plan, print."""
    parser = problem_parser(__doc__)
    parser.add_argument("--view", choices=("all", "cameras"), action="append")
    parser.add_argument("--points", type=int, nargs="*")
    parser.add_argument("--no-recheck", action="store_true")
    options = parser.parse_args()
    rows = []
    for robot in options.robot or ["panda"]:
        problems = real_problems(options.folder, robot, options.every, options.set)
        for view, count in itertools.product(options.view or ["all", "cameras"], options.points or [None]):
            done = []
            with tempfile.TemporaryDirectory() as temporary:
                for problem in problems:
                    got = run(problem, view, count, not options.no_recheck, options.time_limit, Path(temporary))
                    done.append(got)
                    figures = " ".join(f"{key} {value:.3f}" for key, value in got.items() if isinstance(value, float))
                    words = problem.set, problem.number, view, got["points"], got["status"], figures, got.get("recheck")
                    print(*words, got["words"] if got["status"] != "certified" else "", file=sys.stderr, flush=True)
            certified = [got for got in done if got["status"] == "certified"]
            row = {
                "robot": robot,
                "view": view,
                "points, median": f"{np.median([got['points'] for got in done]):.0f}",
                "certified": f"{len(certified)} of {len(done)}",
                "ends in contact": sum(got["status"] == "refused" for got in done),
                "refuted": "–" if options.no_recheck else sum("refuted" in got["recheck"] for got in certified),
            }
            for title, key in TIMES.items():
                row[f"{title}, median / 95 % [ms]"] = milliseconds([got[key] for got in certified if key in got])
            steps = np.concatenate([np.empty(0), *(got["steps"] for got in certified)])
            row["controller, a step, median / 99 % [ms]"] = milliseconds(steps, (0.5, 0.99), 1)
            rows.append(row | {"memory [MB]": most_memory() // 2**20})
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
