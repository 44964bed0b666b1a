"""Places on a curve of poses in a loop of C: those of `PoseCurve.places`, equal but for rounding."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.certificate.pose_curve import PoseCurve


def pose_curve(curve: PoseCurve, parallel: float) -> Record:
    """The C struct of that name; a sine below `parallel` has no direction."""
    begins = curve.origins[:-1], curve.rotations[:-1]
    axis = 3 if curve.axis is None else curve.axis
    return Record("pose_curve", curve.steps, curve.turns, *begins, curve.ahead, axis, *curve.tolerances, parallel)


def places(
    loops: ModuleType,
    curve: Record,
    how: tuple[float, float, float],
    rotations: Array,
    origins: Array,
    moved: Array,
    first: float,
) -> Array:
    """Return places (k,), the first one given. `how`: the share of the link's own way (k − 1,) and the rest of the look
    ahead, and by how much a place may be farther away than the nearest."""
    found = np.full(len(origins), first)
    loops.places(curve.struct, *how, *map(np.ascontiguousarray, (rotations, origins, moved)), found)
    return found
