"""The HD-SDF of two bodies as CasADi functions: value, and gradient and Hessian in closed form.

The bodies' numbers are built in, the pose is the argument. Exact reductions: a body's projections on directions that
are its own are constants, and equal ones enter once with their count; n and -n share the differences; vertices that
differ along an edge have one projection across it; and where any axis separates the bodies, the others are not computed
at all. Loops stay loops: one small function per kind of axis, mapped.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hdplan.distance.axis import APART, CONTACT, SKIPPED, AxisShape, axis_function, shaped
from hdplan.distance.axis_motion import (
    Motion,
    across_edges,
    between_centres,
    edge_axis,
    fixed_in_a,
    fixed_in_b,
    wrench_function,
)
from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import CandidateNormals, candidate_normals
from hdplan.distance.symbolic import TINY, integer_power, positive_part

Array = NDArray[np.float64]

# Projections this close, relative to the largest, are one projection with a count.
SAME_PROJECTION = 1e-14


@dataclass(frozen=True, eq=False)
class Axes:
    """K axes of one kind and of equal numbers of projections."""

    motion: Motion
    parameters: list[ca.MX]  # of the motion, (·, K) each
    levels: ca.MX  # (L, K)
    level_counts: Array  # (L, K)
    along: ca.MX  # (m, K)
    along_counts: Array  # (m, K)
    drop: ca.MX  # (1, K)
    counts: Array  # (K,) how often each axis counts in the maximum
    points_b: ca.MX  # (3, m K) in A's frame; A's vertices where the axes are fixed in B
    points_a: ca.MX | None = None  # (3, L K) where both lists of projections move
    least: ca.MX = field(init=False)  # (2, K) the least separation along the axis and its opposite

    def __post_init__(self) -> None:
        """Find the least separations."""
        low_a, high_a = _spans(self.levels)
        low_b, high_b = _spans(self.along)
        object.__setattr__(self, "least", ca.vertcat(low_a - high_b - self.drop, low_b - high_a - self.drop))

    def shape(self, gamma: int, order: int) -> AxisShape:
        """Return what this group's axis function is built for."""
        return AxisShape(self.levels.shape[0], self.along.shape[0], gamma, order, self.points_a is not None)

    def evaluated(self, gamma: int, order: int, case: ca.MX, length: ca.MX) -> list[ca.MX]:
        """Return the outputs of ``axis_function`` for all axes, side by side; ``case`` (1, K)."""
        count = self.levels.shape[1]
        function = axis_function(self.shape(gamma, order)).map(count)
        moving = [] if self.points_a is None else [self.points_a]
        outputs = function(
            case,
            self.levels,
            ca.DM(self.level_counts),
            self.along,
            ca.DM(self.along_counts),
            self.drop,
            self.least,
            ca.repmat(length, 1, count),
            self.points_b,
            *moving,
        )
        return list(outputs) if order else [outputs]


def relative_function(
    body_a: ConvexBody, body_b: ConvexBody, gamma: int, normals: str, witness_count: int, order: int
) -> ca.Function:
    """Return D and D̃ as a function of B's pose in A's frame.

    Inputs: rotation (3, 3), position (3) [m], shaping_length [m], witnesses (3, W), unit, in B's frame.

    Outputs: distance, separation [m]; from order 1 on the gradient (6) by the twist η of B in A's frame; for order 2
    the Hessian (6, 6): D(exp(η)·pose) to second order.
    """
    rotation, position = ca.MX.sym("rotation", 3, 3), ca.MX.sym("position", 3)
    length, witnesses = ca.MX.sym("shaping_length"), ca.MX.sym("witnesses", 3, witness_count)
    axes = candidate_normals(normals, body_a, body_b)
    groups = _groups(axes, body_a, body_b, rotation, position, witnesses)
    separation = ca.mmax(ca.horzcat(*(ca.vec(group.least).T for group in groups)))
    apart = separation > TINY
    evaluated = []
    for group in groups:
        separates = ca.fmax(group.least[0, :], group.least[1, :]) > TINY
        case = ca.if_else(apart, SKIPPED + (APART - SKIPPED) * separates, CONTACT)
        evaluated.append(group.evaluated(gamma, order, case, length))
    counts = ca.DM(np.repeat(np.concatenate([group.counts for group in groups]), 2)).T
    maximum = _maximum(ca.horzcat(*(outputs[0] for outputs in evaluated)), counts, gamma, length)
    results = [maximum.value, separation]
    if order:
        results += _derivatives(groups, evaluated, maximum, gamma, order)
    names = ["distance", "separation", "gradient", "hessian"][: order + 2]
    return ca.Function(
        "relative",
        [rotation, position, length, witnesses],
        results,
        ["rotation", "position", "length", "witnesses"],
        names,
    )


