"""The search of `separation_bounds` for one pair, in one loop of C: best box first, each halved alone.

The normal between the bodies is that of GJK (E. G. Gilbert, D. W. Johnson, S. S. Keerthi, 1988) on their vertices. Its
distance only decides which boxes are worth halving: the bound holds along any unit normal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.collision.separation_bounds import Search

TIGHT_SHARE = 0.9  # share of the least distance found at which a bound is good enough


def least_bound(search: Search, pair: int, low: Array, high: Array, wanted: float, most: int) -> tuple[float, int]:
    """The least bound [m] over the ranges of the joints, and how many boxes were evaluated."""
    a, b = (search.bodies[index] for index in search.pairs[pair])
    hulls = (each for side in (a, b) for each in (side.joint, np.ascontiguousarray(side.body.vertices)))
    given = map(np.ascontiguousarray, (search.distance.pairs.moves[pair], low, high))
    bound, looked = C.separation(
        search.kinematics.tree.struct, *hulls, a.body.radius + b.body.radius, *given, wanted, TIGHT_SHARE, max(most, 0)
    )
    return float(bound), int(looked)
