"""Time of a distance query: exact ones, GDF and ours in every way of running it, over the 15 pairs of Platonic solids.

Out: seconds per query against the paper's complexity measure (paper: eq. (7), Figure
2). FCL, coal and GDF are called from Python one pose at a time, as their users call them.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from time import perf_counter, process_time
from types import MappingProxyType
from typing import Any

import numpy as np

from hdplan.distance.baselines.coal import CoalPair, signed_distances
from hdplan.distance.baselines.fcl import FclPair
from hdplan.distance.baselines.gdf import gdf
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.studies.random_poses import PLATONIC_PAIRS, paper_poses
from hdplan.distance.studies.stopwatch import seconds_per_query
from hdplan.distance.symbolic.compiled_pair import CompiledDistance, hdsdf_compiled
from hdplan.scenes.array_types import Array

Run = Callable[[], object]  # answers every pose once

POSES = 100  # per pair, the paper's N
BATCH = 90**2  # poses at once for the batch, the paper's
GAMMA, EPSILON = 2, 1e-4  # the paper's
SMOOTHING, BULGING = 0.1, (1e-3, 1e-1)  # of GDF, the paper's h and the range of its ε
GDF_TOLERANCE, GDF_ITERATIONS = 1e-3, 1000  # [m] of GDF
LEAST_GAP = 1e-5  # [m] poses with a smaller gap are drawn again: FCL could end the process there


@dataclass(frozen=True)
class PairTimes:
    """One pair of solids."""

    names: tuple[str, str]
    complexity: int  # |V(A)|²|V(B)| + |V(A)||V(B)|²
    seconds: Mapping[str, float]  # per query, by method

    def ratio(self, method: str, to: str) -> float:
        """Return the ratio of the times of ``method`` and ``to``."""
        return self.seconds[method] / self.seconds[to]


@dataclass(frozen=True)
class QueryTimes:
    """Figures of ``query_times``."""

    planned: int  # requested pairs
    pairs: tuple[PairTimes, ...]  # in the order of their complexity

    @property
    def complete(self) -> bool:
        """True if the study ran to its end."""
        return len(self.pairs) == self.planned


def query_times(
    pairs: Iterable[tuple[str, str]] = PLATONIC_PAIRS,
    methods: Iterable[str] | None = None,
    *,
    report: Callable[[int, int, str], None] = lambda done, of, what: None,
    stop: Callable[[], bool] = lambda: False,
) -> QueryTimes:
    """Time every method on the same random poses of each pair.

    Args:
        pairs: names of Platonic solids.
        methods: of METHODS; None takes those whose packages are installed.
        report: called with (steps done, all of them, what comes next).
        stop: called between the pairs; True ends with those that are done.
    """
    names = tuple(available_methods() if methods is None else methods)
    ordered = sorted(pairs, key=lambda pair: _complexity(*map(ConvexBody.platonic, pair)))
    found: list[PairTimes] = []
    for pair in ordered:
        body_a, body_b = map(ConvexBody.platonic, pair)
        rng = np.random.default_rng(0)
        poses_a, poses_b = paper_poses(rng, BATCH)
        clear = np.abs(signed_distances(body_a, poses_a, body_b, poses_b)) > LEAST_GAP
        poses_a, poses_b = poses_a[clear], poses_b[clear]
        seconds = {}
        for k, name in enumerate(names):
            report(len(found) * len(names) + k, len(ordered) * len(names), f"{'-'.join(pair)}, {name}")
            run, queries = METHODS[name](body_a, poses_a, body_b, poses_b)
            clock = perf_counter if name == "JAX batch" and batch_device() != "cpu" else process_time
            seconds[name] = seconds_per_query(run, queries, clock)
            if stop():
                return QueryTimes(len(ordered), tuple(found))
        found.append(PairTimes(pair, _complexity(body_a, body_b), MappingProxyType(seconds)))
    report(len(ordered) * len(names), len(ordered) * len(names), "")
    return QueryTimes(len(ordered), tuple(found))


def available_methods() -> tuple[str, ...]:
    """Return the METHODS whose packages are installed."""
    return tuple(name for name in METHODS if importlib.util.find_spec(PACKAGES.get(name, "hdplan")))


def batch_device() -> str:
    """Return the device of the JAX batch."""
    from hdplan.distance.batch.distance import hdsdf_batch

    return hdsdf_batch(ConvexBody.sphere(1.0), ConvexBody.sphere(1.0)).device


def _complexity(body_a: ConvexBody, body_b: ConvexBody) -> int:
    a, b = len(body_a.vertices), len(body_b.vertices)
    return a * a * b + a * b * b


def _each(distance: Callable[[Array, Array], object], poses_a: Array, poses_b: Array) -> tuple[Run, int]:
    """Call ``distance`` one pose at a time, for the first POSES of them."""
    some = [(poses_a[k], poses_b[k]) for k in range(min(POSES, len(poses_a)))]

    def run() -> None:
        for pose_a, pose_b in some:
            distance(pose_a, pose_b)

    return run, len(some)


def _fcl(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> tuple[Run, int]:
    return _each(FclPair(body_a, body_b).distance, poses_a, poses_b)


def _coal(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> tuple[Run, int]:
    return _each(CoalPair(body_a, body_b).distance, poses_a, poses_b)


def _gdf(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> tuple[Run, int]:
    bulging = iter(_bulgings())

    def distance(pose_a: Array, pose_b: Array) -> object:
        return gdf(
            body_a, pose_a, body_b, pose_b,
            h=SMOOTHING, bulging=next(bulging), tolerance=GDF_TOLERANCE, iterations=GDF_ITERATIONS,
        )  # fmt: skip

    return _each(distance, poses_a, poses_b)


def _uaibot(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> tuple[Run, int]:
    """Time of the authors' package, of its C++ alone: both bodies are placed beforehand."""
    uaibot: Any = import_module("uaibot")

    def solids(body: ConvexBody, poses: Array) -> list[Any]:
        heights = np.max(body.faces @ body.vertices.T, axis=1)[:, None]
        solid = uaibot.ConvexPolytope(htm=np.eye(4), A=body.faces, b=heights)
        placed = []
        for pose in poses:
            solid.set_ani_frame(pose)
            placed.append(solid.cpp_obj)
        return placed

    both = list(zip(solids(body_a, poses_a[:POSES]), solids(body_b, poses_b[:POSES]), _bulgings(), strict=False))
    start = np.zeros((3, 1))

    def run() -> None:
        for a, b, bulging in both:
            a.dist_to(b, SMOOTHING, bulging, GDF_TOLERANCE, GDF_ITERATIONS, start)

    return run, len(both)


