"""The ladder of normals and what a query takes: ours called once, in bulk and in JAX, beside FCL, coal, coal in C++.

    python benchmarks/distance.py [--section ladder|unions|exact|batch ...] [--poses N] [--configurations N]

Prints a Markdown table for each section; `exact` needs a C++ compiler for coal's loop. Times are processor time on one
core over poses of the paper's kind, each another one, warm; medians of rounds in which the ways take turns, so that
ratios hold on a busy machine too.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations_with_replacement
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from coal_loop import CoalLoop, build

from hdplan.distance.baselines.coal import CoalPair, signed_distances
from hdplan.distance.baselines.fcl import FclPair
from hdplan.distance.bodies import PLATONIC, ConvexBody
from hdplan.distance.studies.conservativeness import conservativeness
from hdplan.distance.studies.random_poses import paper_poses
from hdplan.distance.studies.unions import study_unions
from hdplan.distance.symbolic.compiled_pair import CompiledDistance, hdsdf_compiled
from hdplan.planner.studies.distance import union_row
from hdplan.planner.studies.report import markdown_text, short
from hdplan.scenes.array_types import Array

Way = Callable[[], float]  # -> processor time of a query [s]

ROUNDS = 9
CLEAR = 1e-5  # [m] poses with a smaller gap are drawn again: FCL could end the process there
GAPS = (1e-4, 1e-2, 1e-1)  # [m] of the false positives
CUBES, DODECAHEDRA = ("cube", "cube"), ("dodecahedron", "dodecahedron")
PAIRS = list(combinations_with_replacement(sorted(PLATONIC, key=lambda n: len(ConvexBody.platonic(n).vertices)), 2))


def poses(body_a: ConvexBody, body_b: ConvexBody, count: int) -> tuple[Array, Array]:
    a, b = paper_poses(np.random.default_rng(0), count)
    clear = np.abs(signed_distances(body_a, a, body_b, b)) > CLEAR
    return a[clear], b[clear]


def bulk(evaluate: Callable[[Array, Array], Sequence[Any]], a: Array, b: Array) -> Way:
    """One call for all poses."""

    def way() -> float:
        begin = process_time()
        np.asarray(evaluate(a, b)[-1])
        return (process_time() - begin) / len(a)

    return way


def singly(evaluate: Callable[[Array, Array], object], a: Array, b: Array) -> Way:
    """One call from Python for each pose."""

    def way() -> float:
        begin = process_time()
        for one, other in zip(a, b, strict=True):
            evaluate(one, other)
        return (process_time() - begin) / len(a)

    return way


def medians(ways: Sequence[Way]) -> list[float]:
    """Return the median time of a query [us] of each way, after one round that does not count."""
    rounds = [[way() for way in ways] for _ in range(ROUNDS + 1)][1:]
    return [1e6 * statistics.median(times) for times in zip(*rounds, strict=True)]


def ladder(options: argparse.Namespace) -> None:
    """False positives over random configurations, and times in bulk, value / with gradient."""
    found, rows = conservativeness(options.configurations, with_fcl=False), []
    for rung in found.rungs:
        times = {}
        for names in (CUBES, DODECAHEDRA):
            body_a, body_b = map(ConvexBody.platonic, names)
            a, b = poses(body_a, body_b, options.poses)
            distance = hdsdf_compiled(body_a, body_b, normals=rung.normals)
            both = medians([bulk(distance.value, a, b), bulk(distance.gradient, a, b)])
            times[f"{'–'.join(names)} [µs]"] = " / ".join(map(short, both))
        rates = " / ".join(f"{100 * rate:.2g}" for rate in found.rates(rung, GAPS))
        row = {"normals": f"`{rung.normals}`", "false positives [%]": rates}
        rows.append(row | {"widest [cm]": f"{100 * np.max(rung.gaps, initial=0):.2g}"} | times)
        print(*rows[-1].values(), file=sys.stderr)
    print(f"{markdown_text(rows)}\nOver {found.planned:,} configurations; contacts called free: {found.missed}.\n")


def unions(options: argparse.Namespace) -> None:
    """A box and a ring cut into more and more pieces, against a box."""
    found = study_unions(report=lambda done, of, what: print(f"{done} of {of}: {what}", file=sys.stderr))
    rows = [union_row(one) for one in found]
    print(f"{markdown_text(rows)}\nContacts called free: {sum(one.missed for one in found)}.\n")


def in_cpp(loop: CoalLoop) -> float:
    """Time of one query [s] in the loop of C++."""
    return loop.seconds()[0]


def exact(options: argparse.Namespace) -> None:
    """One query, the paper's normals: exact ones and ours, called once from Python and in a loop of C."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        program, why = build(Path(folder))
        if program is None:
            sys.exit(f"coal's loop in C++ cannot be built: {why}")
        for names in PAIRS:
            body_a, body_b = map(ConvexBody.platonic, names)
            a, b = poses(body_a, body_b, options.poses)
            ours = hdsdf_compiled(body_a, body_b)
            some = slice(0, 500)
            ways = [
                singly(pair.distance, a[some], b[some]) for pair in (FclPair(body_a, body_b), CoalPair(body_a, body_b))
            ]
            ways += [singly(order, a[some], b[some]) for order in (ours.value, ours.gradient)]
            ways += [bulk(order, a, b) for order in (ours.value, ours.gradient, ours.hessian)]
            loop = CoalLoop(program, body_a, a, body_b, b)
            truth = float(signed_distances(body_a, a, body_b, b).sum())
            assert abs(loop.seconds()[1] - truth) < 1e-6 * len(a), "coal's loop computes something else"
            ways.append(partial(in_cpp, loop))
            fcl, coal, value, gradient, c_value, c_gradient, c_hessian, coal_c = medians(ways)
            row = {
                "pair": "–".join(names),
                "once, from Python: FCL [µs]": fcl,
                "coal": coal,
                "ours": value,
                "+ gradient": gradient,
                "ours / FCL": value / fcl,
                "in a loop: coal, C++ [µs]": coal_c,
                "ours, C": c_value,
                "ours, C, + gradient": c_gradient,
                "+ Hessian": c_hessian,
                "ours / coal": c_value / coal_c,
                "+ gradient / coal": c_gradient / coal_c,
            }
            rows.append(row)
            print(*rows[-1].values(), file=sys.stderr)
    print(markdown_text(rows))


