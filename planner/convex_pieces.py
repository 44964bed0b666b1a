"""A mesh that is not convex, taken apart into convex pieces for the planner.

The pieces follow the mesh closely but not exactly: they are for the planner alone, the certificate works with the
triangles themselves. Taking apart takes seconds, so the pieces are kept on disk by the mesh's content.
"""

from __future__ import annotations

import threading
from importlib.metadata import version

import coacd
import numpy as np
from numpy.typing import NDArray

from hdplan.distance.cache import content_key, load, store
from hdplan.planner.meshes import TriangleMesh

Floats = NDArray[np.float64]

CONCAVITY = 0.03  # how deep a dent a convex piece may bridge, as part of the mesh's size (coacd's threshold)

_cutting = threading.Lock()  # coacd has one random generator for the whole process


def convex_pieces(mesh: TriangleMesh) -> tuple[Floats, ...]:
    """Return point sets (m, 3) whose convex hulls together stand for `mesh`: exactly, if its loose parts are convex."""
    parts = mesh.components()
    if all(part.convex and part.volume > 0 for part in parts):
        return tuple(part.vertices for part in parts)
    key = content_key(str(CONCAVITY), version("coacd"), mesh.vertices.tobytes(), mesh.triangles.tobytes())
    with _cutting:
        known = load("convex_pieces", key)
        if known is None:
            coacd.set_log_level("error")
            pieces = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.triangles), threshold=CONCAVITY, seed=0)
            known = [vertices.tolist() for vertices, _ in pieces]
            store("convex_pieces", key, known)
    return tuple(np.array(vertices) for vertices in known)
