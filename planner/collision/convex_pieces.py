"""A nonconvex mesh, split into convex pieces for the planner.

The pieces follow the mesh closely but not exactly: only the planner uses them, the certificate works with the triangles
themselves. Splitting takes seconds, so the pieces are cached on disk by the mesh's content. It runs in a process of its
own, bounded in time and memory.
"""

from __future__ import annotations

import functools
import math
import os
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path

import numpy as np

from hdplan.distance.compiled.cache import content_key, finite, load, store
from hdplan.planner.geometry.meshes import TriangleMesh
from hdplan.scenes.array_types import Array

CONCAVITY = 0.03  # how deep a dent a convex piece may bridge, as part of the mesh's size (coacd's threshold)
MOST_SECONDS = 15.0  # that splitting may take: what takes longer has many pieces, and boxes around it do as well
MOST_MEMORY = 8 * 2**30  # [bytes] of address space: several times what is used


def convex_pieces(mesh: TriangleMesh, seconds: float = MOST_SECONDS) -> tuple[Array, ...] | None:
    """Return point sets (m, 3) whose convex hulls together represent `mesh`: exactly, if its connected parts are
    convex.

    None where it cannot be split, or not within `seconds`; that MOST_SECONDS were not enough is kept as well.
    """
    if (parts := _convex_parts(mesh.vertices.tobytes(), mesh.triangles.tobytes())) is not None:
        return parts
    key = content_key(str(CONCAVITY), version("coacd"), mesh.vertices.tobytes(), mesh.triangles.tobytes())
    pieces = load("convex_pieces", key, lambda value: [finite(piece).reshape(-1, 3) for piece in value])
    if pieces is None:
        pieces = _taken_apart(mesh, min(seconds, MOST_SECONDS))
        if pieces or seconds >= MOST_SECONDS > 0.0:
            store("convex_pieces", key, [vertices.tolist() for vertices in pieces])
    return tuple(pieces) or None


@functools.lru_cache(maxsize=32)
def _convex_parts(vertices: bytes, triangles: bytes) -> tuple[Array, ...] | None:
    """The vertices of each connected part of a mesh, given as bytes; None where one is not convex."""
    mesh = TriangleMesh(np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(triangles, np.int64).reshape(-1, 3))
    parts = mesh.components()
    return tuple(part.vertices for part in parts) if all(part.convex and part.volume > 0 for part in parts) else None


def _taken_apart(mesh: TriangleMesh, seconds: float) -> list[Array]:
    """Run coacd on a mesh; empty where it fails."""
    if seconds <= 0.0:
        return []
    with tempfile.TemporaryDirectory() as folder:
        given, result = Path(folder) / "mesh.npz", Path(folder) / "pieces.npz"
        np.savez(given, vertices=mesh.vertices, triangles=mesh.triangles)
        processor = math.ceil(seconds * (os.cpu_count() or 1)) + 1
        arguments = [str(given), str(result), str(CONCAVITY), str(processor), str(MOST_MEMORY)]
        try:
            subprocess.run(
                [sys.executable, "-P", str(Path(__file__).with_name("convex_task.py")), *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=seconds,
                check=True,
            )
            with np.load(result) as pieces:
                return [np.asarray(pieces[name], dtype=np.float64) for name in pieces.files]
        except (OSError, ValueError, subprocess.SubprocessError):
            return []
