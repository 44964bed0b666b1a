"""All axes of a pair in CasADi: from their projections to D, D̃ and the derivatives by a motion.

The outer level of the HD-SDF: the shaped Hölder maximum over groups of similar axes, each a mapped function. Everything
is in A's frame, and the motion is that of B in it. What an axis contributes to D̃: see ``normals.py``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from hdplan.distance.symbolic.axis_wrenches import Motion, wrench_function
from hdplan.distance.symbolic.one_axis import (
    APART,
    CONTACT,
    SKIPPED,
    TINY_NUMBER,
    AxisShape,
    axis_function,
    integer_power,
    positive_part,
    shaped,
)
from hdplan.scenes.array_types import Array


@dataclass(frozen=True, eq=False)
class Axes:
    """K axes of one kind and of equal numbers of projections."""

    motion: Motion
    parameters: list[ca.MX]  # of the motion, (·, K) each
    levels: ca.MX  # (L, K)
    level_counts: ca.MX  # (L, K)
    along: ca.MX  # (m, K)
    along_counts: ca.MX  # (m, K)
    drop: ca.MX  # (1, K)
    counts: Array  # (K,) how often each axis counts in the maximum
    points_b: ca.MX  # (3, m K) in A's frame; A's vertices where the axes are fixed in B
    points_a: ca.MX | None = None  # (3, L K) where both lists of projections move
    signs: tuple[int, ...] = (1, -1)  # the axes and their opposites, or one of them
    placements: int = 1  # of B's points: each has an equal share of them and its own motion
    squares: ca.MX | None = None  # (1, K) |w|², of axes that are not unit vectors
    least: ca.MX = field(init=False)  # (s, K) the least separation along the axis, for each sign
    bounds: ca.MX = field(init=False)  # (s, K) the axis' lower bound of the signed distance

    def __post_init__(self) -> None:
        """Find the least separations."""
        low_a, high_a = _spans(self.levels)
        low_b, high_b = _spans(self.along)
        # rounded as in the axis function: the least x must be one of them exactly
        gaps = {1: (low_a - self.drop) - high_b, -1: (-high_a - self.drop) + low_b}
        least = ca.vertcat(*(gaps[sign] for sign in self.signs))
        object.__setattr__(self, "least", least)
        if self.squares is None:
            object.__setattr__(self, "bounds", least)
            return
        plain = {1: low_a - high_b, -1: -high_a + low_b}
        overlaps = ca.fmin(ca.vertcat(*(plain[sign] for sign in self.signs)), 0)
        squares, drops = (ca.repmat(row, len(self.signs), 1) for row in (self.squares, self.drop))
        seen = ca.if_else(overlaps < 0, overlaps / ca.fmax(squares, TINY_NUMBER) - drops, least)
        object.__setattr__(self, "bounds", ca.if_else(squares > 0, seen, -ca.inf))

    def shape(self, gamma: int, order: int) -> AxisShape:
        """Return the shape of this group's axis function."""
        sizes = self.levels.shape[0], self.along.shape[0]
        return AxisShape(*sizes, gamma, order, self.points_a is not None, self.signs, self.placements)

    def evaluated(self, gamma: int, order: int, case: ca.MX, length: ca.MX) -> list[ca.MX]:
        """Return the outputs of ``axis_function`` for all axes, side by side; ``case`` (1, K)."""
        count = self.levels.shape[1]
        function = axis_function(self.shape(gamma, order)).map(count)
        moving = [] if self.points_a is None else [self.points_a]
        outputs = function(
            case,
            self.levels,
            self.level_counts,
            self.along,
            self.along_counts,
            self.drop,
            self.least,
            ca.repmat(length, 1, count),
            self.points_b,
            *moving,
        )
        return list(outputs) if order else [outputs]


