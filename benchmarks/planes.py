"""How many planes the planner's distance should have: what it gives away near contact, and its time.

    python benchmarks/planes.py [--robot NAME] [--poses N]

Every outer body of the robot's links against boxes of all proportions, at random poses less than 5 cm apart. "Given
away" is the exact distance of the two bodies less the separation that the kernel sees, which is what makes a passage
look narrower than it is. Prints a Markdown table; times on one core, as ratios.
"""

from __future__ import annotations

import argparse
import os

import numpy as np
from cells import quantiles
from scipy.spatial.transform import Rotation

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import sphere_directions
from hdplan.distance.poses import placement_rows
from hdplan.distance.studies.stopwatch import seconds_per_query
from hdplan.distance.symbolic.halfspaces import box_directions, halfspace_distance
from hdplan.distance.symbolic.row_function import RowFunction
from hdplan.planner.collision.link_bodies import link_bodies
from hdplan.planner.robot.loading import load_robot
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Array
from hdplan.scenes.robot_spec import RobotSpec

NEAR = 0.05  # [m]


def near_poses(body: ConvexBody, box: ConvexBody, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Poses of the body, the box at rest, with gaps of 0 to NEAR, and the exact distances."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()
    away = Rotation.random(count, random_state=rng).as_matrix()[:, :, 0]
    poses[:, :3, 3] = away * (box.reach + body.reach) - poses[:, :3, :3] @ body.centre
    rest = np.tile(np.eye(4), (count, 1, 1))
    gaps = rng.uniform(0.0, NEAR, count)
    for _ in range(20):  # along the line of centres until the gap is right: distance grows with it, at most as fast
        found = signed_distances(body, poses, box, rest)
        poses[:, :3, 3] -= (found - gaps)[:, None] * away
    found = signed_distances(body, poses, box, rest)
    kept = (found > 0) & (found < NEAR)
    return poses[kept], found[kept]


def directions(count: int) -> Array:
    """A box's faces; with edges; with corners too; and from then on more, evenly over the sphere."""
    box = box_directions()
    nonzero = np.sum(np.abs(box) > 1e-9, axis=1)
    ordered = box[np.argsort(nonzero, kind="stable")]
    if count <= len(box):
        return ordered[:count]
    more = sphere_directions(count - len(box))
    return np.vstack([ordered, more, -more])


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="panda")
    parser.add_argument("--poses", type=int, default=300, help="per body and box")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    rng = np.random.default_rng(0)
    bodies = [link.body for link in link_bodies(load_robot(RobotSpec(name=options.robot)))]
    boxes = [ConvexBody.box(rng.choice([0.02, 0.1, 0.4, 1.0], 3)) for _ in range(12)]
    cases = [(body, box, *near_poses(body, box, rng, options.poses)) for body in bodies for box in boxes]
    rows = []
    for count in (6, 18, 26, 50, 74, 122):
        normals = directions(count)
        given, seconds = [], []
        for body, box, poses, exact in cases:
            function = RowFunction(halfspace_distance(len(body.vertices), count, 2, 1e-3))
            supports = (normals @ box.vertices.T).max(axis=1)
            ones = np.ones(len(body.vertices))
            tables = [
                placement_rows(poses),
                np.append(np.eye(3).ravel(), np.zeros(3))[None],
                np.concatenate([body.vertices.ravel(), ones, [body.radius]])[None],
                np.append(normals.ravel(), supports)[None],
            ]
            zero = np.zeros(len(poses), int)
            picks = [np.arange(len(poses)), zero, zero, zero]
            given.append(exact - function(tables, picks)[2][:, 0])
            if box is boxes[0]:
                seconds.append(seconds_per_query(lambda f=function, t=tables, p=picks: f(t, p), len(poses)))  # type: ignore[misc]
        lost = 1e3 * np.concatenate(given)
        row = {"planes of a box": count, "given away: median / 95 % / worst [mm]": quantiles(lost, (0.5, 0.95, 1.0), 2)}
        rows.append(row | {"value and derivative [µs]": 1e6 * float(np.median(seconds))})
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
