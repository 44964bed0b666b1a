"""The HD-SDF of unions of convex bodies in CasADi: the Hölder minimum over the pairs of pieces, in closed form.

All pieces of a union move as one body, so that every pair sees the same relative pose, and its derivatives are by the
same motion. What ⊕ needs no shaping for, and why its sign is safe: ``hdplan.distance.unions``.
"""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca

from hdplan.distance.symbolic.one_axis import integer_power
from hdplan.distance.symbolic.polytopes import relative_function
from hdplan.distance.unions import Body, pairs_of

SMALLEST_NORMAL = 2.2250738585072014e-308  # [m] below, a number has not all of its digits, and is taken as 0


def union_function(body_a: Body, body_b: Body, gamma: int, normals: str, witness_count: int, order: int) -> ca.Function:
    """Return the function of ``polytopes.relative_function`` for unions of bodies; of two convex ones it is that."""
    pairs = [relative_function(a, b, gamma, normals, witness_count, order) for a, b in pairs_of(body_a, body_b)]
    alone = pairs[0]
    if len(pairs) == 1:
        return alone
    inputs = [ca.MX.sym(alone.name_in(k), *alone.size_in(k)) for k in range(alone.n_in())]
    found = [pair.call(inputs) for pair in pairs]
    x, separations, *derivatives = [
        ca.horzcat(*(ca.vec(ca.densify(part)) for part in parts)) for parts in zip(*found, strict=True)
    ]  # a column for each pair
    least, over, weights, scale = _shares(len(pairs), gamma)(x)
    results = [least, ca.mmin(separations)]
    if order >= 1:
        mean = derivatives[0] @ over.T
        results.append(least * mean)
    if order == 2:
        spread = derivatives[0] * ca.repmat(scale, 6, 1) - ca.repmat(mean, 1, len(pairs))
        curved = ca.reshape(derivatives[1] @ over.T, 6, 6)
        results.append(least * (curved + spread * ca.repmat(weights, 6, 1) @ spread.T))
    return ca.Function("union", inputs, results, alone.name_in(), alone.name_out())


@functools.cache
def _shares(count: int, gamma: int) -> ca.Function:
    """Return what the Hölder minimum u of x (1, n) and its derivatives take of x, a row each.

    Outputs: u; over, with du/u = Σ over_k dx_k; weights and scale, with which d²u/u = Σ over_k d²x_k + Σ weights_k d_k
    d_kᵀ, d_k = scale_k dx_k - du/u. The shares, which sum to 1, are (u/x_k)^p above 0, below it (x_k/u)^p of x_k < 0.
    """
    p = gamma + 1
    x = ca.SX.sym("x", 1, count)
    m = ca.mmin(x)
    above, below = m > SMALLEST_NORMAL, m < -SMALLEST_NORMAL
    counted = ca.if_else(above, 1, below * (x < -SMALLEST_NORMAL))  # (1, n)
    scale = ca.if_else(counted, 1 / ca.if_else(counted, x, 1), 0)
    ratio = counted * ca.if_else(above, m * scale, x / ca.if_else(below, m, 1))  # in [0, 1]
    power = integer_power(ratio, p)
    total: Any = ca.sum2(power)
    root = ca.if_else(total > 0, total, 1) ** (1 / p)
    u = ca.if_else(above, m / root, below * m * root)
    share = power / ca.if_else(total > 0, total, 1)
    weights = ca.if_else(above, -(p + 1), p - 1) * share
    return ca.Function("shares", [x], [u, share * scale, weights, scale])
