"""Data of sensors, whatever their source, for pictures and in words: clouds of points, octomaps and voxel grids."""

from __future__ import annotations

from typing import assert_never, cast

import numpy as np

from hdplan.planner.geometry.clouds import balls_in, cloud_words, drawn_boxes, part_bounds
from hdplan.planner.geometry.drawn_shapes import boxes_mesh
from hdplan.planner.geometry.voxel_grids import boxes_in, map_words
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.obstacles import Seen
from hdplan.scenes.voxel_grids import OctoMap, Voxels

PART_EDGE = 0.1  # [m] edge of the parts of a cloud that may hide what is behind them


def seen_mesh(shape: Seen) -> tuple[Array, Rows]:
    """Return boxes: around a cloud's points, or those of a map. Vertices (m, 3) [m] and triangles, outward."""
    match shape:
        case Cloud():
            return drawn_boxes(balls_in(shape))
        case Voxels() | OctoMap():
            boxes = boxes_in(shape).array
            return boxes_mesh(boxes[:, :3], boxes[:, 3:])
        case _:
            assert_never(shape)


def seen_parts(shape: Seen) -> Array:
    """Return boxes around its parts: lower and upper corners (k, 2, 3) [m]."""
    match shape:
        case Cloud():
            return part_bounds(balls_in(shape), PART_EDGE)
        case Voxels() | OctoMap():
            boxes = boxes_in(shape).array
            return np.stack([boxes[:, :3], boxes[:, 3:]], axis=1)
        case _:
            assert_never(shape)


def seen_words(requested: Seen, read: Seen) -> str:
    """Return the words of `hdplan explain` for it, as the scene has it and as it was read."""
    match requested:
        case Cloud():
            return cloud_words(requested, cast(Cloud, read))
        case Voxels() | OctoMap():
            return map_words(requested)
        case _:
            assert_never(requested)
