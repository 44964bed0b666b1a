"""A mesh that is not convex, taken apart into convex pieces for the planner.

The pieces follow the mesh closely but not exactly: they are for the planner alone, the certificate works with the
triangles themselves. Taking apart takes seconds, so the pieces are kept on disk by the mesh's content.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.cache import content_key, load, store
from hdplan.planner.meshes import TriangleMesh
from hdplan.scenes.deadline import check_time, most_seconds
from hdplan.scenes.errors import InputError

Floats = NDArray[np.float64]

CONCAVITY = 0.03  # how deep a dent a convex piece may bridge, as part of the mesh's size (coacd's threshold)

LONGEST = 300.0  # [s] for one mesh
# coacd cannot be asked to stop, and a mesh with faults may take it for ever or end it with the process around it.
CHILD = """
import sys, json, coacd, numpy
coacd.set_log_level("error")
job = json.load(sys.stdin)
mesh = coacd.Mesh(numpy.array(job["vertices"]), numpy.array(job["triangles"]))
pieces = coacd.run_coacd(mesh, threshold=job["threshold"], seed=0)
json.dump([vertices.tolist() for vertices, _ in pieces], open(sys.argv[1], "w"))
"""

_cutting = threading.Lock()  # the same mesh is cut once


def convex_pieces(mesh: TriangleMesh) -> tuple[Floats, ...]:
    """Return point sets (m, 3) whose convex hulls together stand for `mesh`: exactly, if its loose parts are convex."""
    parts = mesh.components()
    if all(part.convex and part.volume > 0 for part in parts):
        return tuple(part.vertices for part in parts)
    key = content_key(str(CONCAVITY), version("coacd"), mesh.vertices.tobytes(), mesh.triangles.tobytes())
    with _cutting:
        known = load("convex_pieces", key)
        if known is None:
            known = _cut(mesh)
            store("convex_pieces", key, known)
    return tuple(np.array(vertices) for vertices in known)


def _cut(mesh: TriangleMesh) -> list[list[list[float]]]:
    """Let coacd take a mesh apart, in a process of its own. Raises InputError where it fails or takes too long."""
    job = {"vertices": mesh.vertices.tolist(), "triangles": mesh.triangles.tolist(), "threshold": CONCAVITY}
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "pieces.json"
        command = [sys.executable, "-P", "-c", CHILD, str(answer)]
        try:
            done = subprocess.run(
                command, input=json.dumps(job), capture_output=True, text=True, timeout=most_seconds(LONGEST)
            )
        except subprocess.TimeoutExpired:
            check_time("cutting a mesh into convex pieces")
            raise InputError(f"mesh: cannot be cut into convex pieces within {LONGEST:g} s") from None
        if done.returncode or not answer.is_file():
            raise InputError("mesh: cannot be cut into convex pieces; is it closed, and does it not cross itself?")
        pieces: list[list[list[float]]] = json.loads(answer.read_text())
        return pieces
