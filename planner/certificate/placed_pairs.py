"""Pairs of bodies placed along a curve, and their distances: the common part of the distances at single
configurations (`configuration_distances`) and of the proof of a motion (`collision_proof`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.containment import Containment
from hdplan.planner.certificate.exact_proximity import Piece
from hdplan.planner.certificate.interval_bounds import Bounds, Items
from hdplan.planner.certificate.intervals import Bodies, Intervals, Pairs
from hdplan.planner.certificate.part_distance import distance
from hdplan.planner.certificate.rounding import ROUNDING
from hdplan.planner.motion.curve import Curve
from hdplan.scenes.array_types import Array, Rows


@dataclass(frozen=True)
class Spot:
    """A place on the motion and the distance there."""

    interval: int  # between two rows of the curve
    fraction: float  # within it, 0 to 1
    pair: int  # row of the pairs
    distance: float  # [m] computed there: negative in contact (then minus the depth, where it is known)
    touching: bool = False  # whether that distance is too small; otherwise it could not be proven large enough
    unknown: float = 0.0  # [m] the part that is unknown: nominally the two are this much farther apart


class PreparedPairs:
    """Bodies and pairs, prepared for many motions."""

    def __init__(self, bodies: Bodies, pairs: Pairs) -> None:
        """Note for which pairs the distance of the hulls is not the exact one."""
        self.bodies, self.pairs = bodies, pairs
        self.hollow = bodies.hollow[pairs.a] | bodies.hollow[pairs.b]  # (P,)
        self.bounds, self.containment = Bounds(bodies, pairs), Containment(bodies, pairs)


class PlacedPairs:
    """Pairs along a curve, with the number of configurations and of exact distances computed so far."""

    def __init__(self, prepared: PreparedPairs, curve: Curve) -> None:
        """Bound how far each joint turns any body along the curve."""
        self.bodies, self.pairs, self.hollow = prepared.bodies, prepared.pairs, prepared.hollow
        self.bounds, self.containment = prepared.bounds, prepared.containment
        self.curve, self.rho = curve, prepared.bodies.reach(curve)
        self.configurations = self.exact_calls = 0

    def place(self, interval: Rows, start: Array, width: Array) -> Intervals:
        """Return the bodies on parts of the curve: from a start (k,), of a width (k,), in waypoint intervals."""
        self.configurations += len(interval)
        return Intervals.of(self.bodies, self.curve, self.rho, interval, start, width)

    def at_waypoints(self, rows: Rows) -> Intervals:
        """Return the bodies at waypoints (k,)."""
        interval = np.minimum(rows, len(self.curve) - 2)
        return self.place(interval, (rows - interval).astype(np.float64), np.zeros(len(rows)))

    def at_start(self) -> Intervals:
        """Return the bodies at the first waypoint."""
        return self.at_waypoints(np.zeros(1, dtype=np.int64))

    def surface(self, nodes: Intervals, node: int, pair: int, within: float = np.inf) -> float:
        """Return the distance of two bodies; one larger than `within` [m] need not be exact."""
        self.exact_calls += 1
        return distance(*self.posed(nodes, node, pair), within)

    def exact(self, nodes: Intervals, items: Items) -> tuple[Array, Array, Array, Array]:
        """Return the exact distances of hulls (i,) with their bounds and normals, as `Bounds.by_best_plane`."""
        self.exact_calls += len(items)
        return self.bounds.by_best_plane(nodes, items)

    def posed(self, nodes: Intervals, node: int, pair: int) -> tuple[Piece, Array, Piece, Array]:
        """Return two bodies, each with its pose (4, 4)."""
        a, b = int(self.pairs.a[pair]), int(self.pairs.b[pair])
        return self.bodies.pieces[a], nodes.pose(node, a), self.bodies.pieces[b], nodes.pose(node, b)

    def spot(
        self, nodes: Intervals, node: int, pair: int, distance: float, touching: bool, unknown: float = 0.0
    ) -> Spot:
        """Return the place in the middle of a part."""
        fraction = float(nodes.start[node] + 0.5 * nodes.width[node])
        whole = int(fraction) if nodes.width[node] > 1.0 else 0
        return Spot(int(nodes.interval[node]) + whole, fraction - whole, pair, distance, touching, unknown)

    def contained(self, nodes: Intervals, found: list[tuple[int, tuple[int, ...]]]) -> list[Spot]:
        """Return a place for each pair of which one is inside the other, as deep as the surfaces are apart: at least
        that far one of the two has to move."""
        return [
            self.spot(nodes, node, pairs[0], -max(min(self.surface(nodes, node, p) for p in pairs), ROUNDING), True)
            for node, pairs in found
        ]
