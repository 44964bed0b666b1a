"""The HD-SDF in NumPy, equation by equation: the reference for the tests of the fast versions.

In: two bodies and their poses (world from body). Out: numbers in [m], positive = separated. ``hdsdf`` is a lower bound
of the signed distance in sign, not in value; ``separation`` a lower bound in value; ``separating_axis_distance`` is
exact where the bodies touch or overlap.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.holder import (
    check_gamma,
    holder_maximum,
    holder_minimum,
    minimum_shares,
    resolve_shaping_length,
    shaped_minimum,
    shaping,
)
from hdplan.distance.normals import candidate_normals, check_witnesses, separating_axes
from hdplan.distance.numpy_reference.jets import Jet, fixed, moving, stack
from hdplan.distance.numpy_reference.projections import Along, separations
from hdplan.distance.poses import check_pose, check_poses
from hdplan.distance.unions import Body, pairs_of
from hdplan.scenes.array_types import Array


@dataclass(frozen=True, eq=False)
class Derivatives:
    """D with its derivatives by the twists ξ = [v_a, ω_a, v_b, ω_b], each in the body's own frame: pose·exp(ξ)."""

    value: Array  # (...,) [m]
    gradient: Array  # (..., 12) by translations [-] and rotations [m/rad]
    hessian: Array  # (..., 12, 12) symmetric

    def __repr__(self) -> str:
        """Return the number of poses, or the value of a single one, for display."""
        one = f"D = {self.value:.6g} m" if not self.value.shape else f"{self.value.shape} values"
        return f"<Derivatives: {one}, with gradient and Hessian>"


def hdsdf(
    body_a: Body,
    pose_a: ArrayLike,
    body_b: Body,
    pose_b: ArrayLike,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    epsilon: float | None = None,
    normals: str = "paper",
    witnesses: ArrayLike | None = None,
) -> Array:
    """Return the Hölder differentiable signed distance D of A and B [m].

    D = Phi( ⊞_w Phi( ⊕_ij w·(a_i - b_j) - r_A - r_B - f_w ) )     (paper: Definition III.2)

    with ⊕, ⊞ the Hölder minimum and maximum over the vertices and over the axes w and -w, Phi the shaping function, f_w
    = 0 except for faded axes. A lower bound in sign: D > 0 proves that the bodies are separated. For a clearance see
    ``ConvexBody.inflated``. In floating point this holds up to rounding: a touch may appear as a gap of up to 4 units
    in the last place of the size, that is the bodies' extents and their distance from the origin (the most found was
    2.8).

    Args:
        body_a: a body in its own frame; of unions D is the Hölder minimum over their pieces' pairs (``unions``).
        pose_a: (..., 4, 4) rigid transforms from body to world [m]; leading axes broadcast.
        body_b: the other body, in its own frame.
        pose_b: the other body's transforms.
        gamma: order of differentiability, an integer >= 1.
        shaping_length: half-height of the shaping function [m]; near contact D is flat within it.
        epsilon: the paper's parameter, [m^gamma], instead of the shaping length: epsilon = shaping_length^gamma.
        normals: the name of a set, see ``normals.candidate_normals``.
        witnesses: (..., W, 3) additional axes, fixed in B's frame, of any nonzero length: the normal of the exact
            distance at a pose makes D tight there and smooth around it.

    Returns: (...,).

    Raises InputError, naming the pose, for poses of another shape, not finite or not rigid (to ``poses.RIGID``), and
    for parameters out of range.
    """
    length = resolve_shaping_length(check_gamma(gamma), shaping_length, epsilon)
    values = []
    for a, b in pairs_of(body_a, body_b):
        shaped, counts = [], []
        for along in _separations(a, pose_a, b, pose_b, normals, witnesses):
            shaped.append(shaping(holder_minimum(along.x.value, gamma), gamma, length))
            counts.append(along.count)
        values.append(shaping(holder_maximum(np.stack(shaped, axis=-1), gamma, counts), gamma, length))
    return holder_minimum(np.stack(values, axis=-1), gamma)


def separation(
    body_a: Body,
    pose_a: ArrayLike,
    body_b: Body,
    pose_b: ArrayLike,
    *,
    normals: str = "paper",
    witnesses: ArrayLike | None = None,
) -> Array:
    """Return D̃, the largest gap along the candidate normals [m] (paper: eq. (5)), shape (...,).

    A lower bound of the signed distance for every set of normals, separated and in overlap (proof in ``normals``), up
    to rounding: 4 ulp of the size. It has the sign of D even where D underflows. Continuous in the pose, except for an
    axis across edges that are exactly parallel. Of unions it is the least over the pairs of pieces: the same where they
    are apart, in overlap a lower bound of the least signed distance of a pair (``unions``). Arguments and errors as
    ``hdsdf``.
    """
    rows = (_separations(a, pose_a, b, pose_b, normals, witnesses) for a, b in pairs_of(body_a, body_b))
    return np.asarray(reduce(np.minimum, (reduce(np.maximum, (along.bound for along in row)) for row in rows)))


