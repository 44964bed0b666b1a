"""Places on a curve of poses in a loop of C: those of `PoseCurve.places`, equal but for rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C, Record
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.certificate.pose_curve import PoseCurve

LOOK_AHEAD = 2.0  # of the link's own way since the last node, in tolerances: how far the next place is sought
CATCH_UP = 1.0  # tolerances that it may be farther, to catch up
# tolerances that a place may be farther away than the nearest: where a curve turns back, its end comes later
SOONER = 0.25
PARALLEL = 1e-12  # sine below which two directions have no axis of their own


def pose_curve(curve: PoseCurve) -> Record:
    """The C struct of that name."""
    begins = curve.origins[:-1], curve.rotations[:-1]
    axis = 3 if curve.axis is None else curve.axis
    return Record("pose_curve", curve.steps, curve.turns, *begins, curve.ahead, axis, *curve.tolerances, PARALLEL)


def places(curve: PoseCurve, rotations: Array, origins: Array, moved: Array, first: float) -> Array:
    """Places (k,), the first one given."""
    found = np.full(len(origins), first)
    given = map(np.ascontiguousarray, (rotations, origins, moved))
    C.places(curve.record.struct, LOOK_AHEAD, CATCH_UP, SOONER, *given, found)
    return found
