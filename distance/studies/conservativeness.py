"""Share of gaps that the HD-SDF takes for contact: the paper's experiment, for its own set and the other rungs.

Out: the exact distances of random configurations of Platonic solids, and of those where D <= 0 (paper: section
IV-B, Figure 3).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.baselines.coal import signed_distances
from hdplan.distance.baselines.fcl import fcl_distances
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import RUNGS
from hdplan.distance.studies.random_poses import PLATONIC_PAIRS, paper_poses
from hdplan.distance.symbolic.compiled_pair import hdsdf_compiled
from hdplan.scenes.array_types import Array

CONFIGURATIONS = 500_000  # the paper's
GAMMA, EPSILON = 2, 1e-4  # the paper's
PASSES = 10  # the pairs are gone through so many times: what an interruption leaves holds all of them
FCL_SHARE = 300  # configurations of each pair, at most, that are held against FCL, the paper's exact distance


@dataclass(frozen=True, eq=False)
class RungAlarms:
    """The false positives of one set of normals: configurations it calls contact, though the bodies are apart."""

    normals: str
    gaps: Array  # (F,) [m] exact distances > 0


@dataclass(frozen=True, eq=False)
class Conservativeness:
    """Figures of ``conservativeness``."""

    planned: int  # requested configurations
    distances: Array  # (N,) [m] exact distances of the measured configurations
    missed: int  # contacts that some D called free: the distance is safe if there are none
    rungs: tuple[RungAlarms, ...]
    fcl_compared: int  # configurations held against FCL; 0 where it is not installed
    fcl_difference: float  # [m] largest difference of the two exact distances

    @property
    def complete(self) -> bool:
        """True if the study ran to its end."""
        return len(self.distances) == self.planned

    def rates(self, rung: RungAlarms, tolerances: ArrayLike) -> Array:
        """Return the false positives, D <= 0 and d > tol, as a part of the configurations with d >= tol, per tol."""
        tol = np.asarray(tolerances, dtype=float)
        return self._beyond(rung, tol) / np.maximum(len(self.distances) - _below(self.distances, tol, "left"), 1)

    def rates_of_all(self, rung: RungAlarms, tolerances: ArrayLike) -> Array:
        """Return these false positives as a fraction of all configurations."""
        return self._beyond(rung, np.asarray(tolerances, dtype=float)) / len(self.distances)

    def _beyond(self, rung: RungAlarms, tol: Array) -> Array:
        return len(rung.gaps) - _below(rung.gaps, tol, "right")


def conservativeness(
    configurations: int = CONFIGURATIONS,
    normals: Sequence[str] = RUNGS,
    *,
    seed: int = 0,
    with_fcl: bool = True,
    report: Callable[[int, int, str], None] = lambda done, of, what: None,
    stop: Callable[[], bool] = lambda: False,
) -> Conservativeness:
    """Count false alarms over random configurations, spread evenly over the 15 pairs of Platonic solids.

    Args:
        configurations: how many, the paper has 500,000.
        normals: the sets of normals.
        seed: of the random poses.
        with_fcl: hold some of them against FCL as well, which must be installed.
        report: called with (configurations done, all of them, what comes next).
        stop: called between pairs; True ends with what was found so far.
    """
    rng = np.random.default_rng(seed)
    bodies = [(ConvexBody.platonic(a), ConvexBody.platonic(b)) for a, b in PLATONIC_PAIRS]
    functions = [
        [hdsdf_compiled(a, b, gamma=GAMMA, epsilon=EPSILON, normals=name) for name in normals] for a, b in bodies
    ]
    shares = np.diff(np.linspace(0, configurations, len(bodies) * PASSES + 1).astype(int))
    exact: list[Array] = []
    gaps: list[list[Array]] = [[] for _ in normals]
    missed = compared = 0
    difference = 0.0
    for turn, share in enumerate(shares):
        if stop():
            break
        pair = turn % len(bodies)
        report(int(shares[:turn].sum()), configurations, "-".join(PLATONIC_PAIRS[pair]))
        poses_a, poses_b = paper_poses(rng, int(share))
        d = signed_distances(bodies[pair][0], poses_a, bodies[pair][1], poses_b)
        for k, function in enumerate(functions[pair]):
            contact = function.value(poses_a, poses_b)[0] <= 0.0
            gaps[k].append(d[contact & (d > 0.0)])
            missed += int(np.sum(~contact & (d <= 0.0)))
        if with_fcl and turn < len(bodies):
            answers = fcl_distances(bodies[pair][0], poses_a[:FCL_SHARE], bodies[pair][1], poses_b[:FCL_SHARE])
            apart = np.abs(answers.distances - d[:FCL_SHARE])[~answers.aborted]
            compared += len(apart)
            difference = max(difference, float(np.max(apart, initial=0.0)))
        exact.append(d)
    report(sum(map(len, exact)), configurations, "")
    rungs = tuple(
        RungAlarms(name, np.sort(np.concatenate([np.empty(0), *found])))
        for name, found in zip(normals, gaps, strict=True)
    )
    distances = np.sort(np.concatenate([np.empty(0), *exact]))
    return Conservativeness(configurations, distances, missed, rungs, compared, difference)


def _below(ordered: Array, tolerances: Array, side: Literal["left", "right"]) -> Array:
    return np.searchsorted(ordered, tolerances, side=side).astype(float)
