"""Distances of convex pieces by the judge's own means: many at once, in NumPy.

A piece is the hull of points, swept by a disc across z and by a ball. The distance of two is that of the origin from
their Minkowski difference (Gilbert, Johnson and Keerthi 1988): a simplex of at most four support points, its point
nearest to the origin by all of its faces. What comes out is bracketed:

    n·s − balls  ≤  d  ≤  |v| − balls        v a convex combination of differences of points, s the support along v

so both ends are facts, whatever rounding does to the search. Inside each other d ≤ −balls is all that is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.array_types import Array

Index = NDArray[np.int64]

ROUNDS = 40
CLOSE = 1e-11  # of the squared distance by which upper and lower end may differ
FACES = tuple(face for size in (1, 2, 3, 4) for face in combinations(range(4), size))


@dataclass(frozen=True, eq=False)
class Pieces:
    """P convex pieces in their bodies' frames."""

    points: Array  # (P, M, 3) [m]; short rows repeat their first point
    ball: Array  # (P,) [m]
    disc: Array  # (P,) [m] of a disc across z
    spins: Array  # (P, 3, 3) from the piece's own axes (of its disc) into the body's
    body: Index  # (P,) its body
    centre: Array  # (P, 3) of a ball around it
    radius: Array  # (P,) of that [m]

    @classmethod
    def of(cls, rows: list[tuple[int, Array, float, float, Array]]) -> Pieces:
        """Gather (body, points, ball, disc, axes)."""
        width = max((len(points) for _, points, *_ in rows), default=1)
        padded = np.array([np.vstack([p, np.repeat(p[:1], width - len(p), axis=0)]) for _, p, *_ in rows])
        padded = padded.reshape(len(rows), width, 3)
        ball, disc = (np.array([row[k] for row in rows], dtype=float) for k in (2, 3))
        centre = 0.5 * (padded.min(axis=1) + padded.max(axis=1))
        reach = np.linalg.norm(padded - centre[:, None], axis=2).max(axis=1) + ball + disc
        body = np.array([row[0] for row in rows], dtype=np.int64)
        spins = np.array([row[4] for row in rows], dtype=float).reshape(-1, 3, 3)
        return cls(padded, ball, disc, spins, body, centre, reach)


def distances(
    pieces: Pieces, first: Index, pose_a: Array, second: Index, pose_b: Array, enough: Array | None = None
) -> tuple[Array, Array]:
    """Return lower and upper bounds (Q,) of the signed distances of Q pairs of pieces at bodies' poses (Q, 4, 4).

    `enough` (Q,): a pair is finished when its lower bound reaches this value.
    """
    count = len(first)
    balls = pieces.ball[first] + pieces.ball[second]
    far = np.full(count, np.inf) if enough is None else enough + balls
    turn_a, turn_b = pose_a[:, :3, :3], pose_b[:, :3, :3]
    offset = pose_a[:, :3, 3] - pose_b[:, :3, 3]
    world_a = np.einsum("qij,qmj->qmi", turn_a, pieces.points[first]) + offset[:, None]
    world_b = np.einsum("qij,qmj->qmi", turn_b, pieces.points[second])
    axes = [turn_a @ pieces.spins[first], turn_b @ pieces.spins[second]]
    discs = [pieces.disc[first], pieces.disc[second]]
    low, high = np.full(count, -np.inf), np.full(count, np.inf)
    live = np.arange(count)
    simplex, used = np.zeros((count, 4, 3)), np.zeros((count, 4), dtype=bool)
    v = world_a.mean(axis=1) - world_b.mean(axis=1)
    v[np.linalg.norm(v, axis=1) == 0.0] = [1.0, 0.0, 0.0]
    met = np.zeros(count, dtype=bool)
    for round_ in range(ROUNDS):
        s = _support(world_a[live], axes[0][live], discs[0][live], -v[live])
        s -= _support(world_b[live], axes[1][live], discs[1][live], v[live])
        length = np.linalg.norm(v[live], axis=1)
        along = np.einsum("qi,qi->q", v[live], s)
        low[live] = np.maximum(low[live], along / length)
        if round_:
            high[live] = np.minimum(high[live], length)
            known = (np.abs(simplex[live] - s[:, None]).max(axis=2) == 0.0) & used[live]
            done = (length**2 - along <= CLOSE * length**2) | known.any(axis=1) | used[live].all(axis=1)
            done |= low[live] >= far[live]
            live, s = live[~done], s[~done]
        if not len(live):
            break
        free = np.argmin(used[live], axis=1)
        simplex[live, free], used[live, free] = s, True
        nearest, kept = _nearest(simplex[live], used[live])
        v[live], used[live] = nearest, kept
        zero = np.linalg.norm(nearest, axis=1) <= 1e-13 * np.abs(simplex[live]).max(axis=(1, 2)) + 1e-300
        met[live[zero]] = True
        high[live[zero]] = 0.0
        live = live[~zero]
    high[met] = np.minimum(high[met], 0.0)
    low[met] = -np.inf
    return low - balls, high - balls


