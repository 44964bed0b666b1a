"""Depth images: what a camera measured along each pixel, from a file or an array."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import ArrayLike

from hdplan.scenes.errors import FieldError
from hdplan.scenes.fixed_array import FixedArray, numbers_in
from hdplan.scenes.values import Checked, FilePath, Number, Numbers, Row, absolute_path, describe

Length = Number(low=0.0, unit="m")


def image_source(value: object) -> Path | FixedArray:
    """Return the file that holds an image, as an absolute path, or the image itself (h, w)."""
    if isinstance(value, FixedArray):
        return value
    if isinstance(value, str | os.PathLike):
        return absolute_path(value)
    image = numbers_in(value)
    if image.dtype.kind not in "iuf" or image.ndim != 2 or not image.size:
        raise FieldError(f"must be a file, or an image (h, w), found {describe(value)}", value=value)
    return FixedArray(image.astype(np.float64))


def pinhole(value: object) -> tuple[float, ...]:
    """Return the intrinsics fx, fy, cx, cy of a camera [pixels], as its calibration gives them."""
    row = Row(Number(unit="pixels"), 4)(value)
    for place, name in enumerate(("fx", "fy")):
        if not row[place] > 0.0:
            raise FieldError(f"{name} must be greater than 0 [pixels], found {row[place]:g}", value=value)
    return row


def measured(value: object) -> tuple[float, ...]:
    """Return the least and the greatest depth [m] that counts."""
    low, high = Row(Length, 2)(value)
    if not low < high:
        raise FieldError(f"must be two depths [m], the first smaller, found {low:g} and {high:g}", value=value)
    return low, high


@dataclass(frozen=True, repr=False)
class DepthImage(Checked):
    """A depth image (h, w): along pixel (u, v), column and row, something was seen at depth z = `scale` × its value, at
    the point ((u − cx) z / fx, (v − cy) z / fy, z) of the camera's optical frame (x right, y down, z ahead). A value of
    0 or NaN, or a depth out of `range`, means that nothing was seen."""

    image: Annotated[Path | FixedArray, image_source]
    intrinsics: Annotated[tuple[float, float, float, float], pinhole]  # fx, fy, cx, cy [pixels]
    scale: Annotated[float, Number(above=0.0, unit="m")] = 0.001  # of one unit of the image's values [m]
    range: Annotated[tuple[float, float], measured] = (0.1, 3.0)  # [m]

    if TYPE_CHECKING:

        def __init__(
            self,
            image: FilePath | ArrayLike | FixedArray,
            intrinsics: Numbers,
            scale: float = 0.001,
            range: Numbers = (0.1, 3.0),
        ) -> None: ...
