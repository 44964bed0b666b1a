"""The proof itself: lower bounds on the distance of moving bodies over a whole continuous motion.

Waypoints and pairs of bodies → a proven lower bound, the closest place found, and every place where the proof fails.
For one interval of the motion and one pair A, B, with n a unit direction (world frame) and everything taken at the
interval's midpoint, the motion bounds of `motion_bounds` give, since the bracket is concave in s,

    d(A(s), B(s)) ≥ min_{s = ±1} [ min_{a ∈ A} n·(a + s a') − max_{b ∈ B} n·(b + s b') ] − R_A − R_B,   |s| ≤ 1,

two values of support functions, n·(a + s a') = (n + s n × Ω)·a + s n·U. For a pair whose joints have a common ancestor,
only the joints beyond it count: the motion is seen from there. Any n gives a true bound; coal gives the best one. An
interval whose bound does not suffice is halved: R falls with the square of its length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hdplan.planner.intervals import Bodies, Index, Intervals, Pairs
from hdplan.planner.motion_bounds import Array, Mask, Motion
from hdplan.planner.proximity import (
    DOUBTFUL,
    Piece,
    best_direction,
    contains,
    direction,
    surface_distance,
)

ROUNDING = 1e-9  # taken off every bound [m]: floating point at the scale of a robot errs by less than a millionth of it
SHORTEST = 2.0**-17  # of a waypoint interval: below it, the answer is "not proven"
STILL = 1e-6  # [m] motion below which halving is of no use
TOLERANCE = 5e-4  # [m] by which the proven clearance may fall short of the closest place found,
RELATIVE_TOLERANCE = 0.05  # or by this part of it, whichever is larger; never by more than half
FIRST_CHUNK = 64  # pairs looked at before the closest distance is known; later ones are looked at in larger chunks
MOST_EXACT_CALLS = 300_000  # exact distances computed in one proof, then the rest is "not proven"


@dataclass(frozen=True)
class Spot:
    """A place on the motion and the distance there."""

    interval: int  # waypoint interval
    fraction: float  # within it, 0 to 1
    pair: int  # row of the pairs
    distance: float  # [m] computed there: negative in contact (then minus the depth, where it is known)
    touching: bool = False  # the distance there falls short; otherwise it could not be proven to suffice


@dataclass(frozen=True)
class Proof:
    """What was found out about the whole motion."""

    clearance: tuple[float, float]  # [m] proven lower bound for each group, inf without pairs
    closest: tuple[Spot | None, Spot | None]  # the least distance met, for each group
    failures: tuple[Spot, ...]  # every waypoint interval and pair without proof, the worst place met there
    configurations: int  # at which distances were computed
    exact_calls: int  # of the exact distance


@dataclass(frozen=True, eq=False)
class _Items:
    """Pairs on intervals, still open."""

    node: Index  # (i,) row of the nodes
    pair: Index  # (i,)
    bound: Array  # (i,) proven so far [m]
    normal: Array  # (i, 3) direction to try, from b to a; 0 where there is none yet
    motion_a: Motion  # of the bodies a, none until it is computed
    motion_b: Motion

    def __getitem__(self, rows: Mask | Index) -> _Items:
        return _Items(
            self.node[rows],
            self.pair[rows],
            self.bound[rows],
            self.normal[rows],
            self.motion_a[rows],
            self.motion_b[rows],
        )

    def __len__(self) -> int:
        return len(self.node)

    @classmethod
    def of(cls, node: Index, pair: Index, bound: Array, normal: Array) -> _Items:
        """Build without the motions, which depend on the intervals."""
        still = Motion.none(len(node))
        return cls(node, pair, bound, normal, still, still)


class Sweep:
    """Bodies and pairs made ready for many motions."""

    def __init__(self, bodies: Bodies, pairs: Pairs) -> None:
        """Note which pairs are not told by their hulls alone."""
        self.bodies, self.pairs = bodies, pairs
        self.hollow = bodies.hollow[pairs.a] | bodies.hollow[pairs.b]  # (P,)

    def distances(self, q: Array, within: float = np.inf) -> tuple[Spot, ...]:
        """Return the signed distance of every pair at one configuration q (n,): negative in contact.

        Pairs that are certainly farther apart than `within` [m] are left out.
        """
        return _Run(self, np.stack([q, q]), 0.0).at_start(within=within)

    def nearest(self, q: Array, within: float = np.inf) -> tuple[Spot | None, Spot | None]:
        """Return the closest pair of each group at one configuration q (n,), exactly: by surfaces, not their hulls.

        None for a group of which no pair is `within` [m], or none at all.
        """
        return _Run(self, np.stack([q, q]), 0.0).nearest_at_start(within)

    def prove(self, waypoints: Array, required: float = 0.0) -> Proof:
        """Prove a motion through `waypoints` (N, n), or find where it cannot be proven.

        `required` [m] is what group 0 must keep; group 1 must not touch.
        """
        return _Run(self, waypoints, required).prove()


class _Run:
    """One motion's proof under way."""

    def __init__(self, sweep: Sweep, waypoints: Array, required: float) -> None:
        self.bodies, self.pairs, self.hollow = sweep.bodies, sweep.pairs, sweep.hollow
        self.waypoints, self.floor, self.rho = waypoints, (required, 0.0), sweep.bodies.reach(waypoints)
        self.clearance = [np.inf, np.inf]
        self.closest: list[Spot | None] = [None, None]
        self.failures: dict[tuple[int, int], Spot] = {}
        self.failed = np.zeros((len(waypoints) - 1, len(self.pairs.a)), dtype=bool)
        self.configurations = self.exact_calls = 0

    def prove(self) -> Proof:
        count = len(self.waypoints) - 1
        if len(self.pairs.a):
            nodes = self._place(np.arange(count), np.zeros(count), np.ones(count))
            items: _Items | None = self._all_pairs(count)
            while items:
                items = self._examine(nodes, items)
                if items:
                    nodes, items = self._halve(nodes, items)
            for spot in self.at_start(only=self.hollow):
                if spot.distance < 0.0:  # the surfaces may never touch when one lies within the other all the time
                    self._fail(spot)
        return Proof(
            (self.clearance[0], self.clearance[1]),
            (self.closest[0], self.closest[1]),
            tuple(sorted(self.failures.values(), key=lambda spot: (spot.interval, spot.distance))),
            self.configurations,
            self.exact_calls,
        )

    def at_start(self, only: Mask | None = None, within: float = np.inf) -> tuple[Spot, ...]:
        """Return the signed distances of all pairs (or some) at the first waypoint, but for those that balls tell to be
        farther apart than `within`."""
        nodes = self._place(np.zeros(1, dtype=np.int64), np.zeros(1), np.zeros(1))
        items = self._all_pairs(1)
        if only is not None:
            items = items[only]
        if within < np.inf:
            bound, _ = self._ball_bound(nodes, items, nodes.centers(items.node, self.pairs.a[items.pair]))
            items = items[bound <= within + ROUNDING]
        if not len(items):
            return ()
        values, _, _ = self._exact(nodes, items)
        spots = []
        for value, pair in zip(values.tolist(), items.pair.tolist(), strict=True):
            if value <= 0.0 and self.hollow[pair]:
                value = self._surface(nodes, 0, pair)
                if contains(*self._posed(nodes, 0, pair)):
                    value = -max(value, ROUNDING)
            spots.append(Spot(0, 0.0, pair, value, value <= 0.0))
        return tuple(spots)

    def nearest_at_start(self, within: float) -> tuple[Spot | None, Spot | None]:
        """Return the closest pair of each group at the first waypoint, if it is `within`."""
        nodes = self._place(np.zeros(1, dtype=np.int64), np.zeros(1), np.zeros(1))
        best: list[Spot | None] = [None, None]
        for spot in sorted(
            self.at_start(within=within), key=lambda spot: spot.distance
        ):  # a surface is no closer than its hull
            group = int(self.pairs.group[spot.pair])
            least = best[group]
            if least is not None and least.distance <= spot.distance:
                continue
            if self.hollow[spot.pair] and not spot.touching:
                spot = replace(spot, distance=max(spot.distance, self._surface(nodes, 0, spot.pair)))
            if spot.distance <= within and (least is None or spot.distance < least.distance):
                best[group] = spot
        return best[0], best[1]

    # --- one round ----------------------------------------------------------------------------------------------------

    def _examine(self, nodes: Intervals, items: _Items) -> _Items | None:
        """Raise the items' bounds, the most pressing first, and return those that have to be halved."""
        pairs = self.pairs
        motion_a = nodes.motion(items.node, pairs.a[items.pair], pairs.moves_a[items.pair])
        motion_b = nodes.motion(items.node, pairs.b[items.pair], pairs.moves_b[items.pair])
        center = nodes.centers(items.node, pairs.a[items.pair])
        bound, normal = self._ball_bound(nodes, items, center)
        bound -= motion_a.first + motion_b.first + ROUNDING
        known = np.any(items.normal != 0.0, axis=1, keepdims=True)
        bound, normal = np.maximum(items.bound, bound), np.where(known, items.normal, normal)
        items = _Items(items.node, items.pair, bound, normal, motion_a, motion_b)
        order, first, size, left = np.argsort(items.bound), 0, FIRST_CHUNK, []
        while first < len(order):
            chunk = self._open(nodes, items[order[first : first + size]])
            first, size = first + size, 4 * size
            if len(chunk):
                _, bound = self._plane_bound(nodes, chunk, chunk.normal)
                chunk = self._open(nodes, replace(chunk, bound=np.maximum(chunk.bound, bound)))
            if len(chunk):
                chunk = self._open(nodes, self._exactly(nodes, chunk))
            if len(chunk):
                left.append(chunk)
        if not left:
            return None
        items = _Items.of(
            np.concatenate([part.node for part in left]),
            np.concatenate([part.pair for part in left]),
            np.concatenate([part.bound for part in left]),
            np.concatenate([part.normal for part in left]),
        )
        items = self._open(nodes, items)  # the closest distance has come down since
        return items if len(items) else None

    def _open(self, nodes: Intervals, items: _Items) -> _Items:
        """Drop the items that are proven as far as need be, or failed; what the former prove counts."""
        group = self.pairs.group[items.pair]
        enough = np.array([self._goal(0), self._goal(1)])[group]
        failed = self.failed[nodes.interval[items.node], items.pair]
        closed = (items.bound >= enough) & (items.bound > 0.0) & ~failed
        for which in (0, 1):
            proven = items.bound[closed & (group == which)]
            if len(proven):
                self.clearance[which] = min(self.clearance[which], float(proven.min()))
        return items[~closed & ~failed]

    def _goal(self, group: int) -> float:
        """Return the bound [m] at which a pair needs no closer look."""
        spot = self.closest[group]
        if spot is None:
            return np.inf
        tolerance = min(max(TOLERANCE, RELATIVE_TOLERANCE * spot.distance), 0.5 * spot.distance)
        return max(self.floor[group], spot.distance - tolerance)

    def _exactly(self, nodes: Intervals, items: _Items) -> _Items:
        """Raise the items' bounds by exact distances at the midpoints, and note the closest places and the contacts."""
        values, bound, normals = self._exact(nodes, items)
        bound = np.maximum(items.bound, bound)
        group = self.pairs.group[items.pair]
        goal = np.array([self._goal(0), self._goal(1)])[group]
        hollow = self.hollow[items.pair]
        for i in np.flatnonzero(hollow & (values < goal) & (bound < goal)).tolist():
            values[i] = self._surface(nodes, int(items.node[i]), int(items.pair[i]))
            moved = items.motion_a.first[i] + items.motion_b.first[i] + ROUNDING
            bound[i] = max(bound[i], values[i] - moved)
        for i in np.argsort(values).tolist():
            node, pair, value = int(items.node[i]), int(items.pair[i]), float(values[i])
            spot = self._spot(nodes, node, pair, value, value <= self.floor[group[i]])
            best = self.closest[group[i]]
            if best is None or value < best.distance:
                self.closest[group[i]] = spot
            if spot.touching:
                self._fail(spot)
        return replace(items, bound=bound, normal=normals)

    def _halve(self, nodes: Intervals, items: _Items) -> tuple[Intervals, _Items]:
        """Cut the intervals of the open items in two; give up those that are as short as they may become."""
        moved = (np.abs(nodes.delta)[:, None] * nodes.reach).sum(axis=2)  # (k, bodies)
        still = moved[items.node, self.pairs.a[items.pair]] + moved[items.node, self.pairs.b[items.pair]] <= STILL
        hopeless = still | (nodes.width[items.node] <= SHORTEST) | (self.exact_calls > MOST_EXACT_CALLS)
        for node, pair, bound in zip(
            items.node[hopeless], items.pair[hopeless], items.bound[hopeless].tolist(), strict=True
        ):
            self._fail(self._spot(nodes, int(node), int(pair), bound, False))
        items = items[~hopeless]
        used, row = np.unique(items.node, return_inverse=True)
        width = 0.5 * np.repeat(nodes.width[used], 2)
        start = np.repeat(nodes.start[used], 2) + width * np.tile([0.0, 1.0], len(used))
        halves = _Items.of(
            np.concatenate([2 * row, 2 * row + 1]),
            np.tile(items.pair, 2),
            np.tile(items.bound, 2),
            np.tile(items.normal, (2, 1)),
        )
        return self._place(np.repeat(nodes.interval[used], 2), start, width), halves

    def _fail(self, spot: Spot) -> None:
        key = (spot.interval, spot.pair)
        self.failed[key] = True
        worst = self.failures.get(key)
        if worst is None or spot.distance < worst.distance:
            self.failures[key] = spot

    # --- bounds -------------------------------------------------------------------------------------------------------

    def _ball_bound(self, nodes: Intervals, items: _Items, center: Array) -> tuple[Array, Array]:
        """Return the distance of a's bounding ball to b's bounding box at the midpoint, and its direction, b to a."""
        b = self.pairs.b[items.pair]
        rotation = nodes.rotation[items.node, b]
        middle = nodes.centers(items.node, b)
        local = np.einsum("iba,ib->ia", rotation, center - middle)
        away = local - np.clip(local, -self.bodies.half[b], self.bodies.half[b])
        distance = np.linalg.norm(away, axis=1)
        inside = (distance == 0.0)[:, None]
        outward = np.einsum("iab,ib->ia", rotation, np.where(inside, local, away))
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        normal = np.where(length > 0.0, outward / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
        return distance - self.bodies.radius[self.pairs.a[items.pair]], normal

    def _plane_bound(self, nodes: Intervals, items: _Items, normal: Array) -> tuple[Array, Array]:
        """Return gap(n) at the midpoint and the bound over the interval (module's head); `normal` (i, 3) is unit."""
        near, far = (
            self._extremes(nodes, items.node, bodies[items.pair], motion, sign * normal)
            for bodies, motion, sign in ((self.pairs.a, items.motion_a, -1), (self.pairs.b, items.motion_b, 1))
        )
        gaps = -near - far  # (3, i) at s = 0, 1, −1
        first = items.motion_a.first + items.motion_b.first
        second = items.motion_a.second + items.motion_b.second
        return gaps[0], np.maximum(gaps[1:].min(axis=0) - second, gaps[0] - first) - ROUNDING

    def _extremes(self, nodes: Intervals, node: Index, body: Index, motion: Motion, normal: Array) -> Array:
        """Return max_{x ∈ body} n·(x + s x') for s = 0, 1, −1: (3, i)."""
        turn, slide = np.cross(normal, motion.omega), np.einsum("ij,ij->i", normal, motion.velocity)
        directions = np.stack([normal, normal + turn, normal - turn])  # (3, i, 3)
        values = np.einsum("sij,ij->si", directions, nodes.origin[node, body])
        values[1] += slide
        values[2] -= slide
        local = np.einsum("iba,sib->sia", nodes.rotation[node, body], directions)
        order = np.argsort(body, kind="stable")
        cuts = np.flatnonzero(np.diff(body[order])) + 1
        for rows in np.split(order, cuts):
            piece = self.bodies.pieces[body[rows[0]]]
            values[:, rows] += piece.support(local[:, rows].reshape(-1, 3)).reshape(3, -1)
        return np.asarray(values)

    def _exact(self, nodes: Intervals, items: _Items) -> tuple[Array, Array, Array]:
        """Return the hulls' signed distance at the midpoints, the bound over the intervals and the directions."""
        pairs, pieces = self.pairs, self.bodies.pieces
        normals, said = np.empty((len(items), 3)), np.empty(len(items))
        for i, (node, pair) in enumerate(zip(items.node.tolist(), items.pair.tolist(), strict=True)):
            a, b = int(pairs.a[pair]), int(pairs.b[pair])
            found = direction(pieces[a].shape, nodes.transform(node, a), pieces[b].shape, nodes.transform(node, b))
            normals[i], said[i] = found.normal, found.distance
        self.exact_calls += len(items)
        values, bound = self._plane_bound(nodes, items, normals)
        doubtful = np.flatnonzero(~((values > 0.0) & (said > 0.0) & (np.abs(values - said) < DOUBTFUL)))
        for i in doubtful.tolist():
            normals[i], _ = best_direction(*self._posed(nodes, int(items.node[i]), int(items.pair[i])))
        if len(doubtful):
            values[doubtful], bound[doubtful] = self._plane_bound(nodes, items[doubtful], normals[doubtful])
        return values, bound, normals

    def _surface(self, nodes: Intervals, node: int, pair: int) -> float:
        self.exact_calls += 1
        return surface_distance(*self._posed(nodes, node, pair))

    # --- small parts --------------------------------------------------------------------------------------------------

    def _place(self, interval: Index, start: Array, width: Array) -> Intervals:
        self.configurations += len(interval)
        return Intervals.of(self.bodies, self.waypoints, self.rho, interval, start, width)

    def _all_pairs(self, nodes: int) -> _Items:
        count = len(self.pairs.a)
        size = nodes * count
        return _Items.of(
            np.repeat(np.arange(nodes), count),
            np.tile(np.arange(count), nodes),
            np.full(size, -np.inf),
            np.zeros((size, 3)),
        )

    def _posed(self, nodes: Intervals, node: int, pair: int) -> tuple[Piece, Array, Piece, Array]:
        a, b = int(self.pairs.a[pair]), int(self.pairs.b[pair])
        return self.bodies.pieces[a], nodes.pose(node, a), self.bodies.pieces[b], nodes.pose(node, b)

    def _spot(self, nodes: Intervals, node: int, pair: int, distance: float, touching: bool) -> Spot:
        fraction = float(nodes.start[node] + 0.5 * nodes.width[node])
        return Spot(int(nodes.interval[node]), fraction, pair, distance, touching)
