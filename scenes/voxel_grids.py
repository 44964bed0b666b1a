"""Maps of occupied cells: voxel grids, and octomaps. The obstacle is the union of the occupied cells."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import ArrayLike

from hdplan.scenes.errors import FieldError
from hdplan.scenes.fixed_array import FixedArray, numbers_in
from hdplan.scenes.poses import AnyPose, Placement, Vector3
from hdplan.scenes.values import Checked, Choice, FilePath, Name, Number, Numbers, Row, absolute_path, describe

MOST_CELLS = 64_000_000  # of a grid, occupied or not


def grid_source(value: object) -> Path | FixedArray:
    """Return the file that holds a grid, as an absolute path, or the grid itself (x, y, z), true where occupied."""
    if isinstance(value, FixedArray):
        return value
    if isinstance(value, str | os.PathLike):
        return absolute_path(value)
    grid = numbers_in(value)
    if grid.ndim != 3 and not isinstance(value, np.ndarray):
        raise FieldError(f"must be a file, or a grid (x, y, z), found {describe(value)}", value=value)
    return FixedArray(checked_grid(grid))


def checked_grid(grid: np.ndarray) -> np.ndarray:
    """Return a grid (x, y, z) as booleans. Raises FieldError for another shape, other values than 0 and 1, one that is
    empty or too large."""
    if grid.dtype.kind not in "biuf" or grid.ndim != 3:
        raise FieldError(f"must be a grid (x, y, z) of 0 and 1, found an array of shape {grid.shape}")
    if grid.size > MOST_CELLS:
        raise FieldError(f"has {grid.size} cells; at most {MOST_CELLS} are used")
    found = grid.astype(bool)
    if not (grid == found).all():
        raise FieldError("must hold 0 (free) and 1 (occupied) only")
    if not found.any():
        raise FieldError("holds no occupied cell")
    return found


def map_source(value: object) -> Path | bytes:
    """Return an octomap's file, as an absolute path, or its content."""
    return value if isinstance(value, bytes) else absolute_path(value)


@dataclass(frozen=True, repr=False)
class Voxels(Checked):
    """A grid of cubes of edge `size` [m], from a file or an array (x, y, z) that is true where a cube is occupied;
    `origin` is the corner of the first cube with the least coordinates, in the grid's frame. In a scene's list of
    obstacles it may carry its own name and pose."""

    occupied: Annotated[Path | FixedArray, grid_source]
    size: Annotated[float, Number(above=0.0, unit="m")]
    origin: Annotated[Vector3, Row(Number(unit="m"), 3)] = (0.0, 0.0, 0.0)
    name: Name | None = field(default=None, kw_only=True)
    pose: Placement | None = field(default=None, kw_only=True)

    if TYPE_CHECKING:

        def __init__(
            self,
            occupied: FilePath | ArrayLike | FixedArray,
            size: float,
            origin: Numbers = (0.0, 0.0, 0.0),
            *,
            name: str | None = None,
            pose: AnyPose | None = None,
        ) -> None: ...


@dataclass(frozen=True, repr=False)
class OctoMap(Checked):
    """An octomap, by its file or that file's content: .bt (binary) or .ot (with probabilities, of which at least 0.5
    means occupied), in its own frame. Unknown space is free, or with `unknown: occupied` an obstacle within the box
    around all known cells. In a scene's list of obstacles it may carry its own name and pose."""

    source: Annotated[Path | bytes, map_source]
    unknown: Annotated[str, Choice(("free", "occupied"))] = "free"
    name: Name | None = field(default=None, kw_only=True)
    pose: Placement | None = field(default=None, kw_only=True)

    if TYPE_CHECKING:

        def __init__(
            self,
            source: FilePath | bytes,
            unknown: str = "free",
            *,
            name: str | None = None,
            pose: AnyPose | None = None,
        ) -> None: ...


Map = Voxels | OctoMap