def batch(options: argparse.Namespace) -> None:
    """Tables of 8,100 poses: generated C and JAX on one core."""
    from hdplan.distance.batch.distance import BatchDistance, hdsdf_batch

    rows = []
    for names in (CUBES, DODECAHEDRA):
        body_a, body_b = map(ConvexBody.platonic, names)
        a, b = paper_poses(np.random.default_rng(0), 8100)
        ours: list[CompiledDistance | BatchDistance] = [hdsdf_compiled(body_a, body_b)]
        ours += [hdsdf_batch(body_a, body_b, dtype=dtype) for dtype in ("float64", "float32")]
        for order in ("value", "gradient", "hessian"):
            times = medians([bulk(partial(getattr(way, order)), a, b) for way in ours])
            ways = ("compiled [µs]", "JAX float64", "JAX float32")
            row = {"pair": "–".join(names), "order": order} | dict(zip(ways, times, strict=True))
            rows.append(row | {"float64 / compiled": times[1] / times[0]})
    print(markdown_text(rows))


SECTIONS = {"ladder": ladder, "unions": unions, "exact": exact, "batch": batch}


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=4000, help="random poses per pair")
    parser.add_argument("--configurations", type=int, default=500_000, help="of the ladder's false positives")
    parser.add_argument("--section", nargs="*", choices=SECTIONS, default=list(SECTIONS))
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core, XLA's threads too
    for section in options.section:
        SECTIONS[section](options)


if __name__ == "__main__":
    main()
