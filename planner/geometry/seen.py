"""What was seen, whatever it came from, for pictures and in words: clouds of points, octomaps and voxel grids."""

from __future__ import annotations

import numpy as np

from hdplan.planner.geometry.clouds import balls_in, boxes_mesh, cloud_words, drawn_boxes, part_bounds
from hdplan.planner.geometry.voxel_grids import boxes_in, map_words
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.obstacles import Seen

PART = 0.1  # [m] edge of the parts of a cloud that may hide what is behind them


def seen_mesh(shape: Seen) -> tuple[Array, Rows]:
    """Return boxes: around a cloud's points, or those of a map. Vertices (m, 3) [m] and triangles, outward."""
    if isinstance(shape, Cloud):
        return drawn_boxes(balls_in(shape))
    boxes = boxes_in(shape).array
    return boxes_mesh(boxes[:, :3], boxes[:, 3:])


def seen_parts(shape: Seen) -> Array:
    """Return boxes around its parts: lower and upper corners (k, 2, 3) [m]."""
    if isinstance(shape, Cloud):
        return part_bounds(balls_in(shape), PART)
    boxes = boxes_in(shape).array
    return np.stack([boxes[:, :3], boxes[:, 3:]], axis=1)


def seen_words(asked: Seen, read: Seen) -> str:
    """Return what `hdplan explain` says of it, as it was asked for and as it was read."""
    if isinstance(asked, Cloud):
        assert isinstance(read, Cloud)
        return cloud_words(asked, read)
    return map_words(asked)
