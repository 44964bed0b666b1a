"""Split one mesh into convex pieces with coacd: a program of its own, so that it can be aborted.

coacd cannot be interrupted, takes minutes or all memory for some damaged meshes, and may crash its process.
Arguments: file of the mesh (.npz: vertices (m, 3), triangles (F, 3)), file to write (.npz: a point set for each piece),
concavity, processor time [s] and memory [bytes] that it may take.
"""

from __future__ import annotations

import sys

import coacd
import numpy as np


def main(mesh: str, result: str, concavity: str, seconds: str, memory: str) -> None:
    """Split a mesh as the arguments say."""
    if sys.platform != "win32":  # which has no such limits
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))
        resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    coacd.set_log_level("error")
    with np.load(mesh) as stored:
        pieces = coacd.run_coacd(
            coacd.Mesh(stored["vertices"], stored["triangles"]), threshold=float(concavity), seed=0
        )
    np.savez(result, *(vertices for vertices, _ in pieces))


if __name__ == "__main__":
    main(*sys.argv[1:])
