"""The bounds of many pairs on many intervals, in loops of C: `Bounds.by_ball` and `Bounds.by_plane`.

To rounding the same as in NumPy, which machines without a compiler use. What is not a number stays so, and passes no
bound: a direction that is not finite has no support value.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C, Record
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.certificate.interval_bounds import Bounds, Items
    from hdplan.planner.certificate.intervals import Bodies, Intervals, Pairs


def world(bodies: Bodies, pairs: Pairs) -> Record:
    """The C struct of that name."""
    pieces = bodies.pieces
    number, none = np.array([len(piece.vertices) for piece in pieces], np.int64), np.zeros(3)
    whole = (bodies.chain.revolute, bodies.row, bodies.step, pairs.a, pairs.b, pairs.moves_a, pairs.moves_b)
    return Record(
        "world",
        *(each.astype(np.int64) for each in whole),
        np.concatenate([np.empty((0, 3)), *(piece.vertices for piece in pieces)]),
        *(np.cumsum(number) - number, number),
        *(np.array([piece.ball for piece in pieces]), np.array([piece.disc for piece in pieces])),
        np.array([none if piece.radii is None else piece.radii for piece in pieces]).reshape(-1, 3),
        *(bodies.half, bodies.radius),
    )


def intervals(nodes: Intervals) -> Record:
    """The C struct of that name."""
    drift = nodes.drift
    return Record(
        "intervals",
        *(nodes.rotation, nodes.origin, nodes.center, nodes.reach),
        *(nodes.delta, nodes.deviation, nodes.axes, nodes.points),
        *((None,) * 4 if drift is None else (drift.omega, drift.velocity, drift.first, drift.second)),
    )


def by_ball(bounds: Bounds, nodes: Intervals, items: Items) -> tuple[Array, Array]:
    """Bounds (i,) and directions (i, 3)."""
    bound, normal = np.empty(len(items)), np.empty((len(items), 3))
    given = np.ascontiguousarray(items.node), np.ascontiguousarray(items.pair)
    C.by_ball(bounds.world.struct, nodes.record.struct, *given, bound, normal)
    return bound, normal


def by_plane(bounds: Bounds, nodes: Intervals, items: Items, normal: Array) -> tuple[Array, Array, Array]:
    """gap(n), the bound over the interval and the bodies' travel (i,)."""
    gap, bound, travel = np.empty((3, len(items)))
    given = map(np.ascontiguousarray, (items.node, items.pair, normal))
    C.by_plane(bounds.world.struct, nodes.record.struct, *given, gap, bound, travel)
    return gap, bound, travel
