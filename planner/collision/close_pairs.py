"""The loops of the broad phase in C: which balls reach which boxes, and which of them no plane separates.

In: the tables of body pairs, and placements of the joints at samples. Out: rows (sample, pair), pair by pair.
`broad_phase` has the same in NumPy, without the planes, for machines without a compiler. Rounding may decide
differently where a ball only just touches a box; there the distance is positive anyway.

Samples that follow one another lie close together in a motion, so each pair is first tested with balls around GROUP of
them, and before that with a ball around all.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C
from hdplan.scenes.array_types import Array, Rows

if TYPE_CHECKING:
    from hdplan.planner.collision.broad_phase import BodyPairs
    from hdplan.planner.kinematics.forward import KinematicsBatch

FIRST_ROWS = 1 << 10  # rows that there is room for at first
LEAST_SEPARATION = 1e-9  # [m] by which a plane must separate, so that rounding decides nothing


def close(pairs: BodyPairs, kinematics: KinematicsBatch) -> tuple[Rows, Rows]:
    """Samples and pairs (S,) of the rows that are close, pair by pair."""
    return _rows(pairs, kinematics.placements, None, None)


def close_to_standing(pairs: BodyPairs, centres: Array, reach: Array) -> tuple[Rows, Rows]:
    """The same of balls of other centres (bodies, batch, 3) and reaches (bodies,), with standing boxes."""
    return _rows(pairs, None, np.ascontiguousarray(centres), np.ascontiguousarray(reach))


def _rows(pairs: BodyPairs, *given: Array | None) -> tuple[Rows, Rows]:
    room = FIRST_ROWS
    while True:
        sample, pair = np.empty(room, np.int64), np.empty(room, np.int64)
        count = C.close_rows(pairs.tables.struct, *given, LEAST_SEPARATION, sample, pair)
        if count <= room:
            return sample[:count], pair[:count]
        room = count
