"""The HD-SDF in NumPy, equation by equation: the witness that the fast versions are held against.

In: two bodies and their poses (world from body). Out: numbers in [m], positive = separated. ``hdsdf`` is a lower bound
of the signed distance in sign, not in value; ``separating_axis_distance`` is exact where the bodies touch or overlap.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.holder import check_gamma, holder_maximum, holder_minimum, resolve_shaping_length, shaping
from hdplan.distance.normals import candidate_normals, separating_axes
from hdplan.scenes.errors import InputError

Array = NDArray[np.float64]


def hdsdf(
    body_a: ConvexBody,
    pose_a: ArrayLike,
    body_b: ConvexBody,
    pose_b: ArrayLike,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    epsilon: float | None = None,
    normals: str = "paper",
) -> Array:
    """Return the Hölder differentiable signed distance D of A and B [m].

    D = Phi( ⊞_n Phi( ⊕_ij n·(a_i - b_j) - r_A - r_B ) )     (paper: Definition ``def:set2set-signed-distance``)

    with ⊕, ⊞ the Hölder minimum and maximum over the vertices and over the normals n and -n, Phi the shaping function.
    A lower bound in sign: D > 0 proves that the bodies are apart. A clearance is asked for by ``ConvexBody.inflated``.

    Args:
        body_a, body_b: the bodies, each in its own frame.
        pose_a, pose_b: (..., 4, 4) rigid transforms from body to world [m]; leading axes broadcast.
        gamma: order of differentiability, an integer >= 1.
        shaping_length: half-height of the shaping function [m]; near contact D is flat within it.
        epsilon: the paper's parameter, [m^gamma], instead of the shaping length: epsilon = shaping_length^gamma.
        normals: the name of a set in ``normals.NORMALS``.

    Returns: (...,).

    Raises InputError for poses of another shape or not finite, and for parameters out of range.
    """
    length = resolve_shaping_length(check_gamma(gamma), shaping_length, epsilon)
    fixed_in_a, fixed_in_b = candidate_normals(normals, body_a, body_b)
    rotation_a, rotation_b, offset = _relative(pose_a, pose_b)
    vertices_a = np.einsum("...xy,iy->...ix", rotation_a, body_a.vertices) + offset[..., None, :]
    vertices_b = np.einsum("...xy,iy->...ix", rotation_b, body_b.vertices)
    vertex_pairs = len(body_a.vertices) * len(body_b.vertices)
    shaped = []
    for rotation, directions in ((rotation_a, fixed_in_a), (rotation_b, fixed_in_b)):
        for direction in np.vstack([directions, -directions]):
            n = rotation @ direction
            along_a = np.einsum("...ix,...x->...i", vertices_a, n)
            along_b = np.einsum("...ix,...x->...i", vertices_b, n)
            separations = along_a[..., :, None] - along_b[..., None, :] - body_a.radius - body_b.radius
            inner = holder_minimum(separations.reshape(*offset.shape[:-1], vertex_pairs), gamma)
            shaped.append(shaping(inner, gamma, length))
    return shaping(holder_maximum(np.stack(shaped, axis=-1), gamma), gamma, length)


def separating_axis_distance(body_a: ConvexBody, pose_a: ArrayLike, body_b: ConvexBody, pose_b: ArrayLike) -> float:
    """Return the separating-axis distance D of A and B at one pose each, (4, 4) [m] (paper: eq. ``eq:Dfinal``).

    D = max over n in N(A, B) of min n·(a - b) - r_A - r_B. Where the polytopes touch or overlap it is the exact signed
    distance; where they are apart a lower bound of it, positive before the radii are taken off.
    """
    rotation_a, rotation_b, offset = _relative(pose_a, pose_b)
    axes = separating_axes(body_a, rotation_a, body_b, rotation_b)
    along_a = axes @ (body_a.vertices @ rotation_a.T + offset).T
    along_b = axes @ (body_b.vertices @ rotation_b.T).T
    gaps = np.maximum(along_a.min(1) - along_b.max(1), along_b.min(1) - along_a.max(1))
    return float(gaps.max()) - body_a.radius - body_b.radius


def _relative(pose_a: ArrayLike, pose_b: ArrayLike) -> tuple[Array, Array, Array]:
    """Return both rotations (..., 3, 3) and the position of A's origin from B's (..., 3), in the world's axes."""
    poses = []
    for name, pose in (("pose_a", pose_a), ("pose_b", pose_b)):
        matrix = np.asarray(pose, dtype=float)
        if matrix.shape[-2:] != (4, 4) or not np.all(np.isfinite(matrix)):
            raise InputError(f"{name}: found an array of shape {matrix.shape}, allowed are finite arrays (..., 4, 4)")
        poses.append(matrix)
    a, b = np.broadcast_arrays(*poses)
    return a[..., :3, :3], b[..., :3, :3], a[..., :3, 3] - b[..., :3, 3]
