"""The loops of the broad phase in C: which balls reach which boxes, and which of them no plane separates.

In: the tables of body pairs, and placements of the joints at samples. Out: rows (sample, pair), pair by pair.
`broad_phase` has the same in NumPy, without the planes, for machines without a compiler. Rounding may decide
differently where a ball only just touches a box; there the distance is positive anyway.

Samples that follow one another lie close together in a motion, so each pair is first tested with balls around GROUP of
them, and before that with a ball around all.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.scenes.array_types import Array, Rows

FIRST_ROWS = 1 << 10  # rows that there is room for at first
LEAST_SEPARATION = 1e-9  # [m] by which a plane must separate, so that rounding decides nothing


def close_rows(
    loops: ModuleType,
    tables: Record,
    placements: Array | None,
    centres: Array | None = None,
    reach: Array | None = None,
) -> tuple[Rows, Rows]:
    """Return samples and pairs (S,) of the rows that are close, pair by pair: at placements (batch, joints, 12), or of
    balls of other centres (bodies, batch, 3) and reaches (bodies,), with standing boxes."""
    room = FIRST_ROWS
    given = [None if x is None else np.ascontiguousarray(x) for x in (placements, centres, reach)]
    while True:
        sample, pair = np.empty(room, np.int64), np.empty(room, np.int64)
        count = loops.close_rows(tables.struct, *given, LEAST_SEPARATION, sample, pair)
        if count <= room:
            return sample[:count], pair[:count]
        room = count
