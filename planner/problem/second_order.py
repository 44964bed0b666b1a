"""Second derivatives by the joints of what depends on how one body is placed to another.

With the joints' screws S_j in the world, m_j = 1, −1 or 0 as joint j moves the first body alone, the other alone, or
both or neither, and a function whose derivatives with respect to a motion exp(ξ) of the first body are w (6,) and H
(6, 6), as the distance of two bodies or the place of a point:

    ∂/∂q_j = m_j w·S_j        ∂²/∂q_j∂q_k = m_j m_k S_j·H S_k + ½ m_j |m_k| w·[S_j, S_k],   j nearer the base than k

as exp(S_1 δ_1) exp(S_2 δ_2) … moves the body, which to second order is exp(Σ_j S_j δ_j + ½ Σ_{j<k} [S_j, S_k] δ_j δ_k).
"""

from __future__ import annotations

import numpy as np

from hdplan.scenes.array_types import Array, Mask


def by_joints(columns: Array, moves: Array | Mask, wrench: Array, hessian: Array) -> Array:
    """Return the second derivatives (S, n, n) of S functions: columns (S, n, 6) are the screws as in `KinematicsBatch`,
    moves (S, n) or (n,) the m_j, wrench (S, 6) and hessian (S, 6, 6) the derivatives by [v, ω] in the world."""
    relative = columns * moves[..., None]
    force, torque = cross_matrices(wrench[:, :3]), cross_matrices(wrench[:, 3:])
    bracket = -np.block([[np.zeros_like(force), force], [force, torque]])  # w·[S, S'] = S·bracket S'
    turned = np.triu(0.5 * relative @ bracket @ (columns * np.abs(moves)[..., None]).swapaxes(1, 2), 1)
    result: Array = relative @ hessian @ relative.swapaxes(1, 2) + turned + turned.swapaxes(1, 2)
    return result


def point_along(place: Array, axis: Array) -> tuple[Array, Array]:
    """Return the first (S, 6) and second (S, 6, 6) derivatives of axis·p by a motion of points p at `place` (S, 3) in
    the world, for axes (S, 3)."""
    between = 0.5 * cross_matrices(axis)
    turning = 0.5 * (outer(place, axis) + outer(axis, place))
    turning -= np.einsum("si,si->s", place, axis)[:, None, None] * np.eye(3)
    return (
        np.hstack([axis, np.cross(place, axis)]),
        np.block([[np.zeros_like(between), between], [-between, turning]]),
    )


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices (S, 3, 3) of v × · for vectors (S, 3)."""
    return np.cross(vectors[:, None], np.eye(3)).swapaxes(1, 2)


def outer(a: Array, b: Array) -> Array:
    """Return the matrices a bᵀ (S, 3, 3) of vectors (S, 3)."""
    result: Array = a[:, :, None] * b[:, None]
    return result
