"""The distance of a link's piece to the balls of a cloud's cell, exact, without asking about every ball.

    d(A, ⋃ B_i) = min_i d(A, c_i) − r_i

Every unit n bounds each of these from below, by gap(n) of `exact_proximity`, and so does the bounding box of A. Balls
are asked about in the order of their bounds, and every direction found bounds all others: mostly two or three are
enough, of which the smallest distance is below the bounds of all the rest.
"""

from __future__ import annotations

import coal
import numpy as np

from hdplan.planner.certificate.exact_proximity import Piece, directions, surface_distance, transform
from hdplan.scenes.array_types import Array


def ball_distance(a: Piece, pose_a: Array, b: Piece, pose_b: Array) -> float:
    """Return a lower bound of the signed distance [m] of piece A to the balls of B, exact up to rounding where coal
    proposes the best directions; 0 in contact with triangles. Poses are (4, 4)."""
    return _closest(a, pose_a, b, pose_b)[0]


def closest_ball(a: Piece, pose_a: Array, b: Piece, pose_b: Array) -> Piece:
    """Return the ball of B that is closest to A, in B's frame."""
    assert b.grains is not None
    return _ball(b.grains[_closest(a, pose_a, b, pose_b)[1]])


def _closest(a: Piece, pose_a: Array, b: Piece, pose_b: Array) -> tuple[float, int]:
    """Return the distance and the row of the closest ball."""
    assert b.grains is not None
    radii = b.grains[:, 3]
    world = b.grains[:, :3] @ pose_b[:3, :3].T + pose_b[:3, 3]
    centres = (world - pose_a[:3, 3]) @ pose_a[:3, :3]  # in A's frame
    bound = np.linalg.norm(np.maximum(np.maximum(a.low - centres, centres - a.high), 0.0), axis=1) - radii
    least, row = np.inf, 0
    left = np.ones(len(radii), dtype=bool)
    while True:
        first = int(np.where(left, bound, np.inf).argmin())
        if not left[first] or bound[first] >= least:
            return least, row
        left[first] = False
        if a.surface is not None:
            pose = np.eye(4)
            pose[:3, 3] = centres[first]
            value = surface_distance(a, np.eye(4), _ball(np.append(np.zeros(3), radii[first])), pose)
        else:
            place = transform(np.eye(3), centres[first])
            (normal,), _ = directions([(a.shape, _HERE, coal.Sphere(float(radii[first])), place)])
            gaps = -a.support(-normal[None])[0] - centres @ normal - radii
            bound, value = np.maximum(bound, gaps), float(gaps[first])
        if value < least:
            least, row = value, first


def _ball(grain: Array) -> Piece:
    return Piece(grain[None, :3], coal.Sphere(float(grain[3])), float(grain[3]))


_HERE = transform(np.eye(3), np.zeros(3))
