"""Candidate normals: along which directions a pair of bodies is compared.

Every unit vector is sign-safe (min over the Minkowski difference of n·c is a lower bound of the signed distance), so a
set only decides how tight the distance is. ``NORMALS`` is the table of sets that vary smoothly with the pose, by name:
the HD-SDF takes one of them. ``separating_axes`` is the exact but discontinuous set of the separating axis theorem.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.bodies import ConvexBody, unique_directions
from hdplan.scenes.errors import InputError, nearest

Array = NDArray[np.float64]

PARALLEL = 1e-14  # sine of the angle between two edges below which their cross product is left out


def own_directions(body: ConvexBody) -> Array:
    """Return F(A) ∪ E(A) in the body's frame (K, 3), equal up to sign counted once (paper: eq. ``eq:Ntilde``, one
    body).

    A point has no face and no edge, and a segment only itself: the paper's set would be empty for two spheres, and
    blind to two capsules side by side. Such a body counts as the limit of a thin box: its directions are completed to
    an orthonormal frame, fixed in the body (so D stays smooth in the pose, and a sphere's orientation matters a
    little).
    """
    directions = unique_directions(np.vstack([body.faces, body.edges]))
    if len(directions) >= 2:
        return directions
    frame = np.linalg.qr(np.vstack([directions, np.eye(3)]).T)[0].T  # rows; the first is the body's own direction
    return np.vstack([directions, frame[len(directions) :]])


def paper_normals(body_a: ConvexBody, body_b: ConvexBody) -> tuple[Array, Array]:
    """Return the paper's set Ñ up to sign, as directions fixed in A (K_a, 3) and in B (K_b, 3); -n goes with every n.

    Equal directions count once per body; A's and B's copies are both kept, also where they happen to align: merging
    them would make D jump. Sign-safe, radii included: for unit n, min over the swept bodies of n·(a - b) is the one
    over the vertices minus both radii, and never above the signed distance.
    """
    return own_directions(body_a), own_directions(body_b)


NORMALS: dict[str, Callable[[ConvexBody, ConvexBody], tuple[Array, Array]]] = {"paper": paper_normals}


def candidate_normals(name: str, body_a: ConvexBody, body_b: ConvexBody) -> tuple[Array, Array]:
    """Return the set ``name`` of ``NORMALS`` for this pair, up to sign: fixed in A (K_a, 3) and in B (K_b, 3).

    Raises InputError for an unknown name.
    """
    if name not in NORMALS:
        raise InputError(f"normals: unknown set '{name}'{nearest(name, NORMALS)}")
    return NORMALS[name](body_a, body_b)


def separating_axes(body_a: ConvexBody, rotation_a: Array, body_b: ConvexBody, rotation_b: Array) -> Array:
    """Return N(A, B) up to sign, unit vectors (K, 3) in the world (paper: Definition ``def:normal-set``).

    Faces of both bodies and the cross products of their edges; those of parallel edges do not exist. Where A - B is
    flat (two segments, coplanar polygons) the normals of its plane or line belong to it as well.
    """
    edges_a, edges_b = body_a.edges @ rotation_a.T, body_b.edges @ rotation_b.T
    crosses = np.cross(edges_a[:, None], edges_b[None]).reshape(-1, 3)
    sines = np.linalg.norm(crosses, axis=1)
    crosses = crosses[sines > PARALLEL] / sines[sines > PARALLEL, None]
    span = np.vstack([edges_a, edges_b, np.zeros((3, 3))])
    _, extents, axes = np.linalg.svd(span)
    return np.vstack([body_a.faces @ rotation_a.T, body_b.faces @ rotation_b.T, crosses, axes[extents <= PARALLEL]])
