"""Depth images as balls, which enclose the surface that each pixel saw.

A pixel at p, with neighbours on the same surface at p ± a along a row and p ± b along a column, sees the parallelogram
p ± a/2 ± b/2, and parallelograms of neighbours leave no hole between them. Its ball contains it:

    r = ½ √(|a|² + |b|² + 2 |a·b|)

with a of either side, and so with b: the largest of the four counts. Where one side has no such neighbour the other's
way is taken; without both the surface is taken to face the camera, with a = (z/fx, 0, 0) and b = (0, z/fy, 0). Two
pixels whose depths differ by more than STEEPEST_STEP times z/fx, or z/fy, with the smaller z, are not of one surface:
there is an edge between them, and nothing was seen there.

How steep that is counts from the ray, not from the picture: the way between the two pixels is w e + Δz d, with w = z/fx
of the nearer one, e = (1, 0, 0) and d = (s, t, 1) the ray of the farther one. For |Δz| = STEEPEST_STEP w its angle with
the ray is atan(√(1 + t²) / (STEEPEST_STEP |d|² ± s)), 11.5° at most, wherever in the picture. So a surface whose normal
is inclined against the rays by up to 78.5° is one surface.
"""

from __future__ import annotations

import io
import itertools
from pathlib import Path

import numpy as np

from hdplan.planner.geometry.data_files import numpy_readers, read_by_ending
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.depth_images import DepthImage
from hdplan.scenes.errors import InputError
from hdplan.scenes.files import Stamps
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.once import made_once

ROUNDING_FACTOR = 1.0 + 1e-12  # by which depths may be beyond the range, and steps steeper, as they are rounded
STEEPEST_STEP = 5.0  # step in depth over a pixel's width: an inclination of 78.5° against the ray
RADIUS_FACTOR = 1.0 + 1e-12  # so that rounding makes no ball too small
MOST_PIXELS = 20_000_000  # of an image: a larger one would fill the memory


@made_once(4)
def balls_of(depth: DepthImage, stamps: Stamps) -> FixedArray:
    """Return the balls (m, 4) of an image, in the camera's optical frame [m]; the stamps make a file that was written
    again another one. Raises InputError for a file that is missing, damaged or empty."""
    image = depth.image.array if isinstance(depth.image, FixedArray) else read_image(depth.image)
    fx, fy, cx, cy = depth.intrinsics
    z = depth.scale * image
    low, high = depth.range
    with np.errstate(invalid="ignore"):
        measured = (image > 0.0) & (z < np.inf)
        seen = measured & (z * ROUNDING_FACTOR >= low) & (z <= high * ROUNDING_FACTOR)
    if not seen.any():
        raise InputError(f"has no pixel from {low:g} to {high:g} m: is its scale {depth.scale:g} m?")
    height, width = image.shape
    z = np.where(seen, z, 0.0)
    place = np.stack([(np.arange(width) - cx) / fx * z, ((np.arange(height) - cy) / fy)[:, None] * z, z], axis=2)
    along = _ways(place, seen, 1, np.stack([z / fx, 0.0 * z, 0.0 * z], axis=2))
    down = _ways(place, seen, 0, np.stack([0.0 * z, z / fy, 0.0 * z], axis=2))
    squares = np.zeros(np.count_nonzero(seen))
    for a, b in itertools.product(along, down):
        square = (a**2).sum(axis=1) + (b**2).sum(axis=1) + 2.0 * np.abs((a * b).sum(axis=1))
        squares = np.maximum(squares, square)
    out_of_range = int(np.count_nonzero(measured & ~seen))
    return FixedArray(np.column_stack([place[seen], 0.5 * np.sqrt(squares) * RADIUS_FACTOR]), out_of_range)


def _ways(place: Array, seen: Mask, axis: int, facing: Array) -> tuple[Array, Array]:
    """Return the ways (m, 3) from what was seen to its neighbours on the same surface along an axis, of both sides: the
    other one's where there is none; `facing` where there is none on either side."""
    one, other = (slice(None),) * axis + (slice(None, -1),), (slice(None),) * axis + (slice(1, None),)
    step = place[other] - place[one]
    across = facing.max(axis=2)
    steep = STEEPEST_STEP * ROUNDING_FACTOR * np.minimum(across[one], across[other])
    joined = seen[one] & seen[other] & (np.abs(step[..., 2]) <= steep)
    before, after = facing.copy(), facing.copy()
    for way, last in ((before, other), (after, one)):
        for side in (other if last is one else one, last):  # the last one counts
            way[side][joined] = step[joined]
    return before[seen], after[seen]


def read_image(path: Path) -> Array:
    """Read an image (h, w) of depths, in the file's unit. Raises InputError for a file that is missing, damaged or not
    of one channel."""
    image = np.asarray(read_by_ending(path, FORMATS))
    if image.dtype.kind not in "iuf" or image.ndim != 2 or not image.size:
        raise InputError(
            f"holds an array of shape {image.shape} and type {image.dtype}; a depth image (h, w) is needed"
        )
    return image.astype(np.float64)


def _png(data: bytes, _: Path) -> Array:
    try:
        from PIL import Image
    except ImportError:
        raise InputError(".png files need pillow, which is not installed: pip install pillow") from None
    if _PNG_END not in data:  # Pillow would read what there is
        raise InputError("cannot be read, it is cut short")
    with Image.open(io.BytesIO(data), formats=["PNG"]) as image:
        if image.width * image.height > MOST_PIXELS:
            raise InputError(f"has {image.width} × {image.height} pixels; at most {MOST_PIXELS} are used")
        if image.mode not in ("I;16", "I;16B", "I", "L"):
            raise InputError(f"is a picture of mode {image.mode}; a depth image has one channel, mostly of 16 bits")
        return np.asarray(image)


_PNG_END = b"IEND\xaeB\x60\x82"
FORMATS = {"png": _png, **numpy_readers("depth", "image")}
