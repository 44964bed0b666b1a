"""Sign safety: poses in contact, random and adversarial, at which no rung may read the bodies as apart.

    python benchmarks/sign_safety.py [--count 10000000] [--seed S] [--processes P]

`--count` poses over pairs of Platonic solids, box, capsule, cylinder and link bodies of the Panda and the UR5. Nine
tenths share a point by construction, which needs no oracle: touching, aligned to the last digit or nearly, or
overlapping. One tenth is random, of which those in contact by the exact distance count. Every pose is evaluated by
every rung as generated C, with gamma and shaping length varying.

What floating point allows: poses that touch exactly do not exist in it. Their coordinates are rounded when the pose is
made, and again when corners are turned and subtracted, so that D-tilde may read a touch as a gap of up to 4 units in
the last place (ulp) of the size: the bodies' extents and their distance from the origin. 2.8 ulp is the most that was
found. A violation is a D-tilde or a D beyond that, or a D that is positive where D-tilde is not. Prints a Markdown
table: violations (D-tilde, D, signs), and the largest D-tilde in ulp of the size.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass

import numpy as np
from rich.progress import track

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.bodies import PLATONIC, ConvexBody
from hdplan.distance.normals import RUNGS
from hdplan.distance.studies.random_poses import touching_poses
from hdplan.distance.symbolic.compiled_pair import CompiledDistance, hdsdf_compiled
from hdplan.planner.collision.link_bodies import link_bodies
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Array
from hdplan.scenes.robot_spec import RobotSpec

ULP = float(np.finfo(float).eps)
TOLERANCE = 4 * ULP  # of the size
BATCH = 20_000  # poses at once
RANDOM = 0.1  # share of poses that are not in contact by construction
SETTINGS = {
    rung: setting for rung, setting in zip(RUNGS, ((2, 1e-3), (1, 1e-6), (3, 1e-3), (2, 1e-9), (2, 1e-2)), strict=True)
}


@dataclass
class Count:
    """Results of one rung at poses in contact."""

    separations: int = 0  # D-tilde above the tolerance
    distances: int = 0  # D above the tolerance
    signs: int = 0  # D > 0 where D-tilde <= 0
    largest: float = -np.inf  # D-tilde, in ulp of the size

    def add(self, other: Count) -> None:
        """Take in another's counts."""
        self.separations += other.separations
        self.distances += other.distances
        self.signs += other.signs
        self.largest = max(self.largest, other.largest)

    def __str__(self) -> str:
        """Return the table's cell."""
        return f"{self.separations} / {self.distances} / {self.signs} ({self.largest:.1f})"


def pairs() -> dict[str, tuple[ConvexBody, ConvexBody]]:
    """Return the pairs by name: every body with itself and with the next two of the list."""
    bodies = {name: ConvexBody.platonic(name) for name in PLATONIC}
    bodies |= {"box": ConvexBody.box([1.0, 0.6, 0.1]), "capsule": ConvexBody.capsule(0.15, 0.8)}
    bodies |= {"cylinder": ConvexBody.cylinder(0.3, 0.7)}
    fitted = [link for name in ("ur5", "panda") for link in link_bodies(load_robot(RobotSpec(name)))]
    links = {len(link.body.vertices): link for link in fitted}
    bodies |= {f"{link.link} ({corners} corners)": link.body for corners, link in sorted(links.items())}
    names = list(bodies)
    return {
        f"{first} - {second}": (bodies[first], bodies[second])
        for k, first in enumerate(names)
        for second in (first, names[(k + 1) % len(names)], names[(k + 3) % len(names)])
    }


def contacts(body_a: ConvexBody, body_b: ConvexBody, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Return at most ``count`` poses in contact, (N, 4, 4) each."""
    poses_a, poses_b = touching_poses(body_a, body_b, rng, count)
    size = body_a.reach + body_b.reach
    few = int(RANDOM * count)
    poses_a[:few, :3, 3] += rng.normal(scale=0.2 * size, size=(few, 3))
    kept = np.ones(count, dtype=bool)
    kept[:few] = signed_distances(body_a, poses_a[:few], body_b, poses_b[:few]) <= 0.0
    return poses_a[kept], poses_b[kept]


def check(body_a: ConvexBody, body_b: ConvexBody, seed: int, count: int) -> tuple[int, list[Count]]:
    """Return the number of poses in contact, and the result of every rung there."""
    rng = np.random.default_rng(seed)
    distances = {
        rung: hdsdf_compiled(body_a, body_b, gamma=gamma, shaping_length=length, normals=rung)
        for rung, (gamma, length) in SETTINGS.items()
    }
    total, counts = 0, [Count() for _ in RUNGS]
    while count > 0:
        poses_a, poses_b = contacts(body_a, body_b, rng, min(count, BATCH))
        count -= BATCH
        total += len(poses_a)
        for found, rung in zip(counts, RUNGS, strict=True):
            found.add(violations(distances[rung], body_a, poses_a, body_b, poses_b))
    return total, counts


def violations(
    distance: CompiledDistance, body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array
) -> Count:
    """Return the distance's results at poses in contact."""
    value, separation = distance.value(poses_a, poses_b)
    places = np.maximum(np.abs(poses_a[:, :3, 3]).max(1), np.abs(poses_b[:, :3, 3]).max(1))
    size = body_a.reach + body_b.reach + places
    return Count(
        int(np.sum(separation > TOLERANCE * size)),
        int(np.sum(value > TOLERANCE * size)),
        int(np.sum((value > 0) & (separation <= 0))),
        float((separation / size).max()) / ULP,
    )


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000_000, help="poses, each evaluated by every rung")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    options = parser.parse_args()
    table = pairs()
    each = -(-options.count // len(table))
    rows: dict[str, tuple[int, list[Count]]] = {}
    with ProcessPoolExecutor(options.processes) as pool:
        jobs = {
            pool.submit(check, *bodies, options.seed + k, each): name for k, (name, bodies) in enumerate(table.items())
        }
        for job in track(as_completed(jobs), "pairs", total=len(jobs)):
            rows[jobs[job]] = job.result()
    sums = [Count() for _ in RUNGS]
    for name in table:
        for total, count in zip(sums, rows[name][1], strict=True):
            total.add(count)
    every = {**{name: rows[name] for name in table}, "**all**": (sum(found[0] for found in rows.values()), sums)}
    cells = [
        {"pair": name, "poses in contact": f"{contact:,}", **dict(zip(RUNGS, map(str, counts), strict=True))}
        for name, (contact, counts) in every.items()
    ]
    print("D-tilde / D / signs (largest D-tilde [ulp of the size]):\n", markdown_text(cells), sep="\n")


if __name__ == "__main__":
    main()
