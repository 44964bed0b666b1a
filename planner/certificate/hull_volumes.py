"""Volumes of the hulls of link and obstacle meshes, kept on disk by the meshes' content.

No proof rests on them. They decide whether a mesh is taken as convex, and where it is cut: if one is too small, the
hull, which contains it, takes the place of a mesh that is not convex; if one is too large, a mesh's own triangles stay.
"""

from __future__ import annotations

from hdplan.distance.compiled.cache import content_key, finite, load, store
from hdplan.planner.geometry.meshes import TriangleMesh

VERSION = "1"  # to be changed with anything that changes a hull's volume, so that old entries are not used


def hull_volume(mesh: TriangleMesh) -> float:
    """Return the volume [m³] of a mesh's convex hull, 0 for a flat one: from the cache, or computed now."""
    key = content_key(VERSION, mesh.vertices.tobytes())
    known = load("hull_volumes", key, lambda value: float(finite(float(value))))
    if known is not None:
        return known
    found = mesh.hull_volume
    store("hull_volumes", key, found)
    return found


def is_convex(mesh: TriangleMesh) -> bool:
    """True if a mesh is closed and as large as its convex hull."""
    return mesh.fills(hull_volume(mesh))
