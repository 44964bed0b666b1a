"""hdplan's GDF against that of its authors' package: the same numbers, and how long each takes.

    pip install uaibot
    python benchmarks/gdf.py [--count N] [--seed S]

For all 15 pairs of Platonic solids at the paper's random poses with a gap of 1 cm or more: the largest difference of
the two distances, both iterated to the end from one start (uaibot computes in float32), and the median time per call
from A's origin with uaibot's settings (tolerance 1e-3, at most 20 iterations): ours in NumPy, `Utils.compute_dist`, and
the C++ under it. Prints a Markdown table. For one core set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import uaibot
from uaibot.utils.utils import Utils

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.baselines.gdf import gdf
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.studies.random_poses import PLATONIC_PAIRS, paper_poses
from hdplan.planner.studies.report import Cell, markdown_text

H, EPS = 0.1, 0.01  # smoothing and bulging
LEAST_GAP = 0.01  # [m]


def theirs(body: ConvexBody) -> uaibot.Box | uaibot.ConvexPolytope:
    """Return uaibot's object; a cube is its box, which has a projection of its own."""
    if len(body.faces) == 6:
        width, depth, height = np.ptp(body.vertices, axis=0)
        return uaibot.Box(width=width, depth=depth, height=height)
    heights = np.max(body.faces @ body.vertices.T, axis=1)
    return uaibot.ConvexPolytope(htm=np.matrix(np.eye(4)), A=np.matrix(body.faces), b=np.matrix(heights).T)


def timed(call: Callable[[], object]) -> float:
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def compare(names: tuple[str, str], rng: np.random.Generator, count: int) -> dict[str, Cell]:
    """Return the table's row of one pair."""
    body_a, body_b = (ConvexBody.platonic(name) for name in names)
    object_a, object_b = theirs(body_a), theirs(body_b)
    bare_a, bare_b = object_a.cpp_obj, object_b.cpp_obj
    poses_a, poses_b = paper_poses(rng, count)
    apart = signed_distances(body_a, poses_a, body_b, poses_b) > LEAST_GAP
    differences, seconds = [], []
    for pose_a, pose_b in zip(poses_a[apart], poses_b[apart], strict=True):
        object_a.set_ani_frame(np.matrix(pose_a))
        object_b.set_ani_frame(np.matrix(pose_b))
        start = pose_a[:3, 3:]
        ours = gdf(
            body_a, pose_a, body_b, pose_b, h=H, bulging=EPS, tolerance=1e-10, iterations=5000, start=start[:, 0]
        )
        their = Utils.compute_dist(object_a, object_b, p_a_init=start, h=H, eps=EPS, tol=1e-10, no_iter_max=5000)
        differences.append(abs(ours.distance - their[2]))
        calls = (
            partial(gdf, body_a, pose_a, body_b, pose_b, h=H, bulging=EPS, iterations=20),
            partial(Utils.compute_dist, object_a, object_b, p_a_init=start, h=H, eps=EPS),
            partial(bare_a.dist_to, bare_b, H, EPS, 1e-3, 20, start),
        )
        seconds.append([timed(call) for call in calls])
    times = (1e6 * np.median(seconds, axis=0)).tolist()
    return {
        "pair": "–".join(names),
        "poses apart": int(apart.sum()),
        "largest difference [m]": f"{max(differences):.1e}",
        **dict(zip(("hdplan [µs]", "uaibot's call [µs]", "its C++ [µs]"), times, strict=True)),
    }


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100, help="random poses per pair")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    print(markdown_text([compare(names, rng, options.count) for names in PLATONIC_PAIRS]))


if __name__ == "__main__":
    main()
