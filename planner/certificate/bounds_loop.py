"""The bounds of many pairs on many intervals, in loops of C: `Bounds.by_ball` and `Bounds.by_plane`.

To rounding the same as in NumPy, which machines without a compiler use. What is not a number stays so, and passes no
bound: a direction that is not finite has no support value.
"""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.scenes.array_types import Array, Rows

if TYPE_CHECKING:
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


def by_ball(loops: ModuleType, world: Record, nodes: Record, node: Rows, pair: Rows) -> tuple[Array, Array]:
    """Return a bound (i,) without what bodies drift and rounding may take, and the directions (i, 3)."""
    bound, normal = np.empty(len(node)), np.empty((len(node), 3))
    given = np.ascontiguousarray(node), np.ascontiguousarray(pair)
    loops.by_ball(world.struct, nodes.struct, *given, bound, normal)
    return bound, normal


def by_plane(
    loops: ModuleType, world: Record, nodes: Record, node: Rows, pair: Rows, normal: Array
) -> tuple[Array, Array, Array]:
    """Return gap(n) (i,), the bound over the interval without what rounding may take, and the bodies' travel (i,)."""
    gap, bound, travel = np.empty((3, len(node)))
    given = map(np.ascontiguousarray, (node, pair, normal))
    loops.by_plane(world.struct, nodes.struct, *given, gap, bound, travel)
    return gap, bound, travel