def _support(points: Array, axes: Array, disc: Array, directions: Array) -> Array:
    heights = np.einsum("qmi,qi->qm", points, directions)
    found = np.take_along_axis(points, heights.argmax(axis=1)[:, None, None], axis=1)[:, 0]
    round_ = disc > 0.0
    if round_.any():
        turned = np.einsum("qji,qj->qi", axes[round_], directions[round_])
        turned[:, 2] = 0.0
        size = np.linalg.norm(turned, axis=1, keepdims=True)
        rim = np.divide(turned, size, out=np.zeros_like(turned), where=size > 0.0) * disc[round_, None]
        found = found.copy()
        found[round_] += np.einsum("qij,qj->qi", axes[round_], rim)
    return np.asarray(found)


def _nearest(simplex: Array, used: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the point of each simplex nearest to the origin and the corners that carry it."""
    count = len(simplex)
    best, point = np.full(count, np.inf), np.zeros((count, 3))
    kept = np.zeros((count, 4), dtype=bool)
    for face in FACES:
        rows = np.flatnonzero(used[:, face].all(axis=1))
        if not len(rows):
            continue
        corners = simplex[rows][:, face]
        weights, fine = _weights(corners)
        rows, corners, weights = rows[fine], corners[fine], weights[fine]
        found = np.einsum("qk,qki->qi", weights, corners)
        square = np.einsum("qi,qi->q", found, found)
        better = square < best[rows] * (1.0 - 1e-15)
        rows = rows[better]
        best[rows], point[rows] = square[better], found[better]
        kept[rows] = False
        kept[np.ix_(rows, face)] = weights[better] > 0.0
    return point, kept


def _weights(corners: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the weights (Q, k) of the point of a flat nearest to the origin, and where it lies between the corners."""
    size = corners.shape[1]
    if size == 1:
        return np.ones((len(corners), 1)), np.ones(len(corners), dtype=bool)
    edges = corners[:, 1:] - corners[:, :1]
    gram = np.einsum("qai,qbi->qab", edges, edges)
    right = -np.einsum("qai,qi->qa", edges, corners[:, 0])
    scale = np.einsum("qaa->qa", gram)
    if size == 2:
        determinant, solved = gram[:, 0, 0], right
    elif size == 3:
        (a, b), c = (gram[:, 0, 0], gram[:, 0, 1]), gram[:, 1, 1]
        determinant = a * c - b * b
        solved = np.stack([c * right[:, 0] - b * right[:, 1], a * right[:, 1] - b * right[:, 0]], axis=1)
    else:
        cofactors = np.stack([np.cross(gram[:, (k + 1) % 3], gram[:, (k + 2) % 3]) for k in range(3)], axis=2)
        determinant = np.einsum("qi,qi->q", gram[:, 0], cofactors[:, :, 0])
        solved = np.einsum("qij,qj->qi", cofactors, right)
    fine = determinant > 1e-13 * scale.prod(axis=1)
    rest = np.divide(solved, determinant[:, None], out=np.full_like(solved, -1.0), where=fine[:, None])
    weights = np.concatenate([1.0 - rest.sum(axis=1, keepdims=True), rest], axis=1)
    fine &= (weights >= -1e-12).all(axis=1)
    weights = np.maximum(weights, 0.0)
    total = weights.sum(axis=1, keepdims=True)
    return weights / np.where(total > 0.0, total, 1.0), fine
