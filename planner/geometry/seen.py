"""What was seen, whatever it came from, for pictures and in words: clouds of points, octomaps and voxel grids."""

from __future__ import annotations

from typing import assert_never

import numpy as np

from hdplan.planner.geometry.clouds import boxes_mesh, cloud_words, drawn_boxes, load_balls, part_bounds
from hdplan.planner.geometry.voxel_grids import load_boxes, map_words
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.obstacles import Seen
from hdplan.scenes.voxel_grids import OctoMap, Voxels

PART = 0.1  # [m] edge of the parts of a cloud that may hide what is behind them


def seen_mesh(shape: Seen, field: str) -> tuple[Array, Rows]:
    """Return boxes: around a cloud's points, or those of a map. Vertices (m, 3) [m] and triangles, outward. Raises
    InputError for files that cannot be used."""
    match shape:
        case Cloud():
            return drawn_boxes(load_balls(shape, field))
        case Voxels() | OctoMap():
            boxes = load_boxes(shape, field).array
            return boxes_mesh(boxes[:, :3], boxes[:, 3:])
        case _:
            assert_never(shape)


def seen_parts(shape: Seen, field: str) -> Array:
    """Return boxes around its parts: lower and upper corners (k, 2, 3) [m]. Raises InputError as `seen_mesh`."""
    match shape:
        case Cloud():
            return part_bounds(load_balls(shape, field), PART)
        case Voxels() | OctoMap():
            boxes = load_boxes(shape, field).array
            return np.stack([boxes[:, :3], boxes[:, 3:]], axis=1)
        case _:
            assert_never(shape)


def seen_words(shape: Seen, field: str) -> str:
    """Return what `hdplan explain` says of it. Raises InputError as `seen_mesh`."""
    match shape:
        case Cloud():
            return cloud_words(shape, field)
        case Voxels() | OctoMap():
            return map_words(shape, field)
        case _:
            assert_never(shape)
