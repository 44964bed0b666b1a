"""Bounds over intervals of a motion for pairs of bodies whose hulls are not their exact shapes, by their parts.

What `part_distance` finds for a pair on one interval is remembered for the next: most of the directions are as good
there.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.certificate.interval_bounds import Items
from hdplan.planner.certificate.intervals import Bodies, Intervals, Pairs
from hdplan.planner.certificate.part_distance import Found, Placed, part_distance
from hdplan.planner.motion.motion_bounds import Motion
from hdplan.scenes.array_types import Array


class PartBounds:
    """The bounds on one motion."""

    def __init__(self, bodies: Bodies, pairs: Pairs) -> None:
        """Begin without any directions."""
        self.bodies, self.pairs = bodies, pairs
        self.overlap = np.zeros(len(pairs.a), dtype=bool)  # (P,) pairs whose hulls were found to meet
        self.tried: dict[int, Array] = {}  # directions (k, 3) for the parts of a pair

    def on(self, nodes: Intervals, items: Items) -> PartsOnIntervals:
        """Prepare items."""
        return PartsOnIntervals(self, nodes, items)


class PartsOnIntervals:
    """Items whose parts may be examined."""

    def __init__(self, bounds: PartBounds, nodes: Intervals, items: Items) -> None:
        """Compute how the bodies move."""
        pairs = bounds.pairs
        self.bounds, self.nodes, self.items = bounds, nodes, items
        self.a, self.b = pairs.a[items.pair], pairs.b[items.pair]
        self.motion_a = nodes.motion(items.node, self.a, pairs.moves_a[items.pair])
        self.motion_b = nodes.motion(items.node, self.b, pairs.moves_b[items.pair])
        self.moved = self.motion_a.first + self.motion_b.first, self.motion_a.second + self.motion_b.second
        if (sizes := bounds.bodies.sizes) is not None:
            elsewhere = sizes.elsewhere(nodes, pairs, items.node, items.pair)
            self.moved = self.moved[0] + elsewhere, self.moved[1] + elsewhere
        self.rows = nodes.row(items.node, self.a), nodes.row(items.node, self.b)

    def bound(self, i: int, within: float, enough: float) -> Found:
        """Return the result for the parts of one item, as in `part_distance`."""
        pair, normals, own = int(self.items.pair[i]), self.items.normal[i, None], self.bounds
        found = part_distance(
            self._placed(int(self.a[i]), int(self.rows[0][i]), self.motion_a, i),
            self._placed(int(self.b[i]), int(self.rows[1][i]), self.motion_b, i),
            (float(self.moved[0][i]), float(self.moved[1][i])),
            np.concatenate([normals, own.tried[pair]]) if pair in own.tried else normals,
            within,
            enough,
        )
        own.tried[pair] = found.normals
        return found

    def _placed(self, body: int, row: int, motion: Motion, i: int) -> Placed:
        at = self.nodes
        return Placed(
            self.bounds.bodies.pieces[body], at.rotation[row], at.origin[row], motion.omega[i], motion.velocity[i]
        )
