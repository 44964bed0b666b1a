"""The HD-SDF of two bodies as CasADi functions: value, and gradient and Hessian in closed form.

The bodies are constants of the function, the pose is its argument. Exact reductions: a body's projections on its own
directions are constants, and equal ones enter once with their count; n and -n share the differences; vertices that
differ only along an edge have one projection across it; and where any axis separates the bodies, the others are not
computed. Loops stay loops: one small function per kind of axis, mapped.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import CandidateNormals, candidate_normals
from hdplan.distance.symbolic.all_axes import Axes, combined
from hdplan.distance.symbolic.axis_wrenches import across_edges, between_centres, edge_axis, fixed_in_a, fixed_in_b
from hdplan.scenes.array_types import Array

# Projections this close, relative to the largest, are merged into one with a count.
SAME_PROJECTION = 1e-14


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
    results = combined(groups, gamma, order, length)
    names = ["distance", "separation", "gradient", "hessian"][: order + 2]
    return ca.Function(
        "relative",
        [rotation, position, length, witnesses],
        results,
        ["rotation", "position", "length", "witnesses"],
        names,
    )


def _groups(
    axes: CandidateNormals, body_a: ConvexBody, body_b: ConvexBody, rotation: ca.MX, position: ca.MX, witnesses: ca.MX
) -> list[Axes]:
    """Assemble every axis, in groups of equal numbers of projections."""
    radii = body_a.radius + body_b.radius
    in_a = rotation @ ca.DM(body_b.vertices.T) + ca.repmat(
        position, 1, len(body_b.vertices)
    )  # B's vertices in A's frame
    in_b = rotation.T @ (ca.DM(body_a.vertices.T) - ca.repmat(position, 1, len(body_a.vertices)))
    groups = []
    for motion, directions, counts, own, seen, points in (
        (fixed_in_a, axes.in_a, axes.counts_a, body_a, in_a, in_a),
        (fixed_in_b, axes.in_b, axes.counts_b, body_b, in_b, _constant(body_a.vertices.T)),
    ):
        levels = [_distinct(own.vertices @ direction) for direction in directions]
        for size in sorted({len(values) for values, _ in levels}):
            chosen = [k for k, (values, _) in enumerate(levels) if len(values) == size]
            normals = ca.DM(directions[chosen].T)
            groups.append(
                Axes(
                    motion,
                    [ca.MX(normals) if motion is fixed_in_a else rotation @ normals],
                    _constant([levels[k][0] for k in chosen]).T,
                    _constant([levels[k][1] for k in chosen]).T,
                    seen.T @ normals,
                    ca.MX.ones(seen.shape[1], len(chosen)),
                    radii * ca.MX.ones(1, len(chosen)),
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
                ca.MX.ones(len(body_b.vertices), count),
                in_b.T @ witnesses,
                ca.MX.ones(len(body_a.vertices), count),
                radii * ca.MX.ones(1, count),
                np.ones(count),
                ca.repmat(_constant(body_a.vertices.T), 1, count),
            )
        )
    if (centre := axes.centre) is not None:
        points_a, centre_b = ca.DM(body_a.vertices.T), rotation @ ca.DM(centre.point_b) + position
        t = ca.DM(centre.point_a) - centre_b
        w = t / ca.sqrt(ca.dot(t, t) + centre.softness**2)
        groups.append(
            Axes(
                between_centres,
                [_constant(centre.point_a), centre_b, ca.MX(centre.softness)],
                points_a.T @ w,
                ca.MX.ones(len(body_a.vertices)),
                in_a.T @ w,
                ca.MX.ones(len(body_b.vertices)),
                ca.MX(radii),
                np.ones(1),
                in_a,
                ca.MX(points_a),
                squares=ca.dot(w, w),
            )
        )
    return groups + _edge_groups(axes, body_a, body_b, rotation, in_a)


def _edge_groups(
    axes: CandidateNormals, body_a: ConvexBody, body_b: ConvexBody, rotation: ca.MX, in_a: ca.MX
) -> list[Axes]:
    """Assemble the axes across edges, every edge of A with every one of B."""
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
            edge_a = _constant(edges.along_a[[i for i, _ in pairs]].T)
            edge_b = (rotation @ ca.DM(edges.along_b[vs].T))[:, [k for _ in us for k in range(len(vs))]]
            points_a = _constant(np.vstack([body_a.vertices[classes_a[i][0]] for i, _ in pairs]).T)
            points_b = in_a[:, np.concatenate([classes_b[j][0] for _, j in pairs]).tolist()]
            sine, fade = (value * ca.MX.ones(1, count) for value in (edges.sine, edges.fade))
            function = _across(size_a, size_b).map(count)
            levels, along, drop, squares = function(edge_a, edge_b, sine, fade, points_a, points_b)
            groups.append(
                Axes(
                    across_edges,
                    [edge_a, edge_b, sine, fade],
                    levels,
                    _constant([classes_a[i][1] for i, _ in pairs]).T,
                    along,
                    _constant([classes_b[j][1] for _, j in pairs]).T,
                    drop + body_a.radius + body_b.radius,
                    np.ones(count),
                    points_b,
                    points_a,
                    squares=squares,
                )
            )
    return groups


def _across(size_a: int, size_b: int) -> ca.Function:
    """Return the function of one axis w across edges: projections of A's and B's points on it, its fade, and |w|²."""
    edge_a, edge_b, sine, fade = ca.SX.sym("u", 3), ca.SX.sym("v", 3), ca.SX.sym("sine"), ca.SX.sym("fade")
    points_a, points_b = ca.SX.sym("a", 3, size_a), ca.SX.sym("b", 3, size_b)
    w, drop = edge_axis(edge_a, edge_b, sine, fade)
    inputs = [edge_a, edge_b, sine, fade, points_a, points_b]
    return ca.Function("across", inputs, [points_a.T @ w, points_b.T @ w, drop, ca.dot(w, w)])


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


def _constant(rows: Any) -> ca.MX:
    return ca.MX(ca.DM(np.array(rows)))
