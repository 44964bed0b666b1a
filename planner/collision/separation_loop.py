"""The search of `separation_bounds` for one pair, in one loop of C: best box first, each halved alone.

The normal between the bodies is that of GJK (E. G. Gilbert, D. W. Johnson, S. S. Keerthi, 1988) on their vertices. Its
distance only decides which boxes are worth halving: the bound holds along any unit normal.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.scenes.array_types import Array


def separation(
    loops: ModuleType,
    tree: Record,
    hulls: tuple[tuple[int, Array], tuple[int, Array]],
    radii: float,
    moves: Array,
    ranges: tuple[Array, Array],
    wanted: float,
    tight: float,
    most: int,
) -> tuple[float, int]:
    """Return the least bound [m] over the ranges of the joints, and how many boxes were evaluated.

    `hulls` are the joint and the vertices (m, 3) of either body; `moves` (n,) is 1 where a coordinate moves the first
    alone, −1 where it moves the second alone.
    """
    (joint, vertices), (other, more) = hulls
    given = map(np.ascontiguousarray, (moves, *ranges))
    bound, looked = loops.separation(
        *(tree.struct, joint, np.ascontiguousarray(vertices), other, np.ascontiguousarray(more), radii),
        *(*given, wanted, tight, max(most, 0)),
    )
    return float(bound), int(looked)
