"""Many motions of one and of several problems at once in JAX, beside the loops of C, one motion after another.

    python benchmarks/many_guesses.py

The cost with its gradient, and with its Gauss-Newton curvature as well, of 16 motions with 16 waypoints around the
straight line. Of several problems of a scene the first is the scene; the others have their obstacles moved by up to
5 cm, and each has one less than the one before. Times are of one core for each motion, compiled; the device is the
first that JAX finds. Motions go through the compiled code four at a time, with all problems.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import numpy as np

import hdplan
from hdplan import symbolic
from hdplan.planner.problem.problem import Problem
from hdplan.planner.studies.report import Cell, markdown_text

SCENES, WAYPOINTS, WEIGHT = ("planar_arm", "panda_cage"), 16, 1e4
MOTIONS, TOGETHER = 16, 4  # of each problem; that go through the compiled code at a time
SEVERAL = 4  # problems
COLUMNS = (
    *("scene", "problems", "precision", "pairs", "loops of C [ms]", "compiled in [s]"),
    *("with gradient [ms]", "with curvature [ms]"),
)


def main() -> None:
    """Run the benchmark from the command line."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})  # XLA's threads too
    rows: list[dict[str, Cell]] = []
    for name in SCENES:
        for count in (1, SEVERAL):
            several = problems(name, count)
            for precision in ("double", "single"):
                cells = name, count, precision, *figures(several, precision == "double")
                rows.append(dict(zip(COLUMNS, cells, strict=True)))
                print(*cells, file=sys.stderr)
    print(f"On {jax.devices()[0].device_kind}, by JAX's backend {jax.default_backend()}:\n\n{markdown_text(rows)}")


def problems(name: str, count: int) -> list[Problem]:
    """Problems of a scene, the first of them as it is."""
    scene, rng = hdplan.load_scene(name), np.random.default_rng(0)
    scene = replace(scene, planner=replace(scene.planner, waypoints=WAYPOINTS))
    found = [hdplan.build(scene)]
    for fewer in range(1, count):
        moved = []
        for each in scene.obstacles[: max(1, len(scene.obstacles) - fewer)]:
            place = np.add(each.pose.position, rng.uniform(-0.05, 0.05, 3))
            moved.append(replace(each, pose=replace(each.pose, position=tuple(place.tolist()))))
        found.append(hdplan.build(replace(scene, obstacles=tuple(moved))))
    return found


def figures(several: list[Problem], double: bool) -> list[Cell]:
    """The number of pairs, and times for each motion."""
    rng = np.random.default_rng(1)
    lines = np.array([each.polyline() for each in several])
    motions = lines + rng.normal(0, 0.1, (MOTIONS, *lines.shape))
    once = list(zip(several, motions[0], strict=True))
    times = [timed(lambda: [each.evaluate(x, WEIGHT) for each, x in once]) / len(several)]
    built: list[float] = []
    cost = symbolic.jax_cost(several)
    with jax.enable_x64(double):
        x = jax.numpy.asarray(motions)
        for of in (with_gradient, with_curvature):
            began = time.process_time()
            each = jax.jit(lambda cost, x, of=of: jax.lax.map(lambda x: of(cost, x), x, batch_size=TOGETHER))
            run = each.lower(cost, x).compile()
            built.append(time.process_time() - began)
            times.append(timed(partial(_run, run, cost, x)) / (MOTIONS * len(several)))
    loops, *rest = (f"{1e3 * each:.3f}" for each in times)
    pairs = sum(table.place.shape[-1] for table in cost.tables.pairs)
    return [pairs, loops, " / ".join(f"{each:.1f}" for each in built), *rest]


def _run(run: Any, cost: Any, x: Any) -> None:
    """Call what is compiled, and wait for what it gives."""
    for part in jax.tree_util.tree_leaves(run(cost, x)):
        part.block_until_ready()


def with_gradient(cost: Any, x: Any) -> Any:
    """Values of one motion for each problem, and their slopes."""
    return jax.value_and_grad(lambda x: cost(x, WEIGHT).sum())(x)


def with_curvature(cost: Any, x: Any) -> Any:
    """The same, and the Gauss-Newton Hessians."""
    return with_gradient(cost, x), cost.curvature(x, WEIGHT)


def timed(run: Callable[[], Any]) -> float:
    """Return the processor time [s] of a call, the least of three."""
    run()
    best = float("inf")
    for _ in range(2):
        began, calls = time.process_time(), 0
        while not calls or time.process_time() - began < 0.05:
            run()
            calls += 1
        best = min(best, (time.process_time() - began) / calls)
    return best


if __name__ == "__main__":
    main()
