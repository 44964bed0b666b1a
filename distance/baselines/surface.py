"""The surface of a polytope as triangles, for libraries that need them.

In: a body. Out: triples of indices of its vertices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.bodies import ConvexBody
from hdplan.scenes.lazy_imports import scipy


def triangles(body: ConvexBody) -> NDArray[np.intp]:
    """Return triangles (T, 3) of the polytope, counterclockwise seen from outside, as indices of its vertices.

    A flat polygon has both its sides; a segment and a point have one triangle without area.
    """
    corners = body.vertices
    if len(body.faces) <= 2:
        last = len(corners) - 1
        fan = np.array([(0, min(k, last), min(k + 1, last)) for k in range(1, max(2, last))])
        return np.vstack([fan, fan[:, ::-1]]) if len(body.faces) else fan
    # An affine map keeps the hull's triangles, and this one makes needles round.
    found = scipy.spatial.ConvexHull(np.linalg.svd(corners - corners.mean(0), full_matrices=False)[0]).simplices
    a, b, c = (corners[found[:, k]] - corners.mean(0) for k in range(3))
    inward = np.sum(np.cross(b - a, c - a) * a, axis=1) < 0
    return np.asarray(np.where(inward[:, None], found[:, ::-1], found), dtype=np.intp)