def hdsdf_derivatives(
    body_a: Body,
    pose_a: ArrayLike,
    body_b: Body,
    pose_b: ArrayLike,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    epsilon: float | None = None,
    normals: str = "paper",
    witnesses: ArrayLike | None = None,
) -> Derivatives:
    """Return D, its gradient and its Hessian by the twists of both bodies, by the chain rule in closed form.

    D is gamma times differentiable, so for gamma >= 2 both exist at every pose, even where vertices or axes tie and
    where the bodies touch (all derivatives are 0 there). For gamma = 1 the Hessian jumps where D is 0 and, in overlap,
    where the separation of a pair of vertices or the minimum along an axis passes 0; it is one of its one-sided values
    there. Arguments and errors as ``hdsdf``.
    """
    length = resolve_shaping_length(check_gamma(gamma), shaping_length, epsilon)
    pairs = []
    for a, b in pairs_of(body_a, body_b):
        shaped, counts = [], []
        for along in _separations(a, pose_a, b, pose_b, normals, witnesses, moved=True):
            shaped.append(_shaped(along.x, gamma, length, None))
            counts.append(along.count)
        # a maximum is a minimum of the opposites
        pairs.append(_shaped(stack(shaped) * -1.0, gamma, length, counts) * -1.0)
    d = _least(pairs, gamma)
    return Derivatives(d.value, d.first, d.second)


def separating_axis_distance(body_a: ConvexBody, pose_a: ArrayLike, body_b: ConvexBody, pose_b: ArrayLike) -> float:
    """Return the separating-axis distance D of A and B at one pose each, (4, 4) [m] (paper: eq. (3)).

    D = max over n in N(A, B) of min n·(a - b) - r_A - r_B. Where the polytopes touch or overlap it is the exact signed
    distance; where they are separated it is a lower bound, positive before the radii are subtracted. pose_a and pose_b
    map body_a and body_b into the world.

    Raises InputError for arguments that are no bodies, and for poses of another shape, not finite or not rigid.
    """
    a, b = check_pose("pose_a", pose_a), check_pose("pose_b", pose_b)
    axes = separating_axes(body_a, a[:3, :3], body_b, b[:3, :3])
    along_a = axes @ (body_a.vertices @ a[:3, :3].T + (a[:3, 3] - b[:3, 3])).T
    along_b = axes @ (body_b.vertices @ b[:3, :3].T).T
    gaps = np.maximum(along_a.min(1) - along_b.max(1), along_b.min(1) - along_a.max(1))
    return float(gaps.max()) - body_a.radius - body_b.radius


def _separations(
    body_a: ConvexBody,
    pose_a: ArrayLike,
    body_b: ConvexBody,
    pose_b: ArrayLike,
    normals: str,
    witnesses: ArrayLike | None,
    moved: bool = False,
) -> Iterator[Along]:
    """Yield the separations along every axis and sign, with derivatives by the twists if ``moved``."""
    a, b = np.broadcast_arrays(check_poses("pose_a", pose_a), check_poses("pose_b", pose_b))
    jets = (moving(a, 0), moving(b, 6)) if moved else (fixed(a), fixed(b))
    axes = candidate_normals(normals, body_a, body_b)
    return separations(axes, body_a, jets[0], body_b, jets[1], check_witnesses(witnesses))


def _least(pairs: list[Jet], gamma: int) -> Jet:
    """Return the Hölder minimum u of the pairs' distances x_k, with its derivatives.

    With the shares s_k of u (they sum to 1), relative slopes l_k = dx_k/x_k and their mean l = Σ s_k l_k, du = u l and

        d²u = u (Σ s_k d²x_k/x_k - c Σ s_k (l_k - l)(l_k - l)ᵀ),    c = p + 1 for u > 0, 1 - p for u < 0.

    Relative slopes are moderate even where x_k is tiny. Where u is 0, all derivatives are (``unions``).
    """
    if len(pairs) == 1:
        return pairs[0]
    x = stack(pairs)
    u, shares = minimum_shares(x.value, gamma)
    over = np.where(shares > 0, shares / np.where(shares > 0, x.value, 1.0), 0.0)
    slope = np.einsum("...k,...kP->...P", over, x.first)
    spread = x.first / np.where(shares > 0, x.value, 1.0)[..., None] - slope[..., None, :]
    bent = np.where(u > 0, gamma + 2, -gamma)[..., None, None]
    curved = np.einsum("...k,...kPQ->...PQ", over, x.second)
    curved = curved - bent * np.einsum("...k,...kP,...kQ->...PQ", shares, spread, spread, optimize=True)
    return Jet(u, u[..., None] * slope, u[..., None, None] * curved)


def _shaped(x: Jet, gamma: int, length: float, counts: list[float] | None) -> Jet:
    """Return Phi of the Hölder minimum of x (..., n), by the chain rule."""
    value, by_x, by_xx = shaped_minimum(x.value, gamma, length, counts)
    return Jet(
        value,
        np.einsum("...i,...iP->...P", by_x, x.first),
        np.einsum("...i,...iPQ->...PQ", by_x, x.second)
        + np.einsum("...iP,...ij,...jQ->...PQ", x.first, by_xx, x.first, optimize=True),
    )
