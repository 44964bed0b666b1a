"""The sight of a controller in one period: the distances of the pairs that are near, where the robot is and where it
would come to rest, with the margin and the rates of each pair.

Inside a margin the HD-SDF's shaping is inverted (`barrier_safety.straightened`), as it gives no direction on its flat
spot, and the exact distances of the links' hulls are seen, too.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from hdplan.planner.control.barrier_safety import straightened, sufficient_separation
from hdplan.planner.control.barriers import Barriers
from hdplan.planner.control.lows import Floors, Shaping, lows_among, lows_of_hulls
from hdplan.planner.control.moment import NO_ROWS, BarrierRows
from hdplan.planner.control.program_rows import NEAR_DISTANCE, BarrierConstraint
from hdplan.planner.control.settings import ControlSettings
from hdplan.planner.control.window import Window
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.errors import InputError

AT_REST = 10.0  # times η: the rate where the robot would come to rest, for pairs outside their margins
EXACT_SPACING = 5e-3  # [m] of travel between exact distances on the way to rest
UNBOUND_RATE = 1e-9  # share of a rate that leaves no row a bound: in place of 0, so that numbers stay finite


class Seen(NamedTuple):
    """The distances of one period."""

    pairs: Rows  # within the horizon at q, or where the robot comes to rest
    here: BarrierRows  # of these at q, as they are
    approach: BarrierConstraint  # what the program asks at q: the first to be felt, but no guarantee
    constraints: tuple[BarrierConstraint, BarrierConstraint]  # and for the guarantee: at rest, near ones exactly
    floors: Array  # (P,) [m] of Δ, on the way to rest of any command
    near: Array  # (P,) [m] of the exact distance
    inside: Rows  # pairs inside their margins


class Sight:
    """The pairs of a controller with their margins."""

    def __init__(self, barriers: Barriers, settings: ControlSettings) -> None:
        """Raises InputError for a horizon that is nearer than the margin."""
        self.barriers, self.settings = barriers, settings
        self.horizon = np.inf if settings.as_published else settings.horizon
        self._yielding = min(settings.rate, settings.yielding)
        b, each = settings.barriers, (settings.margin, settings.self_margin)
        shaped = b.distance.startswith("hdsdf")
        outer = np.arange(barriers.count) < barriers.obstacle_pairs
        self.margins = np.where(outer, *each)  # δ [m]
        bent, sure = _of_margins(each, b.gamma, b.shaping_length, barriers.corners)
        self.shaping = Shaping(b.gamma, b.shaping_length, np.where(outer, *bent)) if shaped else None
        self.next = barriers.coming.astype(np.int64)  # (P,) 1 for pairs of which only the next place counts
        self.needed = sure  # D̃ [m] above which Δ ≥ δ is certain, for obstacles and for links
        if barriers.standing.any() and not self.horizon > sure[0]:
            raise InputError(
                f"control.horizon: {settings.horizon:g} m is too near for a margin of {settings.margin:g} m, more than "
                f"{sure[0]:.3g} m is needed"
            )

    def look(self, window: Window, time: float) -> Seen:
        """Return the sight at the beginning of a period [s]."""
        barriers, rate = self.barriers, self.settings.rate
        path = window.stopping[[0, -1]] if len(window.stopping) > 1 else window.stopping
        times = time + self.settings.period * np.linspace(0.0, len(window.stopping) - 1, len(path))
        moment, last = barriers.at(path, times), len(path) - 1
        pairs = moment.within(self.horizon)
        found = moment.rows(np.repeat(np.arange(len(path)), len(pairs)), np.tile(pairs, len(path)))
        here, rest = found.part(slice(0, len(pairs))), found.part(slice(last * len(pairs), None))
        inside = NO_ROWS
        if self.settings.look_ahead:
            inside = pairs[np.minimum(here.value, rest.value) < self.margins[pairs]]
        near = moment.nearness(np.full(len(inside), last), inside)
        known = inside[: len(near.value)]
        straight, floors = self._straight(rest, pairs, inside), self._floors(window, time, inside)
        free = barriers.coming | np.isneginf(floors[0])
        slack, rates = straight.value - self.margins[pairs], self._rates(rest, pairs)
        guided = pairs[:0] if self.settings.as_published else pairs
        if len(guided):
            rates[slack > 0.0] *= AT_REST
        constraints = (
            BarrierConstraint(pairs, straight, slack, rates, free[pairs]),
            BarrierConstraint(
                known, near, np.maximum(near.value - NEAR_DISTANCE, 0.0), np.full(len(known), rate), free[known]
            ),
        )
        approach = self._approach(here.part(slice(len(guided))), guided, inside)
        return Seen(pairs, here, approach, constraints, *floors, inside)

    def _approach(self, here: BarrierRows, pairs: Rows, inside: Rows) -> BarrierConstraint:
        """Return the rows of the program at q."""
        rows, free = self._straight(here, pairs, inside), np.ones(len(pairs), dtype=np.bool_)
        return BarrierConstraint(pairs, rows, rows.value - self.margins[pairs], self._rates(here, pairs), free)

    def _floors(self, window: Window, time: float, inside: Rows) -> tuple[Array, Array]:
        """Return the floors of Δ and of the exact distances (P,) [m]: of pairs that are inside their margins the least
        on the way to rest if the robot brakes, at most δ and NEAR_DISTANCE.

        Pairs that overlap with an obstacle have none: the way out of one may lead deeper into another one, and with
        floors two that lead against each other would hold the robot for ever. In a world where something moves they
        have: it could push links in as deep as it likes."""
        floors, nearest = self.margins.copy(), np.full(self.barriers.count, NEAR_DISTANCE)
        if not len(inside):
            return floors, nearest
        path, every = window.stopping, np.zeros(self.barriers.count, np.int64)
        moment = self.barriers.at(path, time + self.settings.period * np.arange(len(path), dtype=np.float64))
        low = lows_among(moment, np.arange(len(path)), inside, self.shaping, Floors(floors, every, inside, 0.0))
        near = lows_of_hulls(moment, self.closely(path), inside, Floors(nearest, every, inside, 0.0))
        floors[low.pair] += low.over
        nearest[near.pair] += near.over
        if not self.barriers.coming.any():
            deep = np.flatnonzero(nearest[: self.barriers.obstacle_pairs] < 0.0)
            deep = deep[moment.nearness(np.zeros(len(deep), np.int64), deep).value < 0.0]
            floors[deep] = nearest[deep] = -np.inf
        return floors, nearest

    def closely(self, path: Array) -> Rows:
        """Return the samples of a path (k, n) at which exact distances are computed: the first, the last, and whenever
        the robot has moved on by EXACT_SPACING."""
        travel = np.abs(path[1:] - path[:-1]) @ self.barriers.levers
        marks = np.floor(np.concatenate([[0.0], travel.cumsum()]) / EXACT_SPACING)
        chosen = np.append(True, marks[1:] > marks[:-1])
        chosen[-1] = True
        return np.flatnonzero(chosen)

    def _straight(self, rows: BarrierRows, pairs: Rows, inside: Rows) -> BarrierRows:
        return rows if self.shaping is None else self.shaping.undone(rows, pairs, inside)

    def _rates(self, rows: BarrierRows, pairs: Rows) -> Array:
        """Return the rate of each row [1/s]: η, and for what stands still as in the controller's equation."""
        share = np.minimum(np.maximum(rows.separation, 0.0) / self.horizon, 1.0)
        rate = np.where(self.barriers.coming[pairs], self._yielding, self.settings.rate)
        return rate / np.where(self.barriers.standing[pairs], np.maximum(1.0 - share**2, UNBOUND_RATE), 1.0)


@functools.lru_cache(maxsize=64)
def _of_margins(
    margins: tuple[float, float], gamma: int, length: float, corners: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return of the margins of obstacles and of links δ − u(δ), and the D̃ above which Δ ≥ δ is certain [m]."""
    outer, own = (float(margin - straightened(margin, gamma, length)[0]) for margin in margins)
    sure_outer, sure_own = (sufficient_separation(margin, gamma, length, corners) for margin in margins)
    return (outer, own), (sure_outer, sure_own)
