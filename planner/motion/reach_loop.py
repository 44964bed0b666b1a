"""The reach ρ of many bodies in loops of C: `Chain.reach_around` and `Chain.local_reach`, equal but for rounding."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.scenes.array_types import Array, Rows


def reach_around(loops: ModuleType, chain: Record, joints: Rows, cylinders: Array, travel: Array) -> Array:
    """Return the result of `Chain.reach_around`."""
    rho = np.zeros((len(joints), len(travel)))
    loops.reach_around(chain.struct, joints, np.ascontiguousarray(cylinders), np.ascontiguousarray(travel), rho)
    return rho


def local_reach(loops: ModuleType, chain: Record, joints: Rows, rho: Array, at: tuple[Array, ...]) -> Array:
    """Return the value of `Chain.local_reach`; `at` holds its centers, radii, axes, origins and half."""
    local = np.zeros((len(at[0]), *rho.shape))
    given = map(np.ascontiguousarray, (joints, rho, *at))
    loops.local_reach(chain.struct, *given, local)
    return local
