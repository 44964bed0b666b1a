"""Every configuration of six turning joints that places a link, in one loop of C."""

from __future__ import annotations

import numpy as np

from hdplan.distance.compiled.loops import C, Record
from hdplan.scenes.array_types import Array

MOST_CONFIGURATIONS = 16  # configurations that six turning joints have at most


def branches(chain: Record, wanted: Array, held: Array, seed: Array) -> Array:
    """Return the configurations (K, n) of a chain that place its link at `wanted` (12,), with the joints that are not
    solved at each row of `held` (B, n − 6), each joint as near to `seed` (n,) as whole turns within its limits let it.
    Each places the link to 1e-10 m and rad, by the product of its motions."""
    found, counts = np.empty((MOST_CONFIGURATIONS * len(held), len(seed))), np.empty(len(held), np.int64)
    C.branches(chain.struct, wanted, np.ascontiguousarray(held), np.ascontiguousarray(seed), found, counts)
    return found[: int(counts.sum())]
