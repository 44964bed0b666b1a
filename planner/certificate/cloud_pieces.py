"""Clouds for the certificate: a piece for each cell of points, its box as hull and every single ball as exact shape.

How the points are grouped, and the axes of the boxes, are only proposals, which the planner uses too: that each ball is
in a group, and how large the boxes must be, is computed here. Points are never merged.
"""

from __future__ import annotations

from collections.abc import Iterator

import coal
import numpy as np

from hdplan.planner.certificate.exact_proximity import CORNERS, Piece, hull_piece
from hdplan.planner.geometry.cells import Cells, cells_of
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.fixed_array import FixedArray

CELL = 0.05  # [m] edge of the cubes whose balls make a piece: a tenth of a link's length, some tens of points
THIN = 1e-6  # [m] the least size of a box that coal gets: it only proposes directions
ROOM = 1e-12  # share by which boxes are larger, for rounding


def standing_pieces(balls: FixedArray) -> Iterator[tuple[Piece, Array]]:
    """Yield pieces that contain the balls (m, 4), centres and radii [m], each with its frame (4, 4) in theirs."""
    for frame, half, grains in _boxes(balls, cells_of(balls, CELL)):
        radius, shape = float(grains[:, 3].max()), coal.Box(*np.maximum(2.0 * half, THIN))
        shape.setSweptSphereRadius(radius)
        yield Piece(2.0 * half * CORNERS, shape, radius, grains=grains), frame


def moving_pieces(balls: FixedArray) -> Iterator[Piece]:
    """Yield the same pieces in the frame of the balls."""
    for frame, half, grains in _boxes(balls, cells_of(balls, CELL)):
        corners = (2.0 * half * CORNERS) @ frame[:3, :3].T + frame[:3, 3]
        back = np.column_stack([grains[:, :3] @ frame[:3, :3].T + frame[:3, 3], grains[:, 3]])
        radius = float(grains[:, 3].max()) + ROOM * float(np.abs(corners).max())  # turned there and back
        shape = hull_piece(corners).shape
        shape.setSweptSphereRadius(radius)
        yield Piece(corners, shape, radius, grains=back)


def _boxes(balls: FixedArray, cells: Cells) -> Iterator[tuple[Array, Array, Array]]:
    """Yield each group's frame (4, 4), half the size (3,) of a box around its centres, and its balls in that frame."""
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
    half = 0.5 * (high - low) + ROOM * np.abs(local).max()
    grains = np.column_stack([local - np.repeat(middle, sizes, axis=0), found[:, 3]])
    frames = np.tile(np.eye(4), (len(sizes), 1, 1))
    frames[:, :3, :3], frames[:, :3, 3] = cells.rotation, np.einsum("cij,cj->ci", cells.rotation, middle)
    for c in range(len(sizes)):
        yield frames[c], half[c], grains[ends[c] : ends[c + 1]]
