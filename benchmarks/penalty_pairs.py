"""Processor time of one pair's distance, with and without Python's loop around it.

The pairs are those of the first evaluation of a plan: two problems that differ in the distance alone, the
straight line as the motion. The HD-SDF has no loop in Python: the planner calls compiled code for all pairs at once.
"Without" is for FCL the same coal calls made by Pinocchio's loop in C++ (`computeDistances`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pinocchio as pin

from hdplan.planner.collision.euclidean import REQUEST, FclPairs
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.roadmap import seeds
from hdplan.planner.studies.report import markdown_text
from hdplan.scenes.array_types import Rows

REPEATS = 5  # the quickest counts
LEAST = 50  # pairs: fewer say little of a batch


@dataclass(frozen=True)
class PairTimes:
    """The same pairs by both, per pair [s]."""

    count: int
    hdsdf: float  # as the planner calls it, which is a compiled loop
    fcl: float  # as the planner calls it
    fcl_loop: float  # coal in a loop in C++


def measure(ours: Problem, exact: Problem) -> list[PairTimes]:
    """Time the pairs of every term at the samples of the straight line."""
    guess = next(seeds(ours, 0))
    kinematics = ours.kinematics.evaluate(ours.resampled(guess).samples.configurations(guess))
    result = []
    for mine, other in zip(ours.terms.pairs, exact.terms.pairs, strict=True):
        sample, pair = mine.pairs.close(kinematics)
        if len(pair) < LEAST:
            continue
        assert isinstance(mine.distance, HdsdfPairs)
        assert isinstance(other.distance, FclPairs)
        once = [_quickest(partial(each.distance, kinematics, sample, pair)) for each in (mine, other)]
        once.append(_loop_seconds(other.distance, kinematics, sample, pair))
        result.append(PairTimes(len(pair), *(seconds / len(pair) for seconds in once)))
    return result


def table(times: list[PairTimes]) -> str:
    """Markdown: means over all pairs."""
    if not times:
        return "Too few pairs to time.\n"
    count = np.array([t.count for t in times])

    def mean(name: str) -> float:
        return 1e6 * float(np.average([getattr(t, name) for t in times], weights=count))

    title = f"distance of a pair [µs], mean of {count.sum()}"
    columns = {"hdsdf": ("hdsdf", "hdsdf"), "fcl": ("fcl", "fcl_loop")}
    return markdown_text(
        [
            {title: name, "as the planner calls it": mean(whole), "compiled loop alone": mean(loop)}
            for name, (whole, loop) in columns.items()
        ]
    )


def _quickest(call: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return min(times)


def _loop_seconds(distance: FclPairs, kinematics: KinematicsBatch, sample: Rows, pair: Rows) -> float:
    """The same shapes at the same placements, as Pinocchio's geometry: two objects for each pair."""
    model, pairs = pin.GeometryModel(), distance.pairs
    for k, (s, p) in enumerate(zip(sample.tolist(), pair.tolist(), strict=True)):
        a, b = _placement(kinematics, s, pairs.joint_a[p]), _placement(kinematics, s, pairs.joint_b[p])
        b = b * pin.SE3(distance.placements[pairs.halfspace_body[p]])
        solids = distance.first[int(pairs.body[p])], distance.second[int(pairs.halfspace_body[p])]
        for side, place, solid in zip("ab", (a, b), solids, strict=True):
            model.addGeometryObject(pin.GeometryObject(f"{k}{side}", 0, 0, place, solid.shape))
        model.addCollisionPair(pin.CollisionPair(2 * k, 2 * k + 1))
    data = pin.GeometryData(model)
    robot = pin.Model()
    pin.updateGeometryPlacements(robot, robot.createData(), model, data, np.zeros(0))
    for request in data.distanceRequests:
        request.gjk_tolerance, request.epa_tolerance = REQUEST.gjk_tolerance, REQUEST.epa_tolerance
    return _quickest(lambda: pin.computeDistances(model, data))


def _placement(kinematics: KinematicsBatch, sample: int, joint: int) -> pin.SE3:
    return pin.SE3(kinematics.rotations[sample, joint], kinematics.translations[sample, joint])
