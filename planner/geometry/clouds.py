"""Clouds of points as balls, unchanged or merged for planning.

Merging never makes the obstacle smaller: the balls of points in one cube of edge `voxel` become one ball, about the
middle of the points' bounding box, that contains them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from hdplan.planner.geometry.cells import grouped
from hdplan.planner.geometry.cloud_files import read_points
from hdplan.planner.geometry.depth_images import balls_of
from hdplan.planner.geometry.drawn_shapes import boxes_mesh
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.errors import FieldError, InputError, naming
from hdplan.scenes.files import Stamps, stamps_of
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.once import made_once

MOST_BOXES = 4000  # drawn around a cloud's points


def read_cloud(cloud: Cloud, where: str) -> Cloud:
    """Return a cloud with its points and radii in memory, read from its file or worked out from its depth image; itself
    if they are. `where` is its field in the scene, for error messages.

    How many points were left out in reading stands in `left_out`. Raises InputError for a file that is missing, damaged
    or empty, and for points that are not finite.
    """
    source = cloud.points
    if isinstance(source, FixedArray):
        return cloud
    if isinstance(source, DepthImage):
        with naming(f"{where}.depth: {source.image}"):
            files = [source.image] if isinstance(source.image, Path) else []
            balls = _swollen(balls_of(source, stamps_of(files)), cloud.radius)
            points, radii = _apart(balls, balls.left_out)
        return replace(cloud, points=points, radius=radii)
    with naming(f"{where}.cloud: {source}"):
        points, radius = _read(source, cloud.radius, cloud.drop_nan, stamps_of([source]))
    return replace(cloud, points=points, radius=radius)


def balls_in(cloud: Cloud) -> FixedArray:
    """Return the balls (m, 4) of a cloud that was read: centres in its frame, and radii [m]."""
    if not isinstance(cloud.points, FixedArray):
        raise TypeError("a cloud is read before it is used: planner.geometry.opened")
    return _balls(cloud.points, cloud.radius)


@made_once(4)
def _read(
    file: Path, radius: float | FixedArray, drop_nan: bool, stamps: Stamps
) -> tuple[FixedArray, float | FixedArray]:
    """Read points and radii; the stamps make a file that was written again another one."""
    found = read_points(file)
    try:
        cloud = Cloud(found, radius, drop_nan=drop_nan)
    except FieldError as error:
        raise InputError(error.problem if error.where == "points" else f"{error.where}: {error.problem}") from None
    assert isinstance(cloud.points, FixedArray)
    return cloud.points, cloud.radius


@made_once(4)
def _apart(balls: FixedArray, left_out: int) -> tuple[FixedArray, FixedArray]:
    """Return the centres, of which some were left out, and the radii of balls (m, 4)."""
    return FixedArray(balls.array[:, :3], left_out), FixedArray(balls.array[:, 3])


@made_once(4)
def _balls(points: FixedArray, radius: float | FixedArray) -> FixedArray:
    own = radius.array if isinstance(radius, FixedArray) else np.full(len(points), radius)
    return FixedArray(np.column_stack([points.array, own]), points.left_out)


@made_once(4)
def _swollen(balls: FixedArray, radius: float | FixedArray) -> FixedArray:
    """Return the balls, each larger by `radius` [m]."""
    return FixedArray(balls.array + [0.0, 0.0, 0.0, radius], balls.left_out) if radius else balls


def left_out_words(requested: Cloud, read: Cloud) -> str:
    """Return a note on the points of a cloud that were left out in reading: those that are not finite, or pixels out of
    an image's range; empty if none were."""
    count = read.points.left_out if isinstance(read.points, FixedArray) else 0
    if not count:
        return ""
    if not isinstance(requested.points, DepthImage):
        return f"{count} that are not finite"
    low, high = requested.points.range
    return f"{count} pixels that saw something nearer than {low:g} m or farther than {high:g} m"


@made_once(4)
def merged(balls: FixedArray, voxel: float) -> tuple[FixedArray, float]:
    """Return balls (k, 4) that contain the given ones (m, 4), one for each cube of edge `voxel` [m]; and by how much
    the largest of them is larger than those inside it [m]."""
    given = balls.array
    order, first = grouped(given[:, :3], voxel)
    found = given[order]
    sizes = np.diff(np.append(first, len(order)))
    middle = 0.5 * (np.minimum.reduceat(found, first) + np.maximum.reduceat(found, first))[:, :3]
    away = np.linalg.norm(found[:, :3] - np.repeat(middle, sizes, axis=0), axis=1)
    radius = np.maximum.reduceat(away + found[:, 3], first) * _RADIUS_FACTOR
    added = float((radius - np.minimum.reduceat(found[:, 3], first)).max())
    return FixedArray(np.column_stack([middle, radius])), added


def cloud_words(requested: Cloud, read: Cloud) -> str:
    """Return the words of `hdplan explain` for a cloud, as the scene has it and as it was read."""
    source = requested.points.image if isinstance(requested.points, DepthImage) else requested.points
    file = f" of {source.name}" if isinstance(source, Path) else ""
    balls = balls_in(read)
    low, high = 1e3 * float(balls.array[:, 3].min()), 1e3 * float(balls.array[:, 3].max())
    size = f"{low:.3g} mm" if low == high else f"{low:.3g} to {high:.3g} mm"
    return f"cloud{file}, {len(balls)} points as balls of {size}"


def reach(balls: Array) -> float:
    """Return the reach of balls (m, 4) from their frame's origin along an axis [m]."""
    return float((np.abs(balls[:, :3]).max(axis=1) + balls[:, 3]).max())


def drawn_boxes(balls: FixedArray) -> tuple[Array, Rows]:
    """Return boxes around groups of the balls (m, 4), for pictures: vertices [m] and triangles, outward."""
    given = balls.array
    edge = 2.0 * float(given[:, 3].min())
    while True:
        order, first = grouped(given[:, :3], edge)
        if len(first) <= MOST_BOXES:
            break
        edge *= 1.25
    return boxes_mesh(*_bounds(given[order], first))


def part_bounds(balls: FixedArray, edge: float) -> Array:
    """Return the lower and upper corners (k, 2, 3) of boxes around the balls (m, 4) in each cube of this edge [m]."""
    order, first = grouped(balls.array[:, :3], edge)
    return np.stack(_bounds(balls.array[order], first), axis=1)


def _bounds(balls: Array, first: Rows) -> tuple[Array, Array]:
    """Return the lower and upper corners (k, 3) of boxes around groups of balls, each of which begins at `first`."""
    radius = balls[:, 3, None]
    low = np.minimum.reduceat(balls[:, :3] - radius, first)
    return low, np.maximum.reduceat(balls[:, :3] + radius, first)


_RADIUS_FACTOR = 1.0 + 1e-12  # so that rounding makes no ball too small
