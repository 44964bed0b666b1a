"""Clouds for the certificate: a piece for each cell of points, its box as hull and every single ball as exact shape.

How the points are grouped, and the axes of the boxes, are only proposals, which the planner uses too: that each ball is
in a group, and how large the boxes must be, is computed here. Points are never merged.
"""

from __future__ import annotations

import itertools

import coal
import numpy as np

from hdplan.planner.certificate.exact_proximity import CORNERS, Piece, box_piece, hull_piece
from hdplan.planner.geometry.cells import Cells, cells_of
from hdplan.planner.geometry.coal_shapes import convex_hull
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.once import made_once, read_only

CELL_EDGE = 0.08  # [m] edge of the cubes whose points make a piece
LEAST_BOX_SIZE = 1e-5  # [m] the least size of a box that coal gets: it only proposes directions
KEPT_CLOUDS = 4  # clouds and maps of which the pieces are kept, in a process
ROUNDING_SHARE = 1e-12  # share by which boxes are larger, for rounding


@made_once(KEPT_CLOUDS)
def standing_pieces(balls: FixedArray) -> tuple[tuple[Piece, ...], Array]:
    """Return pieces that contain the balls (m, 4), centres and radii [m], and the frame of each in theirs (c, 4, 4);
    once per cloud, wherever it stands."""
    frames, half, radius, grains = _boxes(balls, cells_of(balls, CELL_EDGE))
    vertices = read_only(2.0 * half[:, None] * CORNERS)
    away = np.linalg.norm(half, axis=1) + radius
    low, high, center = read_only(-half - radius[:, None]), read_only(half + radius[:, None]), read_only(np.zeros(3))
    pieces = []
    for c, (size, ball) in enumerate(
        zip(np.maximum(2.0 * half, LEAST_BOX_SIZE).tolist(), radius.tolist(), strict=True)
    ):
        shape = coal.Box(*size)
        shape.setSweptSphereRadius(ball)
        bounds = low[c], high[c], center, float(away[c])  # as the class computes them one by one, for thousands slowly
        pieces.append(Piece.bounded(vertices[c], shape, ball, grains[c], bounds))
    return tuple(pieces), read_only(frames)


def moving_pieces(balls: FixedArray) -> list[Piece]:
    """Return the pieces in the frame of the balls."""
    found = []
    for frame, half, radius, own in zip(*_boxes(balls, cells_of(balls, CELL_EDGE)), strict=True):
        corners = (2.0 * half * CORNERS) @ frame[:3, :3].T + frame[:3, 3]
        back = np.column_stack([own[:, :3] @ frame[:3, :3].T + frame[:3, 3], own[:, 3]])
        ball = float(radius) + ROUNDING_SHARE * float(np.abs(corners).max())  # turned there and back
        shape = convex_hull((np.maximum(2.0 * half, LEAST_BOX_SIZE) * CORNERS) @ frame[:3, :3].T + frame[:3, 3])
        assert shape is not None  # each corner of a box has three neighbours
        shape.setSweptSphereRadius(ball)
        found.append(Piece(corners, shape, ball, grains=back))
    return found


@made_once(KEPT_CLOUDS)
def box_pieces(boxes: FixedArray) -> tuple[tuple[Piece, ...], Array]:
    """Return the boxes (k, 6), lower and upper corners [m], as pieces, and the frame of each in theirs (k, 4, 4);
    once per map."""
    low, high = boxes.array[:, :3], boxes.array[:, 3:]
    frames = np.tile(np.eye(4), (len(low), 1, 1))
    frames[:, :3, 3] = 0.5 * (low + high)
    return tuple(box_piece(size) for size in high - low), read_only(frames)


def moving_box_pieces(boxes: FixedArray) -> list[Piece]:
    """Return the pieces in the frame of the boxes."""
    sides = zip(boxes.array[:, :3], boxes.array[:, 3:], strict=True)
    return [hull_piece(0.5 * (low + high) + CORNERS * (high - low)) for low, high in sides]


def _boxes(balls: FixedArray, cells: Cells) -> tuple[Array, Array, Array, list[Array]]:
    """Return each group's frame (c, 4, 4), half the size (c, 3) of a box around its centres, the largest radius (c,),
    and its balls in that frame."""
    given, order = balls.array, cells.order
    ends = np.append(cells.first, len(order))
    if not (
        np.array_equal(np.bincount(order, minlength=len(given)), np.ones(len(given)))
        and ends[0] == 0
        and (np.diff(ends) > 0).all()
    ):
        raise HdplanError("the groups of a cloud's points are not all of its points: please report this")
    found, sizes = given[order], np.diff(ends)
    local = np.einsum("mi,mij->mj", found[:, :3], np.repeat(cells.rotation, sizes, axis=0))
    low, high = np.minimum.reduceat(local, cells.first), np.maximum.reduceat(local, cells.first)
    middle = 0.5 * (low + high)
    half = 0.5 * (high - low) + ROUNDING_SHARE * np.abs(local).max()
    grains = read_only(np.column_stack([local - np.repeat(middle, sizes, axis=0), found[:, 3]]))
    frames = np.tile(np.eye(4), (len(sizes), 1, 1))
    frames[:, :3, :3], frames[:, :3, 3] = cells.rotation, np.einsum("cij,cj->ci", cells.rotation, middle)
    radius = np.maximum.reduceat(found[:, 3], cells.first)
    return frames, half, radius, [grains[i:j] for i, j in itertools.pairwise(ends.tolist())]
