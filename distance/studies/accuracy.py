"""The cost of accuracy in time: rungs, orders, shaping lengths and precisions against the exact distance and the clock.

Out: a table of numbers; ``pareto_front`` and ``best_buy`` read it. float64 runs as generated C, float32 in JAX: the
fastest way of each on a processor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import product
from time import perf_counter, process_time
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import RUNGS
from hdplan.distance.studies.stopwatch import seconds_per_query
from hdplan.distance.studies.study_poses import Poses, study_bodies, study_poses
from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled

Precision = Literal["float64", "float32"]

GAPS = (1e-4, 1e-3, 1e-2, 3e-2, 1e-1, 3e-1)  # [m] at which false positives are counted
NEAR_GAP = 0.05  # [m] depth or gap up to which a pose is near contact
BLOCK = 2048  # poses at once, always: JAX compiles again for every other number
BANDS = ("apart", "near", "deep")  # d > NEAR_GAP, |d| <= NEAR_GAP, d < -NEAR_GAP
ORDERS = ("value", "gradient", "hessian")
RUNS_IN = MappingProxyType({"float64": "C", "float32": "JAX"})


@dataclass(frozen=True)
class Setting:
    """One way to set the distance up."""

    normals: str
    gamma: int
    shaping_length: float  # [m]
    precision: Precision


@dataclass(frozen=True)
class Entry:
    """Figures of one setting, on one pair of bodies or in the mean over several."""

    setting: Setting
    bodies: str
    false_positives: Mapping[float, float]  # per gap: part of the random poses with d >= gap where D <= 0
    sign_lost: float  # part of the poses where D̃ > 0 and yet D <= 0: it underflows
    bias: Mapping[str, float]  # [m] per band: median of D - d
    median_error: Mapping[str, float]  # [m] per band: median of |D - d|
    high_error: Mapping[str, float]  # [m] per band: 95th percentile of |D - d|
    bend: float | None  # [1/m] near contact: how fast the gradient turns; None without Hessians
    seconds: Mapping[str, float]  # per query, by order: value; value + gradient; value + gradient + Hessian


@dataclass(frozen=True)
class Plan:
    """Numbers of samples and repetitions."""

    bodies: tuple[str, ...]  # of study_bodies
    kernels: tuple[tuple[str, int, Precision], ...]  # normals, gamma, precision: what is compiled for each pair
    shaping_lengths: tuple[float, ...] = (1e-4, 1e-3, 1e-2)  # [m] arguments: another one costs next to nothing
    orders: tuple[str, ...] = ORDERS
    random: int = 8 * BLOCK  # poses of each pair drawn at random, a multiple of BLOCK
    near: int = 2 * BLOCK  # and moved close to contact, likewise


DOUBLE: tuple[Precision, ...] = ("float64",)
SINGLE_PRECISION: tuple[Precision, ...] = ("float32",)
NORMALS = (*RUNGS, "paper+centre+edges")
FULL_PLAN = Plan(
    ("box - board", "capsule - box", "link - cylinder"),
    (*product(NORMALS, (1, 2, 4, 8), DOUBLE), *product(NORMALS, (2, 8), SINGLE_PRECISION)),
)
QUICK = Plan(
    ("capsule - box",),
    (
        *product(("paper", "paper+centre", "paper+sphere-26", "paper+edges"), (2, 4), DOUBLE),
        *product(("paper", "paper+edges"), (2,), SINGLE_PRECISION),
    ),
    orders=ORDERS[:2],
    random=4 * BLOCK,
    near=BLOCK,
)


@dataclass(frozen=True)
class Study:
    """Figures of ``study``."""

    plan: Plan
    entries: tuple[Entry, ...]  # one per setting and pair of bodies
    complete: bool  # whether it ran to its end

    @property
    def bodies(self) -> tuple[str, ...]:
        """The pairs that ``means`` are over: those that have all settings, or the first one with what there is."""
        settings = len(self.plan.kernels) * len(self.plan.shaping_lengths)
        measured = [entry.bodies for entry in self.entries]
        return tuple(name for name in self.plan.bodies if measured.count(name) == settings) or self.plan.bodies[:1]

    def means(self) -> tuple[Entry, ...]:
        """Return one entry per setting: the mean over ``bodies``, geometric for times."""
        pairs = [[entry for entry in self.entries if entry.bodies == name] for name in self.bodies]
        return tuple(map(_mean, *pairs)) if len(pairs) > 1 else tuple(pairs[0])


def study(
    plan: Plan = FULL_PLAN,
    *,
    report: Callable[[int, int, str], None] = lambda done, of, what: None,
    stop: Callable[[], bool] = lambda: False,
) -> Study:
    """Measure every setting of ``plan`` on every pair of bodies.

    Args:
        plan: how much is measured.
        report: called with (steps done, all of them, what comes next).
        stop: called between the steps; True ends with what was found so far.
    """
    entries: list[Entry] = []
    steps = list(product(plan.bodies, plan.kernels))
    here = ""
    for done, (name, (normals, gamma, precision)) in enumerate(steps):
        report(done, len(steps), f"{name}: {normals}, gamma {gamma}, {precision}")
        if name != here:
            here, (body_a, body_b) = name, study_bodies()[name]
            poses = study_poses(body_a, body_b, plan.random, plan.near, np.random.default_rng(0))
        seconds: dict[str, float] = {}
        found: list[Entry] = []
        for length in plan.shaping_lengths:
            setting = Setting(normals, gamma, length, precision)
            distance = _distance(setting, body_a, body_b)
            seconds = seconds or _seconds(distance, poses, plan.orders)
            bend = _bend(distance, poses) if "hessian" in plan.orders else None
            found.append(_entry(setting, name, distance, poses, bend, seconds))
        if stop():  # Ctrl-C reaches a compiler at work, too: what this step measured may be something else
            return Study(plan, tuple(entries), complete=False)
        entries += found
        if precision == "float32":
            _forget()
    report(len(steps), len(steps), "")
    return Study(plan, tuple(entries), complete=True)


def pareto_front(costs: Sequence[float], losses: Sequence[float]) -> list[int]:
    """Return the points that no other one beats, cheapest first: lower cost and loss, or equal in one of them."""
    front: list[int] = []
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], losses[k])):
        if not front or losses[k] < losses[front[-1]]:
            front.append(k)
    return front


def best_buy(entries: Sequence[Entry], gap: float, order: str, poses: int) -> Entry:
    """Return the entry to take of these, which differ in normals and shaping length alone.

    The normals with the least product of time and false positives at ``gap``: from there on, half of the one costs more
    than twice the other. None in ``poses`` counts as one. Of the shaping lengths the largest, which bends the least,
    that reads near contact within a tenth as well as the best. Never a set with the line of centres: it reads 0 where
    the centres meet, however deep the bodies are, so that nothing drives them apart.
    """
    entries = [entry for entry in entries if "centre" not in entry.setting.normals] or entries
    rung = min(entries, key=lambda e: e.seconds[order] * max(e.false_positives[gap], 1.0 / poses)).setting
    alike = [e for e in entries if e.setting.normals == rung.normals]
    best = min(entry.median_error["near"] for entry in alike)
    good = [entry for entry in alike if entry.median_error["near"] <= 1.1 * best]
    return max(good, key=lambda entry: entry.setting.shaping_length)


def _distance(setting: Setting, body_a: ConvexBody, body_b: ConvexBody) -> Any:
    """Return the CompiledDistance or BatchDistance of a setting."""
    options: dict[str, Any] = {
        "gamma": setting.gamma,
        "shaping_length": setting.shaping_length,
        "normals": setting.normals,
    }
    if setting.precision == "float64":
        return hdsdf_compiled(body_a, body_b, **options)
    from hdplan.distance.batch.distance import hdsdf_batch

    return hdsdf_batch(body_a, body_b, dtype="float32", **options)


def _forget() -> None:
    """Drop what JAX has compiled: it is not needed again, and would grow to gigabytes."""
    unions: Any = import_module("hdplan.distance.batch.unions")
    unions.evaluate.clear_cache()


def _seconds(distance: Any, poses: Poses, orders: Sequence[str]) -> dict[str, float]:
    """Return the time per query [s], by order, over a block of poses, half of them near contact."""
    block = poses.of(_mixed(poses))

    def run(order: str) -> None:
        for array in getattr(distance, order)(*block):
            np.asarray(array)  # waits for what runs in the background

    clock = process_time if getattr(distance, "device", "cpu") == "cpu" else perf_counter
    return {order: seconds_per_query(partial(run, order), BLOCK, clock) for order in orders}


def _bend(distance: Any, poses: Poses) -> float:
    """Return the root mean square [1/m] of the largest curvature of D along a translation, over poses near contact."""
    near = np.abs(poses.distances[_mixed(poses)]) <= NEAR_GAP
    curved = np.asarray(distance.hessian(*poses.of(_mixed(poses)))[3], dtype=float)[near, :3, :3]
    return float(np.sqrt(np.mean(np.linalg.norm(curved, ord=2, axis=(1, 2)) ** 2)))


def _mixed(poses: Poses) -> slice:
    """Return a block of poses, half of them drawn at random."""
    return slice(poses.drawn - BLOCK // 2, poses.drawn + BLOCK // 2)


def _entry(
    setting: Setting, bodies: str, distance: Any, poses: Poses, bend: float | None, seconds: Mapping[str, float]
) -> Entry:
    starts = range(0, len(poses.distances), BLOCK)
    found = [np.asarray(distance.value(*poses.of(slice(start, start + BLOCK))), dtype=float) for start in starts]
    value, separation = np.concatenate(found, axis=1)
    drawn, exact = value[: poses.drawn], poses.distances[: poses.drawn]
    error = value - poses.distances
    bands = {
        "apart": poses.distances > NEAR_GAP,
        "near": np.abs(poses.distances) <= NEAR_GAP,
        "deep": poses.distances < -NEAR_GAP,
    }
    return Entry(
        setting,
        bodies,
        {gap: float(np.sum((drawn <= 0) & (exact >= gap))) / max(int(np.sum(exact >= gap)), 1) for gap in GAPS},
        float(np.mean((value <= 0) & (separation > 0))),
        {band: float(np.median(error[some])) for band, some in bands.items()},
        {band: float(np.median(np.abs(error[some]))) for band, some in bands.items()},
        {band: float(np.percentile(np.abs(error[some]), 95)) for band, some in bands.items()},
        bend,
        dict(seconds),
    )


def _mean(*entries: Entry) -> Entry:
    """Return the mean of one setting's entries."""

    def mean(field: str) -> dict[Any, float]:
        return {key: float(np.mean([getattr(e, field)[key] for e in entries])) for key in getattr(entries[0], field)}

    times = {key: [e.seconds[key] for e in entries] for key in entries[0].seconds}
    return Entry(
        entries[0].setting,
        f"mean of {len(entries)}",
        mean("false_positives"),
        float(np.mean([e.sign_lost for e in entries])),
        mean("bias"),
        mean("median_error"),
        mean("high_error"),
        None if entries[0].bend is None else float(np.mean([e.bend for e in entries if e.bend is not None])),
        {key: float(np.exp(np.mean(np.log(values)))) for key, values in times.items()},
    )
