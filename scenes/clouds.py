"""Clouds of points, as cameras see them: each point is a ball, and the obstacle is the union of the balls."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.errors import FieldError
from hdplan.scenes.fixed_array import FixedArray, numbers_in
from hdplan.scenes.poses import AnyPose, Placement
from hdplan.scenes.values import (
    LARGEST_NUMBER,
    Checked,
    FilePath,
    Maybe,
    Name,
    Number,
    absolute_path,
    boolean,
    checked,
    describe,
    is_row,
    wrong,
)

MOST_POINTS = 5_000_000  # at most: what is prepared for them stays below some gigabytes
RADIUS = Number(low=0.0, high=1.0, unit="m")
Margin = Annotated[float, Number(low=0.0, high=1.0, unit="m")]


def finite_points(points: NDArray[Any], drop_nan: bool) -> NDArray[np.float64]:
    """Return the points (m, 3) all of whose coordinates are finite. Raises FieldError if none is left, if one is
    farther away than LARGEST_NUMBER and, unless `drop_nan`, for those that are not finite: cameras mark so what they
    did not see."""
    points = points.astype(np.float64, copy=False)
    seen = np.isfinite(points).all(axis=1)
    unseen = len(seen) - int(np.count_nonzero(seen))
    if unseen and not drop_nan:
        raise FieldError(
            f"{unseen} of {len(points)} points are not finite (NaN or infinite); `drop_nan: true` leaves them out"
        )
    points = points[seen] if unseen else points
    if not len(points):
        raise FieldError("holds no points")
    if len(points) > MOST_POINTS:
        raise FieldError(f"has {len(points)} points; at most {MOST_POINTS} are used")
    if (farthest := float(np.abs(points).max())) > LARGEST_NUMBER:
        raise FieldError(f"reaches as far as {farthest:g} m; at most {LARGEST_NUMBER:g} m are allowed")
    return points


def point_source(value: object) -> Path | FixedArray | DepthImage:
    """Return the file that holds points, as an absolute path, or the points themselves (m, 3), or what shows them."""
    if isinstance(value, FixedArray | DepthImage):
        return value
    if isinstance(value, str | os.PathLike):
        return absolute_path(value)
    points = numbers_in(value)
    if points.dtype.kind not in "iuf" or points.ndim != 2 or points.shape[1] != 3:
        raise FieldError(f"must be a file, points (m, 3) [m] or a DepthImage, found {describe(value)}", value=value)
    return FixedArray(points.astype(np.float64))


def radius_of(value: object) -> float | FixedArray:
    """Return the radius of all balls [m], or one for each point (m,), as an array."""
    if isinstance(value, FixedArray):
        return value
    if not is_row(value):
        return RADIUS(value)
    radii = numbers_in(value)
    if not len(radii) or radii.dtype.kind not in "iuf" or radii.ndim != 1:
        raise FieldError(f"must be a number, or one for each point (m,) [m], found {describe(value)}", value=value)
    if wrong_ones := [each for each in radii.tolist() if not 0.0 < each <= RADIUS.high]:
        raise wrong("greater than 0 and at most 1 [m]", wrong_ones[0])
    return FixedArray(radii.astype(np.float64))


def check_count(radius: float | FixedArray, count: int) -> None:
    """Refuse radii that are not as many as the points."""
    if isinstance(radius, FixedArray) and len(radius) != count:
        raise FieldError(f"must be one number, or as many as the {count} points, found {len(radius)}", "radius")


def ignored_of(value: object) -> tuple[Ignored, ...]:
    """Return the things around which points are left out: one, or a list of them."""
    if isinstance(value, Ignored):
        return (value,)
    if not is_row(value):
        raise wrong("of the class Ignored, or a list of these", value)
    for i, each in enumerate(value):
        if not isinstance(each, Ignored):
            raise wrong("of the class Ignored", each).within(f"[{i}]")
    return tuple(value)


@dataclass(frozen=True, repr=False)
class Ignored(Checked):
    """A rule that leaves out the points within `margin` [m] of one link (or held object) at the start, or of another
    obstacle: they are the image of a body that the scene models itself."""

    margin: Margin
    link: Name | None = None
    obstacle: Name | None = None

    def _check_whole(self) -> None:
        if (self.link is None) == (self.obstacle is None):
            raise FieldError("needs either a link or an obstacle")


@dataclass(frozen=True, repr=False)
class Cloud(Checked):
    """Points [m] in its frame, from a file, an array or a depth image: the obstacle is the union of the balls of
    `radius` [m] about them; each may have its own. In a scene's list of obstacles it may carry its own name and pose.

    The frame of a depth image is the camera's optical frame; the balls of its pixels cover the surfaces that they saw,
    and `radius`, 0 by default, is added to their radii.
    """

    points: Annotated[Path | FixedArray | DepthImage, point_source]
    radius: Annotated[float | FixedArray, radius_of] = 0.0
    voxel: Annotated[float | None, Maybe(Number(above=0.0, high=1.0, unit="m"))] = None
    # the planner takes points in one cube of this edge [m] for one larger ball; the certificate takes every point
    drop_nan: Annotated[bool, boolean] = False  # leave points out that are not finite; otherwise they are refused
    ignore_robot: Margin = 0.0
    # points within this distance [m] of the robot, or of what it holds, at the start are its own image: left out
    ignore: Annotated[tuple[Ignored, ...], ignored_of] = ()
    name: Name | None = field(default=None, kw_only=True)
    pose: Placement | None = field(default=None, kw_only=True)

    if TYPE_CHECKING:

        def __init__(
            self,
            points: FilePath | ArrayLike | FixedArray | DepthImage,
            radius: float | ArrayLike | FixedArray = 0.0,
            voxel: float | None = None,
            drop_nan: bool = False,
            ignore_robot: float = 0.0,
            ignore: Ignored | Sequence[Ignored] = (),
            *,
            name: str | None = None,
            pose: AnyPose | None = None,
        ) -> None: ...

    def _check_whole(self) -> None:
        if isinstance(self.points, DepthImage):
            if isinstance(self.radius, FixedArray):
                raise FieldError("must be one number, added to the radii of an image's pixels", "radius")
        elif self.radius == 0.0:
            raise FieldError("is needed: the radius [m] of the ball that each point stands for", "radius")
        if isinstance(self.points, FixedArray):
            given = self.points.array
            check_count(self.radius, len(given))
            kept = checked(lambda points: finite_points(points, self.drop_nan), given, "points")
            if len(kept) < len(given):
                object.__setattr__(self, "points", FixedArray(kept, len(given) - len(kept)))
                if isinstance(self.radius, FixedArray):
                    seen = np.isfinite(given).all(axis=1)
                    object.__setattr__(self, "radius", FixedArray(self.radius.array[seen]))
