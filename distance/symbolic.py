"""The HD-SDF in CasADi, with its derivatives written by hand: building blocks, and the distance of two bodies as a
Function.

In (blocks): scalars (``ca.SX``). Out: a value and its partial derivatives in closed form, finite wherever they are
evaluated, and finite again when CasADi differentiates them (a branch that is not taken never holds 0/0). All ratios lie
in [0, 1]: nothing overflows for any gamma or scale. Only integer powers, by multiplication, and one root per minimum.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.holder import check_gamma, resolve_shaping_length
from hdplan.distance.normals import candidate_normals

# A minimum smaller than this is taken as zero: one over its square stays finite. The sign stays safe, as 0 is not free.
TINY = 1e-150

# Projections this close, relative to the largest, are one projection with a multiplicity.
SAME_PROJECTION = 1e-14

Scalar = float | ca.SX


def integer_power(base: ca.SX, exponent: int) -> ca.SX:
    """Return base^exponent by squaring, exponent >= 0: CasADi's own constant power is a call of ``pow``."""
    if exponent == 0:
        return ca.SX(1)
    if exponent == 1:
        return base
    half = integer_power(base, exponent // 2)
    return half * half * base if exponent % 2 else half * half


def holder_minimum(
    values: list[ca.SX], gamma: int, weights: Sequence[Scalar] | None = None
) -> tuple[ca.SX, list[ca.SX]]:
    """Return the gamma-Hölder minimum u of scalars x_i, x_i counted w_i times, and its derivatives du/dx_i.

    With p = gamma + 1 and m = min_i x_i (paper: Lemma ``lemma:aczel``), scaled by the extreme:

        m > 0:  u = m / S^(1/p),  S = sum_i w_i r_i^p,  r_i = m / x_i,            du/dx_i = w_i (r_i / S^(1/p))^(p+1)
        m < 0:  u = m S^(1/p),    S = sum_i w_i r_i^p,  r_i = min(x_i, 0) / m,    du/dx_i = w_i (r_i / S^(1/p))^(p-1)
        m = 0:  u = 0, and 0 for the derivatives, which have no limit there (shaping multiplies them by 0).

    Both branches are one expression: only numerator and denominator of r_i and the outermost factor are chosen.
    """
    p = gamma + 1
    weight = [1.0] * len(values) if weights is None else weights
    m = reduce(ca.fmin, values)
    positive, zero = m > TINY, ca.fabs(m) <= TINY
    above = ca.if_else(positive, m, 0)
    denominator = ca.if_else(positive, 0, ca.if_else(zero, 1, m))
    signed = ca.if_else(zero, 0, 1)
    ratios = [signed * (above + ca.fmin(x, 0)) / (ca.if_else(positive, x, 0) + denominator) for x in values]
    total = sum((w * integer_power(r, p) for w, r in zip(weight, ratios, strict=True)), ca.SX(0))
    root = (total + zero) ** (1.0 / p)
    inverse = 1 / root
    u = signed * m * ca.if_else(positive, inverse, root)
    derivatives = []
    for w, r in zip(weight, ratios, strict=True):
        q = r * inverse
        derivatives.append(w * integer_power(q, p - 1) * ca.if_else(positive, q * q, 1))
    return u, derivatives


def holder_maximum(
    values: list[ca.SX], gamma: int, weights: Sequence[Scalar] | None = None
) -> tuple[ca.SX, list[ca.SX]]:
    """Return the gamma-Hölder maximum, -min(-x) (paper: Definition ``def:smooth-max-boxplus``), and its derivatives."""
    u, derivatives = holder_minimum([-x for x in values], gamma, weights)
    return -u, derivatives


def shaping(u: ca.SX, gamma: int, shaping_length: Scalar) -> tuple[ca.SX, ca.SX]:
    """Return Phi(u) = u t^gamma / (t^gamma + 1) with t = |u| / shaping_length, and dPhi/du (paper: eq. ``eq:phi``).

    epsilon = shaping_length^gamma. With s = t^gamma / (t^gamma + 1): Phi = u s and dPhi/du = s (1 + gamma (1 - s)); the
    power is that of min(t, 1/t), which never overflows.
    """
    size = ca.fabs(u)
    power = integer_power(ca.fmin(size, shaping_length) / ca.fmax(size, shaping_length), gamma)
    far = size > shaping_length
    s = ca.if_else(far, 1, power) / (1 + power)
    rest = ca.if_else(far, power, 1) / (1 + power)
    return u * s, s * (1 + gamma * rest)


def hdsdf_function(
    body_a: ConvexBody,
    body_b: ConvexBody,
    *,
    gamma: int = 2,
    shaping_length: float = 1e-3,
    epsilon: float | None = None,
    normals: str = "paper",
) -> ca.Function:
    """Return D of ``reference.hdsdf`` as a CasADi Function ``(pose_a (4,4), pose_b (4,4)) -> distance`` [m].

    A lower bound of the signed distance in sign (paper: Definition ``def:set2set-signed-distance``). Usable in any SX
    or MX graph. Its Jacobian is the chain of the blocks' derivatives in closed form, not an automatic derivative;
    second derivatives come by differentiating that chain. The poses must be rigid (R'R = 1 is used), and derivatives
    mean something along rigid motions only: compose the Function with a kinematics or another parametrization of the
    pose.

    Exact reductions: a body's projections on its own directions are constants, equal ones enter once with their
    multiplicity, and n and -n share the differences.

    Arguments and errors as ``reference.hdsdf``.
    """
    length = resolve_shaping_length(check_gamma(gamma), shaping_length, epsilon)
    radii = body_a.radius + body_b.radius
    pose_a, pose_b = ca.SX.sym("pose_a", 4, 4), ca.SX.sym("pose_b", 4, 4)
    views = _seen_from(pose_a, pose_b, body_b), _seen_from(pose_b, pose_a, body_a)
    shaped: list[ca.SX] = []  # one per normal n and -n
    chains: list[list[tuple[NDArray[np.float64], list[ca.SX]]]] = []  # per side: n, d shaped / d (n · vertex seen)
    for own, directions, seen in zip((body_a, body_b), candidate_normals(normals, body_a, body_b), views, strict=True):
        chains.append([])
        for direction in directions:
            constants, counts = _distinct(own.vertices @ direction)
            along = ca.vertsplit(seen.T @ direction)
            differences = [c - x for c in constants for x in along]
            weights = [w for w in counts for _ in along]
            for sign in (1.0, -1.0):
                inner, partials = holder_minimum([sign * d - radii for d in differences], gamma, weights)
                value, slope = shaping(inner, gamma, length)
                shaped.append(value)
                sums = [sum(partials[j :: len(along)], ca.SX(0)) for j in range(len(along))]
                chains[-1].append((direction, [-sign * slope * s for s in sums]))
    outer, shares = holder_maximum(shaped, gamma)
    distance, slope = shaping(outer, gamma, length)

    gradient = ca.SX.zeros(1, 32)
    share = iter(shares)
    for seen, chain in zip(views, chains, strict=True):
        pull = ca.SX.zeros(*seen.shape)  # d distance / d vertices seen
        for direction, derivatives in chain:
            pull += direction @ (slope * next(share) * ca.horzcat(*derivatives))
        gradient += ca.jtimes(ca.vec(seen), ca.veccat(pose_a, pose_b), ca.vec(pull), True).T
    jacobian = ca.Function("jac_hdsdf", [pose_a, pose_b, ca.SX.sym("distance")], ca.horzsplit(gradient, 16))
    # CasADi takes the custom Jacobian only where it cannot inline the Function and has no derivative of its own.
    options: dict[str, Any] = {
        "custom_jacobian": jacobian,
        "jac_penalty": 0,
        "never_inline": True,
        "enable_forward": False,
        "enable_reverse": False,
    }
    return ca.Function("hdsdf", [pose_a, pose_b], [distance], ["pose_a", "pose_b"], ["distance"], options)


def _seen_from(pose: ca.SX, other_pose: ca.SX, other: ConvexBody) -> ca.SX:
    """Return the vertices of ``other`` (3, m) in the frame of ``pose``; the positions are subtracted first."""
    offset = other_pose[:3, 3] - pose[:3, 3]
    return pose[:3, :3].T @ (other_pose[:3, :3] @ other.vertices.T + ca.repmat(offset, 1, len(other.vertices)))


def _distinct(values: NDArray[np.float64]) -> tuple[list[float], list[float]]:
    """Return the distinct numbers among ``values``, to rounding, and how often each occurs."""
    ordered = np.sort(values)
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > SAME_PROJECTION * np.abs(ordered).max())
    groups = np.split(ordered, starts[1:])
    return [float(g.mean()) for g in groups], [float(len(g)) for g in groups]
