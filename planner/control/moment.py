"""The pairs of a controller at k configurations and times: which of them are near, and Δ with exact derivatives.

The derivative by q is the distance's wrench on the first body times the geometric Jacobian; Δ depends on the relative
pose only, so the second body's wrench is the opposite one, and a moving obstacle of world twist (v, ω) gives
∂Δ/∂t = −(F·v + T·ω).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hdplan.distance.compiled.loops import C, twin_of
from hdplan.planner.control.pair_level import PairLevel
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.once import read_only

NO_ROWS = read_only(np.empty(0, np.int64))
Distance = Callable[[KinematicsBatch, Rows, Rows], tuple[Array, Array, Array]]  # as `PairDistance` is called


@dataclass(frozen=True, eq=False)
class BarrierRows:
    """Δ and its derivatives, of S pairs, each at one configuration and time."""

    value: Array  # (S,) [m]
    gradient: Array  # (S, n) by the configuration
    drift: Array  # (S,) by time alone [m/s]
    separation: Array  # (S,) a lower bound of the true distance less the growth [m]; for the GDF no bound

    def part(self, chosen: slice | Mask | Rows) -> BarrierRows:
        """Return some of the rows."""
        return BarrierRows(self.value[chosen], self.gradient[chosen], self.drift[chosen], self.separation[chosen])


class Layout(NamedTuple):
    """P pairs, numbered through their levels."""

    robot: Robot
    joints: int  # number of the robot's, including the world
    levels: Sequence[tuple[int, PairLevel]]  # each with the number of its first pair
    moves: Array  # (P, m) 1 where a joint of the model moves only the first body, −1 only the second, else 0
    joint_b: Rows  # (P,) joint, or after these moving obstacle, that carries the second body
    outer: int  # pairs with obstacles, which come first
    standing: Mask  # (P,) whether it is a pair with a static obstacle, of which nearness is proven
    bounded: bool  # whether of all other pairs, too, what is not near is proven to be far
    exact: bool  # whether the links' hulls are known

    def parted(self, pair: Rows) -> Iterator[tuple[PairLevel, Rows, Rows]]:
        """Yield the levels of pairs (S,), each with the rows of its own and their numbers in the level."""
        for first, level in self.levels:
            own = np.flatnonzero((pair >= first) & (pair < first + len(level.pairs)))
            if len(own):
                yield level, own, pair[own] - first


class Moment(NamedTuple):
    """Robot and obstacles at k configurations and times."""

    layout: Layout
    kinematics: KinematicsBatch  # with the frames of the moving obstacles after the joints'
    twists: Array | None  # (k, m, 6) of the moving obstacles, if there are any

    def within(self, horizon: float) -> Rows:
        """Return the pairs, ascending, that may have a D̃ below the horizon [m] at one of the configurations: not those
        of static obstacles that are proven to have none."""
        standing = self.layout.standing
        if not standing.any() or not np.isfinite(horizon):
            return np.arange(len(standing))
        found = ~standing
        found[self.layout.levels[0][1].near(horizon).close(self.kinematics)[1]] = True
        return np.flatnonzero(found)

    def doubtful(self, needed: Sequence[float]) -> tuple[Rows, Rows]:
        """Return configurations and pairs (S,) that may have a D̃ below `needed` [m] (of pairs with obstacles, of pairs
        of links); every other one is proven to have none."""
        of = self.layout
        if not of.bounded:
            every = np.indices((len(self.kinematics.placements), len(of.moves))).reshape(2, -1)
            return every[0], every[1]
        found = [(NO_ROWS, NO_ROWS)]
        for first, level in of.levels:
            sample, pair = level.near(needed[0 if first < of.outer else 1]).close(self.kinematics)
            found.append((sample, pair + first))
        sample, pair = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return sample, pair

    def rows(self, sample: Rows, pair: Rows) -> BarrierRows:
        """Return Δ of pairs (S,) at configurations (S,)."""
        return self._evaluated(lambda level: level.outer.distance, sample, pair)

    def nearness(self, sample: Rows, pair: Rows) -> BarrierRows:
        """Return the exact distance of the links' hulls in pairs (S,), without growth, as `rows`. Nothing if the hulls
        are not known."""
        if not self.layout.exact:
            sample = pair = NO_ROWS
        return self._evaluated(lambda level: level.nearness, sample, pair)

    def _evaluated(self, distance: Callable[[PairLevel], Distance], sample: Rows, pair: Rows) -> BarrierRows:
        """Evaluate pairs by a distance of their level."""
        count = len(pair)
        value, wrench, separation = np.empty(count), np.empty((count, 6)), np.empty(count)
        for level, own, inner in self.layout.parted(pair):
            value[own], wrench[own], separation[own] = distance(level)(self.kinematics, sample[own], inner)
        return BarrierRows(value, self.by_joints(sample, pair, wrench), self._drift(sample, pair, wrench), separation)

    def by_joints(self, sample: Rows, pair: Rows, wrench: Array) -> Array:
        """Return the derivatives (S, n) by the configuration, of wrenches (S, 6) on the first bodies."""
        return self.layout.robot.fold(_by_joints(self.kinematics.columns, self.layout.moves, sample, pair, wrench))

    def _drift(self, sample: Rows, pair: Rows, wrench: Array) -> Array:
        """Return ∂Δ/∂t (S,) [m/s]."""
        drift = np.zeros(len(pair))
        if self.twists is not None:
            carried = np.flatnonzero(self.layout.joint_b[pair] >= self.layout.joints)
            twists = self.twists[sample[carried], self.layout.joint_b[pair[carried]] - self.layout.joints]
            drift[carried] = -np.einsum("si,si->s", wrench[carried], twists)
        return drift


def _in_c(columns: Array, moves: Array, sample: Rows, pair: Rows, wrench: Array) -> Array:
    gradient = np.empty((len(pair), len(moves.T)))
    C.by_joints(columns, moves, np.ascontiguousarray(sample), np.ascontiguousarray(pair), wrench, gradient)
    return gradient


@twin_of(_in_c)
def _by_joints(columns: Array, moves: Array, sample: Rows, pair: Rows, wrench: Array) -> Array:
    """Derivatives (S, n) by all joints of the model."""
    return np.asarray(np.einsum("sni,si->sn", columns[sample], wrench) * moves[pair])
