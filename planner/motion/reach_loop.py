"""The reach ρ of many bodies in loops of C: `Chain.reach_around` and `Chain.local_reach`, equal but for rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.distance.compiled.loops import C
from hdplan.scenes.array_types import Array, Rows

if TYPE_CHECKING:
    from hdplan.planner.motion.motion_bounds import Chain


def reach_around(chain: Chain, joints: Rows, cylinders: Array, travel: Array) -> Array:
    """ρ (g, n) for all configurations."""
    rho = np.zeros((len(joints), len(travel)))
    C.reach_around(chain.record.struct, joints, np.ascontiguousarray(cylinders), np.ascontiguousarray(travel), rho)
    return rho


def local_reach(
    chain: Chain, rho: Array, joints: Rows, centers: Array, radii: Array, axes: Array, origins: Array, half: Array
) -> Array:
    """ρ (k, g, n) on intervals."""
    local = np.zeros((len(centers), *rho.shape))
    given = map(np.ascontiguousarray, (joints, rho, centers, radii, axes, origins, half))
    C.local_reach(chain.record.struct, *given, local)
    return local
