"""The operators of the HD-SDF in CasADi, with their derivatives written by hand: what kernels are built from.

In: scalars (``ca.SX``). Out: a value and its partial derivatives in closed form, finite wherever they are
evaluated, and finite again when CasADi differentiates them (a branch that is not taken never holds 0/0). All ratios lie
in [0, 1]: nothing overflows for any gamma or scale. Only integer powers, by multiplication, and one root per minimum.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any

import casadi as ca

# A minimum smaller than this is taken as zero: one over its square stays finite. The sign stays safe, as 0 is not free.
TINY = 1e-150

Scalar = float | ca.SX
Expression = Any  # ca.SX or ca.MX, of any shape


def integer_power(base: Expression, exponent: int) -> Expression:
    """Return base^exponent by squaring, exponent >= 1: CasADi's own constant power is a call of ``pow``."""
    if exponent == 1:
        return base
    half = integer_power(base, exponent // 2)
    return half * half * base if exponent % 2 else half * half


def positive_part(x: Expression) -> Expression:
    """Return max(x, 0), exact, without the branch or the call that ``fmax`` may become."""
    return 0.5 * (x + ca.fabs(x))


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
