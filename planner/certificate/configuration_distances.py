"""Distances of all pairs at single configurations: which are clear, how close the closest come, and witness points."""

from __future__ import annotations

import numpy as np

from hdplan.planner.certificate.exact_proximity import witness_points
from hdplan.planner.certificate.interval_bounds import Items
from hdplan.planner.certificate.part_distance import closest_parts
from hdplan.planner.certificate.placed_pairs import PlacedPairs, PreparedPairs, Spot
from hdplan.planner.certificate.rounding import ROUNDING
from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array, Mask

CLEAR_OVERLAP = 1e-3  # [m] by which hulls overlap where no closer look is needed


class ConfigurationDistances(PlacedPairs):
    """Pairs at configurations, each at a time."""

    def __init__(self, prepared: PreparedPairs, rows: Array, times: Array | float) -> None:
        """Place the pairs at configurations (B, n), each at a time (B,) [s] or all at one."""
        when = np.broadcast_to(times, len(rows))
        super().__init__(prepared, Curve.through(np.concatenate([rows, rows[-1:]]), np.append(when, when[-1:])))

    def all_pairs(self, within: float = np.inf, surfaces: bool = False, unknown: bool = False) -> tuple[Spot, ...]:
        """Return the signed distances of all pairs at the first configuration, except for those that bounding balls
        prove to be farther apart than `within`."""
        nodes = self.at_start()
        spots = self.contained(nodes, self.containment.found(nodes))
        items = Items.all(1, np.arange(len(self.pairs.a)))
        if within < np.inf:
            bound, _ = self.bounds.by_ball(nodes, items)
            items = items[bound <= within + ROUNDING]
        if not len(items):
            return tuple(spots)
        values, *_ = self.exact(nodes, items)
        less = self.bounds.unknown(nodes, items) if unknown else np.zeros(len(items))
        for value, pair, off in zip(values.tolist(), items.pair.tolist(), less.tolist(), strict=True):
            if value <= 0.0 and self.hollow[pair]:
                value = self.surface(nodes, 0, pair)
            elif surfaces and self.hollow[pair] and value - off <= within:
                value = max(value, self.surface(nodes, 0, pair))
            spots.append(Spot(0, 0.0, pair, value - off, value - off <= 0.0, off))
        return tuple(spots)

    def are_clear(self, floor: Array) -> Mask:
        """True where all pairs are apart, at each configuration, by what each must keep (P,)."""
        nodes = self.at_waypoints(np.arange(len(self.curve) - 1))
        clear = np.ones(len(nodes.interval), dtype=bool)
        clear[[node for node, _ in self.containment.found(nodes)]] = False
        items = Items.all(len(clear), np.arange(len(self.pairs.a)))
        bound, normal = self.bounds.by_ball(nodes, items)
        near = (bound <= floor[items.pair] + ROUNDING) & clear[items.node]
        items, normal = items[near], normal[near]
        _, bound, _ = self.bounds.by_plane(nodes, items, normal)
        items = items[bound <= floor[items.pair] + ROUNDING]
        if not len(items):
            return clear
        hollow = self.hollow[items.pair]
        values, deep = self.bounds.overlapping(nodes, items, CLEAR_OVERLAP)
        less, kept = self.bounds.unknown(nodes, items), floor[items.pair]

        def close(apart: Array) -> Mask:
            return np.asarray((apart - less <= 0.0) | (apart - less < kept))

        clear[items.node[deep & ~hollow]] = False
        rows = np.flatnonzero(close(values - ROUNDING) & ~deep & clear[items.node])  # by their first directions
        values[rows], *_ = self.exact(nodes, items[rows])
        doubtful = close(values)
        clear[items.node[doubtful & ~hollow]] = False
        for i in np.flatnonzero(doubtful)[np.argsort(values[doubtful])].tolist():  # their hulls, but maybe not they
            node = int(items.node[i])
            if clear[node]:
                values[i] = self.surface(nodes, node, int(items.pair[i]), max(kept[i], 0.0) + less[i])
                clear[node] = not close(values)[i]
        return clear

    def hull_gap(self, within: float) -> float:
        """Return the least distance of hulls to obstacles at the first configuration, at most `within`."""
        nodes = self.at_start()
        items = Items.all(1, np.flatnonzero(self.pairs.group == 0))
        bound, _ = self.bounds.by_ball(nodes, items)
        items = items[bound <= within + ROUNDING]
        return float(self.bounds.overlapping(nodes, items, CLEAR_OVERLAP)[0].min(initial=within))

    def nearest(self, within: float) -> list[tuple[Spot | None, Spot | None]]:
        """Return the closest pair of each group at each configuration, if it is `within`."""
        nodes = self.at_waypoints(np.arange(len(self.curve) - 1))
        count, group = 2 * len(nodes.interval), self.pairs.group
        best: list[Spot | None] = [None] * count  # of both groups at each waypoint
        least = np.full(count, within)  # [m] their distances

        def meet(spot: Spot) -> None:
            place = 2 * spot.interval + int(group[spot.pair])
            if spot.distance < least[place] or (best[place] is None and spot.distance <= within):
                best[place], least[place] = spot, spot.distance

        for spot in self.contained(nodes, self.containment.found(nodes)):
            meet(spot)
        items = Items.all(len(nodes.interval), np.arange(len(group)))
        bound, _ = self.bounds.by_ball(nodes, items)
        place = 2 * items.node + group[items.pair]
        order = np.lexsort((bound, place))
        _, first = np.unique(place[order], return_index=True)
        new, left = order[first], np.ones(len(items), dtype=bool)  # first the pairs whose balls are closest
        for _ in range(2):
            # within a ball that reaches a box, bodies may overlap deeper than the bound says
            new = new[bound[new] <= np.maximum(least[place[new]], 0.0) + ROUNDING]
            values, *_ = self.exact(nodes, items[new])
            for i in np.argsort(values, kind="stable").tolist():
                value, node, pair = float(values[i]), int(items.node[new[i]]), int(items.pair[new[i]])
                if value > least[place[new[i]]]:  # a surface is no closer than its hull
                    continue
                if self.hollow[pair]:
                    surface = self.surface(nodes, node, pair)
                    value = surface if value <= 0.0 else max(value, surface)
                meet(Spot(node, 0.0, pair, value, value <= 0.0))
            left[new] = False
            new = np.flatnonzero(left)
        return list(zip(best[::2], best[1::2], strict=True))

    def witnesses(self, pair: int) -> Array:
        """Return the closest points (2, 3) of two bodies at the first configuration."""
        nodes = self.at_start()
        return witness_points(*closest_parts(*self.posed(nodes, 0, pair)))
