"""One candidate normal of the HD-SDF in CasADi: the shaped Hölder minimum over two lists of projections.

In, for one axis w: the projections of A's and B's vertices, ``levels`` (equal ones once, with a count) and ``along``,
and the drop r_A + r_B + f. Out, for the axis and for its opposite: g = Phi(⊕_ij x_ij) of x_ij = ±(level_i - along_j) -
drop and its derivatives in the closed form of ``holder.shaped_minimum``. They are returned as moments of the vertices:
whatever the motion, x_ij is linear in ψ_ij = (1, b_j), or (1, b_j, a_i) where both lists move, or two halves, one of
them 0, where b_j belongs to one of two placements. So sums of ψ and of ψψᵀ contain everything about the vertex pairs.

An axis is computed in one of three cases, a real branch of the generated code: SKIPPED, where another axis separates
the bodies and this one does not (it weighs exactly 0 in the maximum); APART, where it separates them, along one of its
signs; CONTACT, where no axis does and both signs count. All ratios lie in [0, 1]: nothing overflows, at any gamma or
scale.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca

Expression = Any  # ca.SX or ca.MX, of any shape

SKIPPED, APART, CONTACT = range(3)

# A minimum smaller than this is taken as zero: one over its square stays finite. The sign stays safe, as 0 is not free.
TINY_NUMBER = 1e-150

# vertex pairs written out as straight-line code; more of them run in loops, which compilers vectorize
UNROLLED_PAIRS = 32


@dataclass(frozen=True)
class AxisShape:
    """Key of an axis function."""

    levels: int  # L
    along: int  # m
    gamma: int
    order: int  # of the derivatives wanted: 0, 1 or 2
    both_move: bool  # whether the levels depend on the pose too; they do not where the axis is fixed in their body
    signs: tuple[int, ...] = (1, -1)  # the axis and its opposite, or one of them
    placements: int = 1  # of the points b_j: each has an equal share of them and a motion of its own

    @property
    def moments(self) -> int:
        """The length of ψ."""
        return 7 if self.both_move else 4 * self.placements


@functools.cache
def axis_function(shape: AxisShape) -> ca.Function:
    """Return the function of one axis.

    Inputs: case; levels (L), their counts (L), along (m), its counts (m); drop; the least x for each of the s signs
    (s); shaping_length [m]; the points b_j (3, m) and, where both move, a_i (3, L).

    Outputs, a column for each sign: g (1, s); from order 1 on slope = dg/du (1, s) and pull = Σ q ψ (n, s), q_ij =
    du/dx_ij; from order 2 on ``outer`` (1, s) and ``sharp`` (n, s n), with which d²g = outer (Σ q dx)(Σ q dx)ᵀ + Σ
    sharp_ij dx dxᵀ + slope Σ q d²x.
    """
    inputs = _inputs(shape, ca.SX)
    skip = ca.Function("skip", inputs, [ca.SX.zeros(*size) for size in _output_sizes(shape)])
    cases = []
    for apart in (True, False):
        inputs = _inputs(shape, ca.SX if shape.levels * shape.along <= UNROLLED_PAIRS else ca.MX)
        cases.append(ca.Function("apart" if apart else "contact", inputs, _outputs(shape, inputs, apart)))
    return ca.Function.conditional("axis", [skip, cases[0]], cases[1])


class Shaped(NamedTuple):
    """g = Phi(u) of a Hölder minimum u, from its extreme and its power sum; the factors that its derivatives share."""

    value: Expression
    slope: Expression  # dg/du
    scale_pull: Expression  # q_i = w_i r_i^(p±1) · this
    outer: Expression  # d²g/dx² = outer q qᵀ + diag(sharp),
    scale_sharp: Expression  # sharp_i = w_i r_i^(p±2) · this


def shaped(extreme: Expression, total: Expression, length: Expression, gamma: int, above: bool | Expression) -> Shaped:
    """Return Phi(u) and its factors for the least value ``extreme`` = m and the sum ``total`` = Σ w r^p.

    ``above``: whether m > 0. See ``holder.shaped_minimum`` for the equations. |m| <= TINY_NUMBER gives 0 throughout.
    """
    p = gamma + 1
    zero = ca.fabs(extreme) <= TINY_NUMBER
    root = _root(total + zero, p)
    inverse = 1 / root
    square = inverse * inverse
    u = extreme * _choose(above, inverse, root) * (1 - zero)
    size = ca.fabs(u)
    above_length = ca.fmax(size, length)
    near, far = ca.fmin(size, length) / length, length / above_length  # one of them is 1
    near_power, far_power = integer_power(near, gamma), integer_power(far, gamma)
    whole = 1 + near_power * far_power
    s, rest = near_power / whole, far_power / whole
    slope = s * (1 + gamma * rest)
    # s/u, which tends to 0 with u: |u|^(gamma-1) / (delta^gamma (1 + t^gamma)), or 1 / (u (1 + t^-gamma))
    lower = integer_power(near, gamma - 1) if gamma > 1 else 1 - zero
    s_by_u = ca.sign(u) * lower / (above_length * whole)
    order = _choose(above, p + 1, 1 - p)
    scale_sharp = integer_power(inverse, p - 2) if p > 2 else 1
    bend = s_by_u * order * (1 + gamma * rest)
    return Shaped(
        u * s,
        slope,
        scale_sharp * inverse * _choose(above, square, 1),
        s_by_u * gamma * rest * (1 + gamma * (rest - s)) + bend,
        -bend * scale_sharp * _choose(above, square * square, 1),
    )


def integer_power(base: Expression, exponent: int) -> Expression:
    """Return base^exponent by squaring, exponent >= 1: CasADi's own constant power is a call of ``pow``."""
    if exponent == 1:
        return base
    half = integer_power(base, exponent // 2)
    return half * half * base if exponent % 2 else half * half


def positive_part(x: Expression) -> Expression:
    """Return max(x, 0), exact, without the branch or the call that ``fmax`` may become."""
    return 0.5 * (x + ca.fabs(x))


def _inputs(shape: AxisShape, kind: Any) -> list[Expression]:
    sizes = {
        "levels": (shape.levels, 1),
        "level_counts": (shape.levels, 1),
        "along": (shape.along, 1),
        "along_counts": (shape.along, 1),
        "drop": (1, 1),
        "least": (len(shape.signs), 1),
        "length": (1, 1),
        "points_b": (3, shape.along),
    }
    if shape.both_move:
        sizes["points_a"] = (3, shape.levels)
    return [kind.sym(name, *size) for name, size in sizes.items()]


def _output_sizes(shape: AxisShape) -> list[tuple[int, int]]:
    n, s = shape.moments, len(shape.signs)
    return [(1, s), (1, s), (n, s), (1, s), (n, s * n)][: (1, 3, 5)[shape.order]]


def _outputs(shape: AxisShape, inputs: list[Expression], apart: bool) -> list[Expression]:
    least = inputs[5]
    if apart and len(shape.signs) == 2:  # one of them separates: compute that alone
        sign, extreme = ca.if_else(least[0] > 0, 1, -1), ca.fmax(least[0], least[1])
        column = _column(shape, inputs, sign, extreme, True)
        columns = [[part * (sign == s) for part in column] for s in shape.signs]
    else:
        columns = [_column(shape, inputs, s, least[k], apart) for k, s in enumerate(shape.signs)]
    return [ca.horzcat(*parts) for parts in zip(*columns, strict=True)]


def _column(
    shape: AxisShape, inputs: list[Expression], sign: Any, extreme: Expression, apart: bool
) -> list[Expression]:
    """Return the outputs for one sign."""
    length = inputs[6]
    # x/m below contact, m/x above: the factor that is the same for all pairs
    if apart:  # always true; stated for graphs that evaluate all cases and choose afterwards
        scale = ca.if_else(extreme > TINY_NUMBER, extreme, 1)
    else:
        scale = ca.if_else(extreme < -TINY_NUMBER, 1 / ca.fmin(extreme, -TINY_NUMBER), 0)
    total, *moments = _sums(shape, inputs, sign, scale, apart)
    g = shaped(extreme, total, length, shape.gamma, apart)
    parts = [g.value]
    if shape.order >= 1:
        parts += [g.slope, g.scale_pull * moments[0]]
    if shape.order == 2:
        parts += [g.outer, g.scale_sharp * moments[1]]
    return parts


def _sums(shape: AxisShape, inputs: list[Expression], sign: Any, scale: Expression, apart: bool) -> list[Expression]:
    """Return Σ w r^p, Σ w r^(p-1) ψ and Σ w r^(p-2) ψψᵀ (p+1 and p+2 where apart) over all pairs of vertices."""
    levels, level_counts, along, along_counts, drop, _, _, points_b, *points_a = inputs
    p = shape.gamma + 1
    x = ca.repmat(sign * levels - drop, 1, along.numel()) - ca.repmat(sign * along.T, levels.numel(), 1)
    if apart:
        r = scale / ca.fmax(x, scale)
        full = integer_power(r, p)
        pull = full * r
        sharp = pull * r
    else:
        r = positive_part(-x) * -scale
        sharp = integer_power(r, p - 2) if p > 2 else r > 0
        pull = sharp * r
        full = pull * r
    results = [level_counts.T @ full @ along_counts]
    for weights, square in ((pull, False), (sharp, True))[: shape.order]:
        weighted = weights * (level_counts @ along_counts.T)
        by_b, by_a = ca.sum1(weighted).T, ca.sum2(weighted)
        psi_b = ca.vertcat(type(by_b).ones(1, by_b.numel()), points_b)
        if shape.placements > 1:
            psi_b = ca.diagcat(*ca.horzsplit(psi_b, shape.along // shape.placements))
        if not square:
            results.append(ca.vertcat(psi_b @ by_b, *(a @ by_a for a in points_a)))
            continue
        block = psi_b @ (ca.repmat(by_b, 1, psi_b.shape[0]) * psi_b.T)
        if points_a:
            (a,) = points_a
            mixed = a @ weighted @ psi_b.T
            block = ca.blockcat([[block, mixed.T], [mixed, a @ (ca.repmat(by_a, 1, 3) * a.T)]])
        results.append(block)
    return results


def _root(x: Expression, p: int) -> Expression:
    """Return x^(1/p), x ≥ 1, without pow where square roots or Halley's method will do: it is a slow call."""
    if p % 2 == 0:
        return ca.sqrt(_root(x, p // 2))
    if p == 3:  # from q (1 + 2 q) / (2 + q), q = x^(1/4): three steps reach rounding
        q = ca.sqrt(ca.sqrt(x))
        y = q * (1 + 2 * q) / (2 + q)
        for _ in range(3):
            cube = y * y * y
            y = y * ((cube + 2 * x) / (2 * cube + x))
        return y
    return x if p == 1 else x ** (1.0 / p)


def _choose(condition: bool | Expression, yes: Any, no: Any) -> Any:
    if isinstance(condition, bool):
        return yes if condition else no
    return ca.if_else(condition, yes, no)