def _bulgings() -> Iterable[float]:
    """Yield the paper's random ε, the same for every pair."""
    rng = np.random.default_rng(0)
    while True:
        yield float(rng.uniform(*BULGING))


def _compiled(body_a: ConvexBody, body_b: ConvexBody) -> CompiledDistance:
    return hdsdf_compiled(body_a, body_b, gamma=GAMMA, epsilon=EPSILON)


def _interpreter(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> tuple[Run, int]:
    """CasADi's virtual machine, through buffers: converting to its own matrices would cost more than the work."""
    function = _compiled(body_a, body_b).function(0).function
    buffer: Any
    buffer, trigger = function.buffer()
    inputs = [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
    outputs = [np.zeros(function.numel_out(k)) for k in range(function.n_out())]
    for k, array in enumerate(inputs):
        buffer.set_arg(k, array.data)
    for k, array in enumerate(outputs):
        buffer.set_res(k, array.data)
    inputs[2][:] = EPSILON ** (1.0 / GAMMA)

    def distance(pose_a: Array, pose_b: Array, _: object = buffer) -> Array:  # the buffer must outlive its trigger
        inputs[0][:], inputs[1][:] = pose_a.ravel(), pose_b.ravel()
        trigger()
        return outputs[0]

    return _each(distance, poses_a, poses_b)


def _one_pose(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> tuple[Run, int]:
    return _each(_compiled(body_a, body_b).value, poses_a, poses_b)


def _table(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> tuple[Run, int]:
    function = _compiled(body_a, body_b)
    return lambda: function.value(poses_a, poses_b), len(poses_a)


def _batch(body_a: ConvexBody, poses_a: Array, body_b: ConvexBody, poses_b: Array) -> tuple[Run, int]:
    from hdplan.distance.batch.distance import hdsdf_batch

    function = hdsdf_batch(body_a, body_b, gamma=GAMMA, epsilon=EPSILON)
    return lambda: np.asarray(function.value(poses_a, poses_b)[0]), len(poses_a)


METHODS: Mapping[str, Callable[[ConvexBody, Array, ConvexBody, Array], tuple[Run, int]]] = MappingProxyType(
    {
        "FCL": _fcl,
        "coal": _coal,
        "GDF": _gdf,
        "GDF uaibot": _uaibot,
        "interpreter": _interpreter,
        "compiled, one pose a call": _one_pose,
        "compiled": _table,
        "JAX batch": _batch,
    }
)
PACKAGES = {"FCL": "fcl", "GDF uaibot": "uaibot", "JAX batch": "jax"}  # methods that need an optional package
