"""The lowest distances of pairs on a way, below their floors, for the look-ahead.

Inside a margin the HD-SDF's shaping is inverted (`barrier_safety.straightened`), as it gives no direction on its flat
spot. The loop in C examines every row once and keeps one for each pair, where NumPy makes arrays of all of them, in a
tenth of the time; without a compiler, and for distances that have no loop, it is NumPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hdplan.distance.compiled.loops import C, Record, twin_of
from hdplan.planner.collision.close_pairs import LEAST_SEPARATION
from hdplan.planner.control.barrier_safety import straightened
from hdplan.planner.control.moment import NO_ROWS, BarrierRows, Moment
from hdplan.scenes.array_types import Array, Rows

FIRST_ROOM = 32  # pairs for which there is room at first


class Shaping(NamedTuple):
    """The shaping of an HD-SDF that is undone."""

    gamma: int
    length: float  # [m]
    bent: Array  # (P,) [m] by which u(δ) is less than the margin δ

    def undone(self, rows: BarrierRows, pairs: Rows, inside: Rows) -> BarrierRows:
        """Return the rows of `pairs` with Δ of those `inside` their margins as u(Δ) − u(δ) + δ, where u is the
        separation before shaping: it grows with Δ and is δ where Δ is, but also has a slope on the flat spot."""
        found = np.flatnonzero((pairs[:, None] == inside).any(axis=1)) if len(inside) else NO_ROWS
        if not len(found):
            return rows
        separation, slope = straightened(rows.value[found], self.gamma, self.length)
        steep = np.divide(1.0, slope, out=np.zeros_like(slope), where=slope > 0.0)
        value, gradient, drift = rows.value.copy(), rows.gradient.copy(), rows.drift.copy()
        value[found] = separation + self.bent[pairs[found]]
        gradient[found] *= steep[:, None]
        drift[found] *= steep
        return replace(rows, value=value, gradient=gradient, drift=drift)


class Floors(NamedTuple):
    """The floors of P pairs, and which rows count."""

    values: Array  # (P,) [m]
    next: Rows  # (P,) 1 for pairs of which only the first sample counts, else 0
    inside: Rows  # pairs whose shaping is undone
    lower: float  # [m] above its floor, below which a pair is low


class Lows(NamedTuple):
    """The pairs (m,) that are low, each where it is lowest."""

    over: Array  # by how much it is above its floor [m]
    gradient: Array  # (m, n) of the distance by the configuration
    sample: Rows
    pair: Rows


def lows_near(moment: Moment, needed: Sequence[float], shaping: Shaping | None, floors: Floors) -> Lows:
    """Return the lows of Δ among the pairs that may have a D̃ below `needed` [m] (`Moment.doubtful`)."""
    if not _looped(moment):
        return _lows_of(moment.rows, *moment.doubtful(needed), shaping, floors)
    found = _Found(moment, shaping, floors)
    for first, level in moment.layout.levels:
        near = level.near(needed[0 if first < moment.layout.outer else 1]).tables.struct
        found.look(C.lows_near, level.barrier, near, first, LEAST_SEPARATION)
    return found.lows


def _looped(moment: Moment) -> bool:
    """True if the loops know the distance of all pairs."""
    return all(level.barrier is not None for _, level in moment.layout.levels)


def lows_among(moment: Moment, samples: Rows, pairs: Rows, shaping: Shaping | None, floors: Floors) -> Lows:
    """Return the lows of Δ of pairs (k,) among samples."""
    if not _looped(moment):
        return _lows_of(moment.rows, *_crossed(samples, pairs), shaping, floors)
    found = _Found(moment, shaping, floors)
    for level, own, inner in moment.layout.parted(pairs):
        found.look(C.lows_among, level.barrier, samples, pairs[own], inner)
    return found.lows


def _hulls_in_c(moment: Moment, samples: Rows, pairs: Rows, floors: Floors) -> Lows:
    if not moment.layout.exact:
        pairs = NO_ROWS
    found = _Found(moment, None, floors)
    for level, own, inner in moment.layout.parted(pairs):
        found.look(C.lows_among, level.hulls.barrier, samples, pairs[own], level.hulls.row[inner])
    return found.lows


@twin_of(_hulls_in_c)
def lows_of_hulls(moment: Moment, samples: Rows, pairs: Rows, floors: Floors) -> Lows:
    """Return the lows of the exact distance of the links' hulls in pairs (k,) among samples."""
    return _lows_of(moment.nearness, *_crossed(samples, pairs), None, floors)


def _crossed(samples: Rows, pairs: Rows) -> tuple[Rows, Rows]:
    """Return every sample with each of the pairs (S,), sample by sample."""
    return np.repeat(samples, len(pairs)), np.tile(pairs, len(samples))


def _lows_of(
    distance: Callable[[Rows, Rows], BarrierRows], sample: Rows, pair: Rows, shaping: Shaping | None, floors: Floors
) -> Lows:
    """Return the lows of rows (S,), in NumPy."""
    rows = distance(sample, pair)
    if shaping is not None:
        rows = shaping.undone(rows, pair, floors.inside)
    over = rows.value - floors.values[pair]
    low = np.flatnonzero((over < floors.lower) & ((sample == 0) | (floors.next[pair] == 0)))
    order = low[np.lexsort((sample[low], over[low], pair[low]))]
    first = order[np.flatnonzero(np.diff(pair[order], prepend=-1))]
    return Lows(over[first], rows.gradient[first], sample[first], pair[first])


class _Found:
    """The lows that the loops find."""

    def __init__(self, moment: Moment, shaping: Shaping | None, floors: Floors) -> None:
        self._moment, self._inside = moment, floors.inside if shaping is not None else NO_ROWS
        bent = floors.values if shaping is None else shaping.bent
        self._floors = floors.values, bent, floors.next, self._inside, floors.lower
        self._parts: list[Lows] = []

    def look(self, loop: Callable[..., int], barrier: Record | None, *given: Any) -> None:
        """Add what a loop finds of the pairs of a barrier."""
        assert barrier is not None
        room = FIRST_ROOM
        while True:
            over, wrench = np.empty(room), np.empty((room, 6))
            sample, pair = np.empty((2, room), np.int64)
            placements = self._moment.kinematics.placements
            count = loop(barrier.struct, placements, *self._floors, *given, over, sample, pair, wrench)
            if count <= room:
                break
            room = count
        if count:
            of = sample[:count], pair[:count]
            self._parts.append(Lows(over[:count], self._moment.by_joints(*of, wrench[:count]), *of))

    @property
    def lows(self) -> Lows:
        """All of them."""
        if len(self._parts) == 1:
            return self._parts[0]
        nothing = Lows(np.empty(0), np.empty((0, self._moment.layout.robot.n)), NO_ROWS, NO_ROWS)
        return Lows(*(np.concatenate(each) for each in zip(nothing, *self._parts, strict=True)))
