"""Second derivatives by the joints of what depends on how one body is placed to another.

With the joints' screws S_j in the world, m_j = 1, −1 or 0 as joint j moves the first body alone, the other alone, or
both or neither, and a function whose derivatives with respect to a motion exp(ξ) of the first body are w (6,) and H
(6, 6), as the distance of two bodies or the place of a point:

    ∂/∂q_j = m_j w·S_j        ∂²/∂q_j∂q_k = m_j m_k S_j·H S_k + ½ m_j |m_k| w·[S_j, S_k],   j nearer the base than k

as exp(S_1 δ_1) exp(S_2 δ_2) … moves the body, which to second order is exp(Σ_j S_j δ_j + ½ Σ_{j<k} [S_j, S_k] δ_j δ_k).
"""

from __future__ import annotations

import numpy as np

from hdplan.scenes.array_types import Array


def by_joints(columns: Array, moves: Array, wrench: Array, hessian: Array) -> Array:
    """Return the second derivatives (S, n, n) of S functions: columns (S, n, 6) are the screws as in `KinematicsBatch`,
    moves (S, n) the m_j, wrench (S, 6) and hessian (S, 6, 6) the derivatives by [v, ω] in the world."""
    relative = columns * moves[..., None]
    force, torque = cross_matrices(wrench[:, :3]), cross_matrices(wrench[:, 3:])
    bracket = -np.block([[np.zeros_like(force), force], [force, torque]])  # w·[S, S'] = S·bracket S'
    turned = np.triu(0.5 * relative @ bracket @ (columns * np.abs(moves)[..., None]).swapaxes(1, 2), 1)
    result: Array = relative @ hessian @ relative.swapaxes(1, 2) + turned + turned.swapaxes(1, 2)
    return result


def cross_matrices(vectors: Array) -> Array:
    """The matrices (S, 3, 3) of v × · for vectors (S, 3)."""
    return np.cross(vectors[:, None], np.eye(3)).swapaxes(1, 2)
