"""Voxel grids and octomaps as boxes: exactly their occupied cells, merged to few boxes by runs along the axes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import assert_never

import numpy as np

from hdplan.planner.geometry.data_files import numpy_readers, read_by_ending
from hdplan.planner.geometry.octomap_files import DEPTH, read_octomap
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.errors import FieldError, InputError, naming
from hdplan.scenes.files import Stamps, read_file, stamps_of
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.once import made_once
from hdplan.scenes.voxel_grids import MOST_CELLS, Map, OctoMap, Voxels, checked_grid


def read_map(shape: Map, where: str) -> Map:
    """Return a map with its cells in memory, itself if they are. `where` is its field in the scene, for error messages.

    Raises InputError for a file that is missing, damaged, too large or without an occupied cell, and for such content.
    """
    kind, source = _kind_and_source(shape)
    field = f"{where}.{kind}"
    with naming(f"{field}: {source}" if isinstance(source, Path) else field):
        read = _read_map(shape, stamps_of([source])) if isinstance(source, Path) else shape
        boxes_in(read)
    return read


@made_once(8)
def _read_map(shape: Map, stamps: Stamps) -> Map:
    """Read a file; the stamps make a file that was written again another one."""
    match shape:
        case OctoMap(Path() as file):
            return replace(shape, source=read_file(file))
        case Voxels(Path() as file):
            return replace(shape, occupied=FixedArray(_read(file)))
        case _:
            raise TypeError(f"a {type(shape).__name__} is not a map with a file")


def map_words(shape: Map) -> str:
    """Return the words of `hdplan explain` for a map, as the scene has it."""
    kind, source = _kind_and_source(shape)
    return f"{kind}{f' of {source.name}' if isinstance(source, Path) else ''}"


def _kind_and_source(shape: Map) -> tuple[str, Path | bytes | FixedArray]:
    match shape:
        case OctoMap(source):
            return "octomap", source
        case Voxels(occupied):
            return "voxels", occupied
        case _:
            assert_never(shape)


@made_once(8)
def boxes_in(shape: Map) -> FixedArray:
    """Return the boxes (k, 6) of which a map that was read is the union: lower and upper corners [m] in its frame.

    Raises InputError for an octomap's content that is damaged, too large or without an occupied cell.
    """
    match shape:
        case OctoMap(bytes()):
            grid, size, origin = _of_octomap(shape)
        case Voxels(FixedArray() as source):
            grid, size, origin = source.array.astype(bool), shape.size, np.array(shape.origin)
        case _:
            raise TypeError(f"{type(shape).__name__}: a map is read before it is used (planner.geometry.opened)")
    low, high = merged(grid)
    return FixedArray(np.hstack([origin + size * low, origin + size * high]))


def merged(grid: Mask) -> tuple[Rows, Rows]:
    """Return boxes of cells that cover exactly the true ones of a grid (x, y, z), each once: lower and upper corners
    (k, 3). Runs along z are joined along y where they are the same, and then along x."""
    padded = np.zeros((*grid.shape[:2], grid.shape[2] + 2), dtype=np.int8)
    padded[:, :, 1:-1] = grid
    change = np.diff(padded, axis=2)
    begin, end = np.argwhere(change == 1), np.argwhere(change == -1)
    low, high = begin, np.column_stack([begin[:, :2] + 1, end[:, 2]])
    for axis, others in ((1, (0, 2)), (0, (1, 2))):
        order = np.lexsort((low[:, axis], *(side[:, other] for other in others for side in (low, high))))
        low, high = low[order], high[order]
        same = (low[1:, others] == low[:-1, others]).all(axis=1) & (high[1:, others] == high[:-1, others]).all(axis=1)
        follows = same & (low[1:, axis] == high[:-1, axis])
        first = np.flatnonzero(np.concatenate([[True], ~follows]))
        last = np.append(first[1:], len(low)) - 1
        low, high = low[first], np.where(np.arange(3) == axis, high[last], high[first])
    return low, high


def _of_octomap(shape: OctoMap) -> tuple[Mask, float, Array]:
    """Return the grid of an octomap around its occupied cells, or around all that it knows, the edge of its cells [m]
    and its lower corner."""
    if isinstance(shape.source, Path):
        raise TypeError("a map is read before it is used: planner.geometry.opened")
    leaves = read_octomap(shape.source)
    free = shape.unknown == "free"
    shown = leaves.occupied if free else np.ones(len(leaves.size), dtype=bool)
    if not shown.any():
        raise InputError("holds no occupied cell")
    low, high = leaves.low[shown], leaves.low[shown] + leaves.size[shown, None]
    corner, extent = low.min(axis=0), high.max(axis=0) - low.min(axis=0)
    if (cells := int(np.prod(extent))) > MOST_CELLS:
        raise InputError(f"spans {' × '.join(map(str, extent))} cells; at most {MOST_CELLS} are used, not {cells}")
    grid = np.full(extent, not free)
    for (x, y, z), (right, back, top), taken in zip(
        (low - corner).tolist(), (high - corner).tolist(), leaves.occupied[shown].tolist(), strict=True
    ):
        grid[x:right, y:back, z:top] = taken
    if not grid.any():
        raise InputError("holds no occupied cell, and knows all of its box")
    middle = 1 << (DEPTH - 1)  # the root is about the origin
    return grid, leaves.resolution, leaves.resolution * (corner - middle)


def _read(path: Path) -> np.ndarray:
    """Read a grid (x, y, z): the array `occupied`, or the only one."""
    try:
        return checked_grid(read_by_ending(path, FORMATS))
    except FieldError as error:
        raise InputError(error.problem) from None


FORMATS = numpy_readers("occupied", "grid")
