"""Adversarial poses at each witness: how many results are not finite, and how many signs disagree. None may.

    python benchmarks/adversarial.py [--count 1000000] [--seed S] [witness ...]

Over pairs of degenerate bodies, needles, plates, solids and swept bodies of 1e-6 to 1e6 m, every set of axes, gamma 1
to 32 and shaping lengths of 1e-9 to 1 m. Poses: bodies touching, aligned to the last digit or tilted by 1e-15 to 1e-3
rad, then moved apart or together by 1e-300 to 1e6 times their size, along a world axis or any way; at one place, or
both up to 1e12 times their size from the origin. Value, D-tilde, gradient and Hessian are counted each; a sign
disagrees where D is positive and D-tilde is not, or the other way round. NumPy's reference, which takes milliseconds,
gets a twentieth of the poses. Prints a Markdown table.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from rich.progress import track

from hdplan.distance.batch.distance import hdsdf_batch
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.numpy_reference.hdsdf import hdsdf_derivatives, separation
from hdplan.distance.studies.random_poses import touching_poses
from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Array

Evaluate = Callable[[Array, Array], tuple[Array, ...]]  # poses -> D, D-tilde, gradient, Hessian

GAMMAS = (2, 1, 4, 32, 3, 8, 16)
LENGTHS = (1e-3, 1.0, 1e-9, 1e-6)  # [m]
SETS = ("paper", "paper+edges", "paper+centre", "paper+sphere-26", "paper-multiset")
BATCH = {"numpy": 250}  # poses at once; one number, so that nothing is compiled anew for another
LARGEST_BATCH = 4096
NUMPY_SHARE = 20  # the reference gets one of so many poses


def bodies() -> list[ConvexBody]:
    """Return bodies of every kind; each of about 1 m."""
    return [
        ConvexBody.box([1, 1, 1]),
        ConvexBody.from_points([[0, 0, 0]]),
        ConvexBody.from_points([[0.0, 0.0, 0.0], [0.0, 0.6, 0.8]]),
        ConvexBody.from_points([[0, 0, 0], [1, 0, 0], [0, 1, 0]]),
        ConvexBody.box([1, 1e-6, 1e-6]),
        ConvexBody.box([1, 1, 1e-6]),
        ConvexBody.sphere(0.5),
        ConvexBody.capsule(0.1, 1.0),
        ConvexBody.platonic("tetrahedron", 0.7).inflated(0.1),
    ]


def numpy(body_a: ConvexBody, body_b: ConvexBody, normals: str, **settings: Any) -> Evaluate:
    """Return the reference in the others' form."""

    def evaluate(poses_a: Array, poses_b: Array) -> tuple[Array, ...]:
        found = hdsdf_derivatives(body_a, poses_a, body_b, poses_b, normals=normals, **settings)
        least = separation(body_a, poses_a, body_b, poses_b, normals=normals)
        return found.value, least, found.gradient, found.hessian

    return evaluate


WITNESSES: dict[str, Callable[..., Evaluate]] = {
    "numpy": numpy,
    "compiled": lambda *pair, **settings: hdsdf_compiled(*pair, **settings).hessian,
    "jax float64": lambda *pair, **settings: hdsdf_batch(*pair, **settings).hessian,
    "jax float32": lambda *pair, **settings: hdsdf_batch(*pair, **settings, dtype="float32").hessian,
}


def adversarial_poses(
    body_a: ConvexBody, body_b: ConvexBody, rng: np.random.Generator, count: int
) -> tuple[Array, Array]:
    """Return poses (count, 4, 4) of both bodies."""
    poses_a, poses_b = touching_poses(body_a, body_b, rng, count)
    size = body_a.reach + body_b.reach or 1.0
    ways = rng.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways = np.where(rng.random((count, 1)) < 0.5, np.eye(3)[rng.integers(0, 3, count)], ways)
    exponents = np.where(rng.random(count) < 0.5, rng.uniform(-300, 6, count), rng.uniform(-16, 1, count))
    gaps = size * rng.choice([-1.0, 0.0, 1.0], count) * 10.0**exponents
    held = rng.random(count) < 0.25  # at the origin, where floating-point numbers hold the smallest gap
    poses_b[held, :3, 3], poses_a[held, :3, 3] = 0.0, 0.0
    poses_a[:, :3, 3] += gaps[:, None] * ways
    same = rng.random(count) < 0.05
    poses_a[same] = poses_b[same]
    far = (rng.random(count) < 0.1) * size * 10.0 ** rng.uniform(0, 12, count)
    for poses in (poses_a, poses_b):
        poses[:, :3, 3] += far[:, None]
    return poses_a, poses_b


def scaled(body: ConvexBody, scale: float) -> ConvexBody:
    """Return the body in other units."""
    return ConvexBody(body.vertices * scale, body.faces, body.edges, body.edge_counts, body.radius * scale)


def tally(evaluate: Evaluate, poses: Callable[[int], tuple[Array, Array]], count: int, batch: int) -> Array:
    """Return how many poses, and how many with a value, D-tilde, gradient, Hessian not finite, and a wrong sign."""
    counts = np.zeros(6, dtype=int)
    for _ in range(-(-count // batch)):
        results = [np.asarray(result, dtype=float).reshape(batch, -1) for result in evaluate(*poses(batch))]
        wrong = [int(np.sum(~np.isfinite(result).all(1))) for result in results]
        value, least = results[0][:, 0], results[1][:, 0]
        counts += [batch, *wrong, int(np.sum((value != 0) & (np.sign(value) != np.sign(least))))]
    return counts


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("witnesses", nargs="*", default=list(WITNESSES), help=f"of {', '.join(WITNESSES)}")
    parser.add_argument("--count", type=int, default=1_000_000, help="poses for each witness")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    pairs = list(combinations_with_replacement(bodies(), 2))
    rows, counted = [], ("poses", "value", "D-tilde", "gradient", "Hessian", "signs")
    for name in options.witnesses:
        count = options.count // (NUMPY_SHARE if name == "numpy" else 1)
        batch = BATCH.get(name, LARGEST_BATCH)
        total = np.zeros(6, dtype=int)
        for k, pair in enumerate(track(pairs, name)):
            rng = np.random.default_rng(options.seed + k)
            scale, other = 10.0 ** rng.integers(-6, 7, 2)
            body_a, body_b = scaled(pair[0], scale), scaled(pair[1], other if k % 3 == 0 else scale)
            settings = {
                "gamma": GAMMAS[k % len(GAMMAS)],
                "shaping_length": LENGTHS[k % len(LENGTHS)],
                "normals": SETS[k % len(SETS)],
            }
            evaluate = WITNESSES[name](body_a, body_b, **settings)
            total += tally(evaluate, partial(adversarial_poses, body_a, body_b, rng), count // len(pairs), batch)
        rows.append({"witness": name, **dict(zip(counted, map("{:,}".format, total), strict=True))})
    print(markdown_text(rows))


if __name__ == "__main__":
    main()