@dataclass(frozen=True)
class _Maximum:
    value: ca.MX  # D = Phi(U)
    slope: ca.MX  # dD/dU
    share: ca.MX  # (1, N) dU/dg
    outer: ca.MX  # d²D/dg² = outer · share shareᵀ + diag(spread)
    spread: ca.MX  # (1, N)


def _maximum(g: ca.MX, counts: ca.DM, gamma: int, length: ca.MX) -> _Maximum:
    """Return D = Phi(⊞ g) with its derivatives: the mirror image of the minimum of -g."""
    p = gamma + 1
    top = ca.mmax(g)
    positive, negative = top > TINY, top < -TINY
    numerator = ca.if_else(positive, positive_part(g), negative * top)
    r = numerator / ca.if_else(positive, top, ca.if_else(negative, g, 1))
    extra = ca.if_else(positive, 1, r * r)  # below contact the derivatives have two powers more
    low = integer_power(r, p - 2) if p > 2 else r > 0
    total = ca.dot(counts, low * r * r)
    mirrored = shaped(-top, total, length, gamma, negative)
    share = counts * low * r * extra * mirrored.scale_pull
    spread = -counts * low * extra * extra * mirrored.scale_sharp
    return _Maximum(-mirrored.value, mirrored.slope, share, -mirrored.outer, spread)


def _derivatives(
    groups: list[Axes], evaluated: list[list[ca.MX]], maximum: _Maximum, gamma: int, order: int
) -> list[ca.MX]:
    """Return the gradient (6), and the Hessian (6, 6) for order 2, of D by the twist of B in A's frame."""
    wrench, hessian, start = ca.MX.zeros(6), ca.MX.zeros(6, 6), 0
    for group, outputs in zip(groups, evaluated, strict=True):
        count = group.levels.shape[1]
        columns = slice(start, start + 2 * count)
        start += 2 * count
        share, spread = maximum.share[columns], maximum.spread[columns]
        slope, pull = outputs[1], outputs[2]
        sizes = tuple(parameter.shape[0] for parameter in group.parameters)
        function = wrench_function(group.motion, sizes, group.shape(gamma, order).moments, order).map(count)
        push = share * slope
        if order == 1:
            wrench += ca.sum2(function(*group.parameters, pull, push))
            continue
        outer, sharp = outputs[3], outputs[4]
        weight = maximum.slope * share
        first, second = function(
            *group.parameters, pull, push, sharp, weight * slope, weight * outer + spread * slope * slope, weight
        )
        wrench += ca.sum2(first)
        hessian += ca.reshape(ca.sum2(ca.reshape(second, 36, count)), 6, 6)
    gradient = maximum.slope * wrench
    return [gradient] if order == 1 else [gradient, hessian + maximum.outer * wrench @ wrench.T]


def _groups(
    axes: CandidateNormals, body_a: ConvexBody, body_b: ConvexBody, rotation: ca.MX, position: ca.MX, witnesses: ca.MX
) -> list[Axes]:
    """Lay out every axis, in groups of equal numbers of projections."""
    radii = body_a.radius + body_b.radius
    in_a = rotation @ ca.DM(body_b.vertices.T) + ca.repmat(
        position, 1, len(body_b.vertices)
    )  # B's vertices in A's frame
    in_b = rotation.T @ (ca.DM(body_a.vertices.T) - ca.repmat(position, 1, len(body_a.vertices)))
    groups = []
    for motion, directions, counts, own, seen, points in (
        (fixed_in_a, axes.in_a, axes.counts_a, body_a, in_a, in_a),
        (fixed_in_b, axes.in_b, axes.counts_b, body_b, in_b, ca.MX(ca.DM(body_a.vertices.T))),
    ):
        levels = [_distinct(own.vertices @ direction) for direction in directions]
        for size in sorted({len(values) for values, _ in levels}):
            chosen = [k for k, (values, _) in enumerate(levels) if len(values) == size]
            normals = ca.DM(directions[chosen].T)
            groups.append(
                Axes(
                    motion,
                    [ca.MX(normals) if motion is fixed_in_a else rotation @ normals],
                    ca.MX(ca.DM(np.array([levels[k][0] for k in chosen]).T)),
                    np.array([levels[k][1] for k in chosen]).T,
                    seen.T @ normals,
                    np.ones((seen.shape[1], len(chosen))),
                    ca.MX(ca.DM(np.full((1, len(chosen)), radii))),
                    counts[chosen],
                    ca.repmat(points, 1, len(chosen)),
                )
            )
    if (count := witnesses.shape[1]) > 0:
        groups.append(
            Axes(
                fixed_in_b,
                [rotation @ witnesses],
                ca.DM(body_b.vertices) @ witnesses,
                np.ones((len(body_b.vertices), count)),
                in_b.T @ witnesses,
                np.ones((len(body_a.vertices), count)),
                ca.MX(ca.DM(np.full((1, count), radii))),
                np.ones(count),
                ca.repmat(ca.MX(ca.DM(body_a.vertices.T)), 1, count),
            )
        )
    if (centre := axes.centre) is not None:
        points_a, centre_b = ca.DM(body_a.vertices.T), rotation @ ca.DM(centre.point_b) + position
        t = ca.DM(centre.point_a) - centre_b
        w = t / ca.sqrt(ca.dot(t, t) + centre.softness**2)
        groups.append(
            Axes(
                between_centres,
                [ca.MX(ca.DM(centre.point_a)), centre_b, ca.MX(centre.softness)],
                points_a.T @ w,
                np.ones((len(body_a.vertices), 1)),
                in_a.T @ w,
                np.ones((len(body_b.vertices), 1)),
                ca.MX(radii),
                np.ones(1),
                in_a,
                ca.MX(points_a),
            )
        )
    return groups + _edge_groups(axes, body_a, body_b, rotation, in_a)


