"""A pair of bodies as arrays for ``kernel``: its axes, and all that is constant about them.

Exact reductions: a body's projections on its own directions are constants, equal ones enter once with their count; and
vertices that differ along an edge only have one projection across it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdplan.distance.bodies import ConvexBody
from hdplan.distance.normals import CentreAxis, EdgeAxes, candidate_normals

Floats = NDArray[np.float64]
Array = Any  # NumPy's here, JAX's on the device

# [m] largest extent of a body, and distance from the other: sums of squares must not overflow
FARTHEST_POSITION = {"float64": 1e101, "float32": 1e15}
MERGED_PROJECTIONS = 1e-14  # projections this close, relative to the largest, are merged


class OwnAxes(NamedTuple):
    """n axes fixed in a body, including their opposites."""

    normals: Array  # (3, n, 1) in the body's frame
    levels: Array  # (L, n, 1) [m] distinct projections of the body's vertices, padded with copies
    level_counts: Array  # (L, n, 1) how many vertices have each; 0 for copies
    counts: Array  # (n, 1) how often each axis counts in the maximum


class MovingAxes(NamedTuple):
    """n axes w = e/√h, h = |e|² + softness², e = start + matrix·lever, faded by f = fade·softness²(1 - |e|²)/h.

    The lever is a point or a direction of B and moves with it. Everything else is in A's frame.
    """

    start: Array  # (3, n, 1)
    matrix: Array  # (3, 3, n, 1)
    lever: Array  # (3, n, 1) in B's frame
    point: Array  # (n, 1) 1 where the lever is a point, 0 where it is a direction
    softness: Array  # (n, 1)
    fade: Array  # (n, 1) [m]
    points_a: Array  # (3, L, n, 1) [m] A's vertices as far as they differ across the axis, padded with copies
    counts_a: Array  # (L, n, 1) how many vertices each represents; 0 for copies
    points_b: Array  # (3, V, n, 1) [m] B's, in its frame
    counts_b: Array  # (V, n, 1)


class Pair(NamedTuple):
    """Everything about two convex bodies. It is an argument of the compiled function, so that pairs of equal array
    shapes share it."""

    vertices_a: Array  # (V_A, 3, 1) [m]
    vertices_b: Array  # (V_B, 3, 1) [m]
    in_a: OwnAxes
    in_b: OwnAxes
    moving: tuple[MovingAxes, ...]
    radii: Array  # () [m] r_A + r_B

    def numbers(self, witness_count: int) -> int:
        """Return the largest number of projections of one body in a group of axes."""
        vertices = max(len(self.vertices_a), len(self.vertices_b))
        groups = [own.counts.size * max(len(own.levels), vertices) for own in (self.in_a, self.in_b)]
        groups += [max(moving.counts_a.size, moving.counts_b.size) for moving in self.moving]
        return int(max(*groups, 2 * witness_count * vertices))


def pair_tables(body_a: ConvexBody, body_b: ConvexBody, normals: str) -> Pair:
    """Return the arrays of a pair for the set ``normals`` (see ``normals.candidate_normals``)."""
    axes = candidate_normals(normals, body_a, body_b)
    moving = []
    if axes.centre is not None:
        moving.append(_between_centres(axes.centre, body_a, body_b))
    if axes.edges is not None and len(axes.edges.along_a) and len(axes.edges.along_b):
        moving.append(_across_edges(axes.edges, body_a, body_b))
    return Pair(
        body_a.vertices[..., None],
        body_b.vertices[..., None],
        _own(body_a, axes.in_a, axes.counts_a),
        _own(body_b, axes.in_b, axes.counts_b),
        tuple(moving),
        np.array(body_a.radius + body_b.radius),
    )


def _own(body: ConvexBody, directions: Floats, counts: Floats) -> OwnAxes:
    normals = np.vstack([directions, -directions])
    levels, level_counts = _filled([_distinct(body.vertices @ normal) for normal in normals])
    return OwnAxes(*_axes_last(normals, levels, level_counts, np.tile(counts, 2)))


def _between_centres(centre: CentreAxis, body_a: ConvexBody, body_b: ConvexBody) -> MovingAxes:
    signs = np.array([1.0, -1.0])
    return MovingAxes(
        *_axes_last(
            signs[:, None] * centre.point_a,
            -signs[:, None, None] * np.eye(3),
            np.tile(centre.point_b, (2, 1)),
            np.ones(2),
            np.full(2, centre.softness),
            np.zeros(2),
            np.tile(body_a.vertices.T, (2, 1, 1)),
            np.ones((2, len(body_a.vertices))),
            np.tile(body_b.vertices.T, (2, 1, 1)),
            np.ones((2, len(body_b.vertices))),
        )
    )


def _across_edges(edges: EdgeAxes, body_a: ConvexBody, body_b: ConvexBody) -> MovingAxes:
    """Assemble the axes across every edge u of A, and -u, and every edge v of B: e = u×v."""
    along_a, along_b = np.vstack([edges.along_a, -edges.along_a]), edges.along_b
    of_a = [np.cross(along_a[:, None], -np.eye(3)), *_seen_along(body_a.vertices, along_a)]
    of_b = [along_b, *_seen_along(body_b.vertices, along_b)]
    matrix, points_a, counts_a = (np.repeat(part, len(along_b), axis=0) for part in of_a)
    lever, points_b, counts_b = (np.concatenate([part] * len(along_a)) for part in of_b)
    number = len(lever)
    sine, fade = np.full(number, edges.sine), np.full(number, edges.fade)
    zeros = np.zeros(number)
    start = np.zeros((number, 3))
    return MovingAxes(*_axes_last(start, matrix, lever, zeros, sine, fade, points_a, counts_a, points_b, counts_b))


def _distinct(values: Floats) -> tuple[Floats, Floats]:
    """Return the distinct numbers among ``values``, to rounding, and how often each occurs."""
    ordered = np.sort(values)
    starts = np.flatnonzero(np.diff(ordered, prepend=-np.inf) > MERGED_PROJECTIONS * np.abs(ordered).max())
    groups = np.split(ordered, starts[1:])
    return np.array([group.mean() for group in groups]), np.array([float(len(group)) for group in groups])


def _seen_along(vertices: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Return for each direction (E, 3, L) one of each set of vertices that differ along it only, and counts (E, L)."""
    found = []
    for direction in directions:
        shadow = vertices - np.outer(vertices @ direction, direction)
        gaps = np.abs(shadow[:, None] - shadow).max(axis=-1)
        first = np.argmax(gaps <= MERGED_PROJECTIONS * np.abs(vertices).max(), axis=1)
        kept, times = np.unique(first, return_counts=True)
        found.append((kept.astype(float), times.astype(float)))
    chosen, counts = _filled(found)
    return np.swapaxes(vertices[chosen.astype(int)], 1, 2), counts


def _filled(rows: Sequence[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    """Return rows of entries and counts as arrays; shorter ones are padded with their first entry, counted 0."""
    width = max(len(entries) for entries, _ in rows)
    entries = np.array([[*row, *[row[0]] * (width - len(row))] for row, _ in rows])
    counts = np.array([[*row, *[0.0] * (width - len(row))] for _, row in rows])
    return entries, counts


def _axes_last(*parts: Floats) -> list[Floats]:
    """Return arrays (n, ...) as (..., n, 1)."""
    return [np.moveaxis(part, 0, -1)[..., None] for part in parts]
