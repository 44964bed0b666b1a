"""The proof itself: lower bounds on the distance of moving bodies over a whole continuous motion.

A curve and pairs of bodies → a proven lower bound, the closest place found, and every place where the proof fails.
Each pair on each interval between waypoints is bounded, the most critical first, by ever tighter bounds
(`interval_bounds`); an interval whose bound does not suffice is halved. Of long motions several intervals at a time are
bounded first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdplan.planner.certificate.interval_bounds import Items
from hdplan.planner.certificate.intervals import Intervals
from hdplan.planner.certificate.part_bounds import PartBounds
from hdplan.planner.certificate.placed_pairs import PlacedPairs, PreparedPairs, Spot
from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.deadline import seconds_left
from hdplan.scenes.errors import TimeLimitError

SHORTEST_INTERVAL = 2.0**-17  # of a waypoint interval: below it, the answer is "not proven"
LEAST_MOTION = 1e-6  # [m] motion below which halving does not help
CLEARANCE_TOLERANCE = 5e-4  # [m] by which the proven clearance may fall short of the least distance found,
RELATIVE_TOLERANCE = 0.05  # or by this share of it, whichever is larger; never by more than half
# share of this tolerance by which a place must be closer than the closest known one to be examined
CLOSER_SHARE = 0.02
FIRST_PAIRS = 6  # evaluated where each comes closest, before the closest distance is known; later chunks are larger,
MEASURING_FACTOR = 2  # each by this factor: what it finds spares the next one measurements
ROOTS = 64  # parts, at least, in which a motion is bounded first: of a longer one these are several intervals each
WAYPOINTS_AT_ONCE = 256  # at which open meshes are checked
BATCH_FACTOR = 8  # times as many pairs at once where groups of bodies settle most of their items
MOST_ITEMS = 30_000  # pairs on intervals evaluated together: more would only fill the memory
MOST_EXACT_CALLS = 300_000  # exact distances computed in one proof; after that the rest is "not proven"


@dataclass(frozen=True)
class Proof:
    """Findings for the whole motion; by default none."""

    clearance: tuple[float, float] = (np.inf, np.inf)  # [m] proven lower bound for each group, inf without pairs
    closest: tuple[Spot | None, Spot | None] = (None, None)  # the least distance found, for each group
    failures: tuple[Spot, ...] = ()  # every waypoint interval and pair without proof, with the worst place found there
    configurations: int = 0  # at which distances were computed
    exact_calls: int = 0  # of the exact distance
    whole: bool = True  # whether no pair was passed over, but for a contact that ended the search


class MotionProof(PlacedPairs):
    """The proof of one motion in progress."""

    def __init__(
        self,
        prepared: PreparedPairs,
        curve: Curve,
        floor: Array,
        suspect: tuple[int, float] | None = None,
        shortest: float = SHORTEST_INTERVAL,
        measured: bool = True,
    ) -> None:
        """Take what is to be proven: see `Sweep.prove`."""
        super().__init__(prepared, curve)
        self.floor = floor
        self.suspect, self.shortest, self.measured = suspect, shortest, measured
        self.clearance = [np.inf, np.inf]
        self.closest: list[Spot | None] = [None, None]
        self.failures: dict[tuple[int, int], Spot] = {}
        self.failed = np.zeros((len(curve) - 1, len(self.pairs.a)), dtype=bool)
        self.looked_at = 0
        self.parts = PartBounds(self.bodies, self.pairs)
        self._required: Array | None = None  # (P,) what `_enough` returns, until a closer place is found

    def prove(self) -> Proof:
        """Return the findings for the whole motion."""
        for spot in self._inside():
            self._met(spot)
        if self.suspect is not None:
            self._look_at(*self.suspect)
        if len(self.pairs.a) and not self._settled():
            self._prove_all()
        return Proof(
            (self.clearance[0], self.clearance[1]),
            (self.closest[0], self.closest[1]),
            tuple(sorted(self.failures.values(), key=lambda spot: (spot.interval, spot.distance))),
            self.configurations,
            self.exact_calls,
            self.looked_at == len(self.pairs.a) or self._settled(),
        )

    def _prove_all(self) -> None:
        """Prove the pairs in the order of how close they come, as bounded by a ball around the whole motion: the far
        ones are settled as soon as it is known how close the closest come."""
        roots = self._roots()
        count = len(roots.interval)
        far = self.bounds.over_all(roots)  # (P,)
        order, size = np.argsort(far, kind="stable"), max(MOST_ITEMS // count, 1)
        grouped, first = self.bounds.by_groups(roots), 0
        while first < len(order):
            more = size if grouped is None or first == 0 else BATCH_FACTOR * size  # groups leave few of their items
            pairs, first = order[first : first + more], first + more
            self.looked_at += len(pairs)
            group = self.pairs.group[pairs]
            done = (far[pairs] >= self._enough(pairs)) & (far[pairs] > 0.0)
            for which in (0, 1):
                self.clearance[which] = min(
                    self.clearance[which], float(far[pairs[done & (group == which)]].min(initial=np.inf))
                )
            nodes, items = roots, self._left(count, pairs[~done], grouped) if not done.all() else None
            while items:
                items = self._examine(nodes, items)
                if self._settled():
                    return
                if items:
                    nodes, items = self._halve(nodes, items)

    def _roots(self) -> Intervals:
        """Return the first parts of the motion: all of its intervals, or several of a long one each, where
        nothing depends on time."""
        intervals, width = len(self.curve) - 1, 1
        if self.bodies.sizes is None and not self.bodies.drifting.any():
            while intervals >= 2 * ROOTS * width:
                width *= 2
        first = np.minimum(np.arange(0, intervals, width), intervals - width)
        return self.place(first, np.zeros(len(first)), np.full(len(first), float(width)))

    def _left(self, count: int, pairs: Rows, grouped: tuple[Array, Rows] | None) -> Items:
        """Return the pairs on all intervals, without those that the balls around groups settle."""
        if grouped is None:
            return Items.all(count, pairs)
        bounds, column = grouped
        bound = np.where(column[pairs] < 0, -np.inf, bounds[:, column[pairs]])  # (k, pairs)
        open_ones = (bound < self._enough(pairs)) | (bound <= 0.0)
        settled = bound[~open_ones]  # of pairs with obstacles
        self.clearance[0] = min(self.clearance[0], float(settled.min(initial=np.inf)))
        node, row = np.nonzero(open_ones)
        return Items(node, pairs[row], bound[open_ones], np.zeros((len(node), 3)))

    def _look_at(self, interval: int, fraction: float) -> None:
        """Record how close the pairs are at one place, those whose balls come too close there."""
        nodes = self.place(np.array([interval]), np.array([fraction]), np.zeros(1))
        items = Items.all(1, np.arange(len(self.pairs.a)))
        bound, _ = self.bounds.by_ball(nodes, items)
        items = items[bound <= self.floor]
        if len(items):
            self._exactly(nodes, items)

    # --- one inside the other ----------------------------------------------------------------------------------------

    def _inside(self) -> list[Spot]:
        """Return the bodies that lie inside others at the start of the motion, or inside open meshes at a waypoint: the
        first such waypoint."""
        nodes = self.at_start()
        spots = self.contained(nodes, self.containment.found(nodes))
        rows = np.arange(1, len(self.curve)) if self.containment.open.any() else np.arange(0)
        for first in range(0, len(rows), WAYPOINTS_AT_ONCE):
            nodes, known = self.at_waypoints(rows[first : first + WAYPOINTS_AT_ONCE]), {spot.pair for spot in spots}
            earliest = {pairs: (node, pairs) for node, pairs in reversed(self.containment.found_in_open(nodes))}
            spots += self.contained(nodes, [each for pairs, each in earliest.items() if pairs[0] not in known])
        return spots

    # --- one round ----------------------------------------------------------------------------------------------------

    def _examine(self, nodes: Intervals, items: Items) -> Items | None:
        """Raise the items' bounds, the most critical first, and return the items that have to be halved."""
        bound, normal = self.bounds.by_ball(nodes, items)
        known = np.any(items.normal != 0.0, axis=1, keepdims=True)
        items = replace(items, bound=np.maximum(items.bound, bound), normal=np.where(known, items.normal, normal))
        unsettled = self._open(nodes, items)
        if not len(unsettled):
            return None
        size = min(FIRST_PAIRS, int(np.count_nonzero(np.bincount(items.pair))))
        items = items[~(items.bound > unsettled.bound.max())]  # the rest is settled, and would come last
        order, left = np.argsort(items.bound, kind="stable"), []  # equal bounds in one order on every processor
        # no pair twice at first: many intervals of one pair would all be measured before the closest pair is known
        pair, place = items.pair[order], np.arange(len(order))
        first_of = np.empty(len(self.pairs.a), dtype=np.int64)
        first_of[pair[::-1]] = place[::-1]
        lowest = np.flatnonzero(first_of[pair] == place)[:FIRST_PAIRS]
        order = np.concatenate([order[lowest], np.delete(order, lowest)])
        first, after = 0, len(lowest)
        while first < len(order):
            chunk = self._open(nodes, items[order[first:after]])
            first, size = after, MEASURING_FACTOR * size
            after += size
            if len(chunk):
                _, bound, _ = self.bounds.by_plane(nodes, chunk, chunk.normal)
                chunk = self._open(nodes, replace(chunk, bound=np.maximum(chunk.bound, bound)))
            if len(chunk):
                chunk = self._open(nodes, self._exactly(nodes, chunk))
            if self._settled():
                return None
            if len(chunk):
                left.append(chunk)
        if not left:
            return None
        items = Items(
            np.concatenate([part.node for part in left]),
            np.concatenate([part.pair for part in left]),
            np.concatenate([part.bound for part in left]),
            np.concatenate([part.normal for part in left]),
        )
        items = self._open(nodes, items)  # the closest distance has come down since
        return items if len(items) else None

    def _settled(self) -> bool:
        """True if a place found too close ends the search."""
        return self.suspect is not None and any(spot.touching for spot in self.failures.values())

    def _open(self, nodes: Intervals, items: Items) -> Items:
        """Return the items neither proven far enough apart nor failed, recording what the proven ones keep."""
        closed = (items.bound >= self._enough(items.pair)) & (items.bound > 0.0)
        failed = np.zeros(len(items), dtype=bool)
        if self.failures:
            failed = self.failed[nodes.interval[items.node], items.pair] & (nodes.width[items.node] <= 1.0)
        if closed.any():
            kept = closed & ~failed
            proven, group = items.bound[kept], self.pairs.group[items.pair[kept]]
            for which in (0, 1):
                self.clearance[which] = min(self.clearance[which], float(proven[group == which].min(initial=np.inf)))
        elif not self.failures:
            return items
        return items[~(closed | failed)]

    def _enough(self, pairs: Rows) -> Array:
        """Return the bounds [m] at which pairs (i,) are settled."""
        if self._required is None:
            goals = np.array([_goal(distance) for distance in self._least()])
            self._required = np.maximum(self.floor, goals[self.pairs.group])
        return self._required[pairs]

    def _least(self) -> list[float]:
        """Return the least distances [m] found, for each group, whose clearance is to be proven; −inf if none is."""
        none = np.inf if self.measured else -np.inf
        return [none if spot is None or not self.measured else spot.distance for spot in self.closest]

    def _exactly(self, nodes: Intervals, items: Items) -> Items:
        """Raise the items' bounds by exact distances at the midpoints, and record the closest places and contacts."""
        hulls, bound, normals = np.full(len(items), -np.inf), items.bound.copy(), items.normal.copy()
        rows = np.flatnonzero(~self.parts.overlap[items.pair])
        hulls[rows], higher, _, normals[rows] = self.exact(nodes, items[rows])
        bound[rows] = np.maximum(bound[rows], higher)
        items = replace(items, bound=bound, normal=normals)
        unknown = self.bounds.unknown(nodes, items)
        values = self._by_parts(nodes, items, hulls - unknown, unknown)
        touching = values <= self.floor[items.pair]
        order = np.argsort(values, kind="stable")
        group, notable = self.pairs.group[items.pair[order]], touching[order]
        for which in (0, 1):
            notable[np.flatnonzero(group == which)[:1]] = True  # the closest
        for i in order[notable].tolist():
            node, pair, value = int(items.node[i]), int(items.pair[i]), float(values[i])
            self._met(self.spot(nodes, node, pair, value, bool(touching[i]), float(unknown[i])))
        return items

    def _by_parts(self, nodes: Intervals, items: Items, hulls: Array, unknown: Array) -> Array:
        """Return the distances of all pairs, given those of their hulls, and raise the bounds of those whose hulls are
        not their exact shape. A distance that would change nothing is infinite. What is `unknown` (i,) [m] is taken off
        all of them."""
        group, hollow = self.pairs.group[items.pair], self.hollow[items.pair]
        if not hollow.any():
            return hulls
        values = np.where(hollow, np.inf, hulls)
        known = self._least()
        least = [min(known[which], float(values[group == which].min(initial=np.inf))) for which in (0, 1)]
        enough = np.maximum(self.floor[items.pair], np.array([_goal(distance) for distance in least])[group])
        closer = hulls < np.array(least)[group]
        rows = np.flatnonzero(hollow & (closer | ((hulls < enough) & (items.bound < enough))))
        if not len(rows):
            return values
        self.parts.overlap[items.pair[rows[hulls[rows] + unknown[rows] <= 0.0]]] = True
        parts = self.parts.on(nodes, items[rows])
        for k in np.argsort(hulls[rows], kind="stable").tolist():
            i, which = int(rows[k]), int(group[rows[k]])
            floor, closest = float(self.floor[items.pair[i]]), least[which]
            goal = max(floor, _goal(closest))
            if hulls[i] < closest or (hulls[i] < goal and items.bound[i] < goal):
                self.exact_calls += 1
                near = closest - CLOSER_SHARE * (closest - _goal(closest)) if np.isfinite(closest) else closest
                within = max(near, floor)
                try:
                    found = parts.bound(k, within + float(unknown[i]), goal)
                except TimeLimitError:  # what is left is not proven
                    break
                items.bound[i] = max(items.bound[i], found.bound)
                if (distance := max(float(hulls[i]), found.distance - float(unknown[i]))) <= within:
                    values[i], least[which] = distance, min(closest, distance)
        return values

    def _halve(self, nodes: Intervals, items: Items) -> tuple[Intervals, Items]:
        """Halve the intervals of the open items; give up those that are as short as they may become."""
        a, b = (nodes.row(items.node, bodies[items.pair]) for bodies in (self.pairs.a, self.pairs.b))
        moved = nodes.moved[a] + nodes.moved[b]
        if (sizes := self.bodies.sizes) is not None:  # which no halving makes smaller, but what obstacles go meanwhile
            moved = moved - nodes.instants.moved[a] - nodes.instants.moved[b]
            gone = nodes.latest[items.node] - nodes.instants.latest[items.node]
            moved = moved + sizes.speed[self.pairs.b[items.pair]] * gone
        still = (moved <= LEAST_MOTION) & (nodes.width[items.node] <= 1.0)
        over = self.exact_calls > MOST_EXACT_CALLS or seconds_left() == 0.0
        undecided = still | (nodes.width[items.node] <= self.shortest) | over
        for node, pair, bound in zip(
            items.node[undecided], items.pair[undecided], items.bound[undecided].tolist(), strict=True
        ):
            spot, first = self.spot(nodes, int(node), int(pair), bound, False), int(nodes.interval[node])
            for each in range(first, first + max(1, int(nodes.width[node]))):
                self._fail(replace(spot, interval=each))
        items = items[~undecided]
        used, row = np.unique(items.node, return_inverse=True)
        width = 0.5 * np.repeat(nodes.width[used], 2)
        start = np.repeat(nodes.start[used], 2) + width * np.tile([0.0, 1.0], len(used))
        interval = np.repeat(nodes.interval[used], 2)
        if len(width) and width[0] >= 1.0:  # whole intervals
            interval, start = interval + start.astype(np.int64), np.zeros(len(start))
        halves = Items(
            np.concatenate([2 * row, 2 * row + 1]),
            np.tile(items.pair, 2),
            np.tile(items.bound, 2),
            np.tile(items.normal, (2, 1)),
        )
        return self.place(interval, start, width), halves

    def _met(self, spot: Spot) -> None:
        """Record a distance that was found."""
        group = int(self.pairs.group[spot.pair])
        best = self.closest[group]
        if best is None or spot.distance < best.distance:
            self.closest[group], self._required = spot, None
        if spot.touching:
            self._fail(spot)

    def _fail(self, spot: Spot) -> None:
        key = (spot.interval, spot.pair)
        self.failed[key] = True
        worst = self.failures.get(key)
        if worst is None or spot.distance < worst.distance:
            self.failures[key] = spot


def _goal(distance: float) -> float:
    """Return the greatest clearance [m] that can be proven where this is the least distance found, less a tolerance."""
    if not np.isfinite(distance):
        return distance
    return distance - min(max(CLEARANCE_TOLERANCE, RELATIVE_TOLERANCE * distance), 0.5 * distance)