def _edge_groups(
    axes: CandidateNormals, body_a: ConvexBody, body_b: ConvexBody, rotation: ca.MX, in_a: ca.MX
) -> list[Axes]:
    """Lay out the axes across edges, every edge of A with every one of B."""
    if axes.edges is None or not len(axes.edges.along_a) or not len(axes.edges.along_b):
        return []
    edges = axes.edges
    classes_a = [_classes(body_a.vertices, u) for u in edges.along_a]
    classes_b = [_classes(body_b.vertices, v) for v in edges.along_b]
    groups = []
    for size_a in sorted({len(kept) for kept, _ in classes_a}):
        for size_b in sorted({len(kept) for kept, _ in classes_b}):
            us = [k for k, (kept, _) in enumerate(classes_a) if len(kept) == size_a]
            vs = [k for k, (kept, _) in enumerate(classes_b) if len(kept) == size_b]
            pairs = [(i, j) for i in us for j in vs]
            count = len(pairs)
            edge_a = ca.MX(ca.DM(edges.along_a[[i for i, _ in pairs]].T))
            edge_b = (rotation @ ca.DM(edges.along_b[vs].T))[:, [k for _ in us for k in range(len(vs))]]
            points_a = ca.MX(ca.DM(np.vstack([body_a.vertices[classes_a[i][0]] for i, _ in pairs]).T))
            points_b = in_a[:, np.concatenate([classes_b[j][0] for _, j in pairs]).tolist()]
            sine, fade = (ca.MX(ca.DM(np.full((1, count), value))) for value in (edges.sine, edges.fade))
            levels, along, drop = _across(size_a, size_b).map(count)(edge_a, edge_b, sine, fade, points_a, points_b)
            groups.append(
                Axes(
                    across_edges,
                    [edge_a, edge_b, sine, fade],
                    levels,
                    np.array([classes_a[i][1] for i, _ in pairs]).T,
                    along,
                    np.array([classes_b[j][1] for _, j in pairs]).T,
                    drop + body_a.radius + body_b.radius,
                    np.ones(count),
                    points_b,
                    points_a,
                )
            )
    return groups


def _across(size_a: int, size_b: int) -> ca.Function:
    """Return the function of one axis across edges: projections of A's and B's points on it, and its fade."""
    edge_a, edge_b, sine, fade = ca.SX.sym("u", 3), ca.SX.sym("v", 3), ca.SX.sym("sine"), ca.SX.sym("fade")
    points_a, points_b = ca.SX.sym("a", 3, size_a), ca.SX.sym("b", 3, size_b)
    w, drop = edge_axis(edge_a, edge_b, sine, fade)
    return ca.Function(
        "across", [edge_a, edge_b, sine, fade, points_a, points_b], [points_a.T @ w, points_b.T @ w, drop]
    )


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


def _distinct(values: Array) -> tuple[Array, Array]:
    """Return the distinct numbers among ``values``, to rounding, and how often each occurs."""
    ordered = np.sort(values)
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > SAME_PROJECTION * np.abs(ordered).max())
    groups = np.split(ordered, starts[1:])
    return np.array([group.mean() for group in groups]), np.array([float(len(group)) for group in groups])


def _classes(points: Array, direction: Array) -> tuple[list[int], list[float]]:
    """Return one of each set of points (n, 3) that differ along ``direction`` only, and how many each set has."""
    across = points - np.outer(points @ direction, direction)
    kept: list[int] = []
    counts: list[float] = []
    for k, point in enumerate(across):
        gaps = np.abs(across[kept] - point).max(axis=1) if kept else np.empty(0)
        same = np.flatnonzero(gaps <= SAME_PROJECTION * np.abs(points).max())
        if len(same):
            counts[same[0]] += 1.0
        else:
            kept.append(k)
            counts.append(1.0)
    return kept, counts
