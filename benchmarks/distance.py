"""How fast the distance is, on one core: against python-fcl, compiled and in JAX batches; compiling and loading.

    python benchmarks/distance.py [--poses N] [--section speed|batch|compile ...]

Prints Markdown tables: medians over random poses of the paper's kind, warm. Read times as ratios within a row.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.bodies import PLATONIC, ConvexBody
from hdplan.distance.compiled import RowFunction
from hdplan.distance.fcl import FclPair
from hdplan.distance.oracle import signed_distances
from hdplan.distance.pair_distance import hdsdf_compiled, twist_function
from hdplan.distance.random_poses import paper_poses
from hdplan.distance.timing import seconds_per_query

Array = NDArray[np.float64]

REPEATS = 100  # of one pose in a table: the call from Python is shared among them
CLEAR = 1e-5  # [m] poses with a smaller gap are drawn again: FCL could end the process there
PAIRS = list(combinations_with_replacement(sorted(PLATONIC, key=lambda n: len(ConvexBody.platonic(n).vertices)), 2))


def poses(body_a: ConvexBody, body_b: ConvexBody, count: int) -> tuple[Array, Array]:
    a, b = paper_poses(np.random.default_rng(0), count)
    clear = np.abs(signed_distances(body_a, a, body_b, b)) > CLEAR
    return a[clear], b[clear]


def per_pose(body_a: ConvexBody, a: Array, body_b: ConvexBody, b: Array, order: int) -> float:
    """The median over poses of the time of one evaluation in generated C [us]."""
    function = hdsdf_compiled(body_a, body_b).function(order)
    tables = [a.reshape(-1, 16), b.reshape(-1, 16), np.array([[1e-3]]), np.zeros((1, 0))]
    zero = np.zeros(REPEATS, int)

    def seconds(k: int) -> float:
        return seconds_per_query(lambda: function(tables, [zero + k, zero + k, zero, zero]), REPEATS)

    return 1e6 * statistics.median(seconds(k) for k in range(len(a)))


def fcl_per_pose(pair: FclPair, a: Array, b: Array) -> float:
    """The median over poses of the time of one call [us]."""

    def seconds(k: int) -> float:
        def run() -> None:
            for _ in range(20):
                pair.distance(a[k], b[k])

        return seconds_per_query(run, 20)

    return 1e6 * statistics.median(seconds(k) for k in range(len(a)))


def speed(count: int) -> None:
    print("\n## Compiled, against python-fcl's exact distance (one pose per call, as from Python)\n")
    print("| pair | python-fcl [us] | value [us] | + gradient [us] | + Hessian [us] | value/fcl | gradient/fcl | H/g |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for names in PAIRS:
        body_a, body_b = map(ConvexBody.platonic, names)
        a, b = poses(body_a, body_b, count)
        fcl = fcl_per_pose(FclPair(body_a, body_b), a, b)
        value, gradient, hessian = (per_pose(body_a, a, body_b, b, order) for order in range(3))
        print(
            f"| {names[0]}–{names[1]} | {fcl:.1f} | {value:.2f} | {gradient:.2f} | {hessian:.2f} "
            f"| {value / fcl:.2f} | {gradient / fcl:.2f} | {hessian / gradient:.1f} |",
            flush=True,
        )


def table_time(evaluate: Callable[[Array, Array], Sequence[Any]], a: Array, b: Array) -> float:
    """The time per query of a table of poses [us]."""
    return 1e6 * seconds_per_query(lambda: np.asarray(evaluate(a, b)[-1]), len(a))


def batch(count: int) -> None:
    from hdplan.distance.batch import hdsdf_batch

    print("\n## Tables of 8,100 poses: generated C and JAX on one core [us per query]\n")
    print("| pair | order | compiled | JAX float64 | JAX float32 | float64/compiled |")
    print("|---|---|---|---|---|---|", flush=True)
    for names in (("cube", "cube"), ("dodecahedron", "dodecahedron")):
        body_a, body_b = map(ConvexBody.platonic, names)
        a, b = paper_poses(np.random.default_rng(0), 8100)
        ways = [
            hdsdf_compiled(body_a, body_b),
            *(hdsdf_batch(body_a, body_b, dtype=dtype) for dtype in ("float64", "float32")),
        ]
        for order in ("value", "gradient", "hessian"):
            times = [table_time(getattr(way, order), a, b) for way in ways]
            row = " | ".join(f"{t:.2f}" for t in times)
            print(f"| {'–'.join(names)} | {order} | {row} | {times[1] / times[0]:.2f} |", flush=True)


def compile_times(count: int) -> None:
    print("\n## Compiling once for a machine, loading afterwards [s]\n")
    print("| pair | normals | order | compile | load from the cache |")
    print("|---|---|---|---|---|", flush=True)
    hull = ConvexBody.from_points(np.random.default_rng(0).normal(size=(60, 3)))
    shapes = {"cube": ConvexBody.platonic("cube"), "dodecahedron": ConvexBody.platonic("dodecahedron")}
    shapes[f"hull of {len(hull.vertices)} vertices"] = hull
    shapes["cylinder"] = ConvexBody.cylinder(0.3, 0.7)
    for name, body in shapes.items():
        for normals in ("paper", "paper+edges"):
            for order in range(3):
                with tempfile.TemporaryDirectory() as folder:
                    os.environ["HDPLAN_CACHE"] = folder
                    times = []
                    for _ in range(2):
                        begin = perf_counter()
                        RowFunction(twist_function(body, body, 2, normals, 0, order))
                        times.append(perf_counter() - begin)
                print(f"| {name}–{name} | {normals} | {order} | {times[0]:.2f} | {times[1]:.3f} |", flush=True)


SECTIONS = {"speed": speed, "batch": batch, "compile": compile_times}


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=100, help="random poses per pair")
    parser.add_argument("--section", nargs="*", choices=SECTIONS, default=list(SECTIONS))
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core, XLA's threads too
    model = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    print(f"one core of {model[0].split(': ')[1] if model else 'an unnamed machine'}")
    for section in options.section:
        SECTIONS[section](options.poses)


if __name__ == "__main__":
    main()
