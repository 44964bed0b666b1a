"""Bodies and pairs, prepared for many motions: the distances at single configurations, and the proofs of motions."""

from __future__ import annotations

import numpy as np

from hdplan.planner.certificate.collision_proof import MOST_ITEMS, SHORTEST_INTERVAL, MotionProof, Proof
from hdplan.planner.certificate.configuration_distances import ConfigurationDistances
from hdplan.planner.certificate.placed_pairs import PlacedPairs, PreparedPairs, Spot
from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array, Mask


class Sweep(PreparedPairs):
    """The pairs of a robot in its world, those of obstacles and its own."""

    def distances(
        self, q: Array, within: float = np.inf, time: float = 0.0, surfaces: bool = False, unknown: bool = False
    ) -> tuple[Spot, ...]:
        """Return the signed distance of every pair at one configuration q (n,) at a time [s]: negative in contact.

        Pairs that are certainly farther apart than `within` [m] are left out. Where hulls are apart, the distance is
        theirs, or, with `surfaces`, that of the triangles that they contain; with `unknown`, less what that may take.
        """
        return ConfigurationDistances(self, q[None], time).all_pairs(within=within, surfaces=surfaces, unknown=unknown)

    def are_clear(self, rows: Array, floor: Array, time: float = 0.0) -> Mask:
        """True (B,) where every pair is apart, at configurations (B, n) at a time [s], by what it must keep (P,) [m],
        less what is unknown: what `distances` say, but no more is examined than decides it."""
        return ConfigurationDistances(self, rows, time).are_clear(floor)

    def nearest(self, rows: Array, times: Array, within: float = np.inf) -> list[tuple[Spot | None, Spot | None]]:
        """Return the closest pair of each group at each of the configurations (k, n) and times (k,) [s], exactly: by
        the surfaces, not their hulls.

        None for a group without a pair `within` [m].
        """
        found: list[tuple[Spot | None, Spot | None]] = []
        size = max(1, MOST_ITEMS // max(1, len(self.pairs.a)))
        for first in range(0, len(rows), size):
            some, when = rows[first : first + size], times[first : first + size]
            found += ConfigurationDistances(self, some, when).nearest(within)
        return found

    def hull_gap(self, q: Array, within: float, time: float = 0.0) -> float:
        """Return the distance of the robot's hulls from those of obstacles at one configuration q (n,) and time [s],
        at most `within` [m]: sooner known than the distance of the bodies, which is no less. Negative in an overlap."""
        return ConfigurationDistances(self, q[None], time).hull_gap(within)

    def witnesses(self, q: Array, pair: int, time: float = 0.0) -> Array:
        """Return the closest points (2, 3) [m] of two bodies at one configuration q (n,) and time [s], for pictures."""
        return ConfigurationDistances(self, q[None], time).witnesses(pair)

    def shares(self, curve: Curve, spot: Spot) -> Array:
        """Return the share of each of the scene's sizes in the distance at a place (6,) [m], by `sizes.FIELDS`."""
        sizes = self.bodies.sizes
        assert sizes is not None
        placed = PlacedPairs(self, curve)
        nodes = placed.place(*map(np.array, ([spot.interval], [spot.fraction], [0.0])))
        none = np.zeros(1, dtype=np.int64)
        return np.asarray(sizes.at_middle(nodes, self.pairs, none, none + spot.pair)[:, 0])

    def prove(
        self,
        curve: Curve,
        required: Array | float = 0.0,
        suspect: tuple[int, float] | None = None,
        shortest: float = SHORTEST_INTERVAL,
        measured: bool = True,
    ) -> Proof:
        """Prove a motion, or find where it cannot be proven.

        `required` [m], one for each pair (P,) or one for all, is what pairs must keep; at 0 they must not touch. A
        `suspect`, a waypoint interval and a fraction of it, is examined first, and the first contact found anywhere
        ends the search: failures are then not complete. A pair neither proven nor refuted on the `shortest` part of a
        waypoint interval counts as not proven. Without `measured` the proof stops at the required clearance: the proven
        one is then no less than required, and may be far less than the closest distance.
        """
        floor = np.broadcast_to(np.asarray(required, dtype=np.float64), self.pairs.a.shape)
        return MotionProof(self, curve, floor, suspect, shortest, measured).prove()