def combined(groups: list[Axes], gamma: int, order: int, length: ca.MX) -> list[ca.MX]:
    """Return D, D̃ and, by order, the gradient (6) and the Hessian (6, 6) of D by the motion, six for each
    placement."""
    apart = ca.mmax(ca.horzcat(*(ca.vec(group.least).T for group in groups))) > TINY_NUMBER
    separation = ca.mmax(ca.horzcat(*(ca.vec(group.bounds).T for group in groups)))  # positive where the former is
    evaluated = []
    for group in groups:
        separates = ca.fmax(group.least[0, :], group.least[-1, :]) > TINY_NUMBER
        case = ca.if_else(apart, SKIPPED + (APART - SKIPPED) * separates, CONTACT)
        evaluated.append(group.evaluated(gamma, order, case, length))
    counts = ca.DM(np.concatenate([np.repeat(group.counts, len(group.signs)) for group in groups])).T
    found = maximum(ca.horzcat(*(outputs[0] for outputs in evaluated)), counts, gamma, length)
    results = [found.value, separation]
    return results + _derivatives(groups, evaluated, found, gamma, order) if order else results


@dataclass(frozen=True)
class Maximum:
    """D = Phi(U) of the maximum U of the axes' values g, and what its derivatives have."""

    value: ca.MX  # D = Phi(U)
    slope: ca.MX  # dD/dU
    share: ca.MX  # (1, N) dU/dg
    outer: ca.MX  # d²D/dg² = outer · share shareᵀ + diag(spread)
    spread: ca.MX  # (1, N)


def maximum(g: ca.MX, counts: ca.DM | ca.MX, gamma: int, length: ca.MX) -> Maximum:
    """Return D = Phi(⊞ g) with its derivatives: the mirror image of the minimum of -g."""
    p = gamma + 1
    top = ca.mmax(g)
    positive, negative = top > TINY_NUMBER, top < -TINY_NUMBER
    numerator = ca.if_else(positive, positive_part(g), negative * top)
    r = numerator / ca.if_else(positive, top, ca.if_else(negative, g, 1))
    extra = ca.if_else(positive, 1, r * r)  # in contact the derivatives have two more powers
    low = integer_power(r, p - 2) if p > 2 else r > 0
    total = ca.dot(counts, low * r * r)
    mirrored = shaped(-top, total, length, gamma, negative)
    share = counts * low * r * extra * mirrored.scale_pull
    spread = -counts * low * extra * extra * mirrored.scale_sharp
    return Maximum(-mirrored.value, mirrored.slope, share, -mirrored.outer, spread)


def _derivatives(
    groups: list[Axes], evaluated: list[list[ca.MX]], found: Maximum, gamma: int, order: int
) -> list[ca.MX]:
    """Return the gradient (6), and the Hessian (6, 6) for order 2, of D by the twist of B in A's frame."""
    twists = 6 * groups[0].placements
    wrench, hessian, start = ca.MX.zeros(twists), ca.MX.zeros(twists, twists), 0
    for group, outputs in zip(groups, evaluated, strict=True):
        count = group.levels.shape[1]
        columns = slice(start, start + len(group.signs) * count)
        start += len(group.signs) * count
        share, spread = found.share[columns], found.spread[columns]
        slope, pull = outputs[1], outputs[2]
        sizes = tuple(parameter.shape[0] for parameter in group.parameters)
        function = wrench_function(group.motion, sizes, group.shape(gamma, order)).map(count)
        push = share * slope
        if order == 1:
            wrench += ca.sum2(function(*group.parameters, pull, push))
            continue
        outer, sharp = outputs[3], outputs[4]
        weight = found.slope * share
        first, second = function(
            *group.parameters, pull, push, sharp, weight * slope, weight * outer + spread * slope * slope, weight
        )
        wrench += ca.sum2(first)
        hessian += ca.reshape(ca.sum2(ca.reshape(second, twists * twists, count)), twists, twists)
    gradient = found.slope * wrench
    return [gradient] if order == 1 else [gradient, hessian + found.outer * wrench @ wrench.T]


def _spans(columns: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return the least and the largest of every column (1, K); of constants as constants."""
    if columns.is_constant():
        values = np.array(columns.to_DM())
        return ca.MX(ca.DM(values.min(axis=0)).T), ca.MX(ca.DM(values.max(axis=0)).T)
    column = ca.SX.sym("column", columns.shape[0])
    low = high = column[0]
    for k in range(1, columns.shape[0]):
        low, high = ca.fmin(low, column[k]), ca.fmax(high, column[k])
    spans = ca.Function("span", [column], [low, high]).map(columns.shape[1])(columns)
    return spans[0], spans[1]
