"""Poses given by a user: rigid transforms world from body, as finite arrays of the right shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hdplan.scenes.errors import InputError

Array = NDArray[np.float64]

RIGID = 2e-6  # what may be amiss in a rotation: its entries' decimals were cut at the sixth, or it was a float32


def check_poses(name: str, poses: ArrayLike) -> Array:
    """Return poses (..., 4, 4); raises InputError for another shape and for numbers that are not finite."""
    return _check(name, poses, None, "(..., 4, 4)")


def check_pose(name: str, pose: ArrayLike) -> Array:
    """Return one pose (4, 4); raises InputError for another shape and for numbers that are not finite."""
    return _check(name, pose, 2, "(4, 4)")


def check_pose_lists(poses_a: ArrayLike, poses_b: ArrayLike) -> tuple[Array, Array]:
    """Return two lists of poses (N, 4, 4); raises InputError as ``check_pose``, and for lists of unequal length."""
    lists = _check("poses_a", poses_a, 3, "(N, 4, 4)"), _check("poses_b", poses_b, 3, "(N, 4, 4)")
    count, other = map(len, lists)
    if count != other:
        raise InputError(f"poses_b: found {other} poses, allowed are as many as poses_a has: {count}")
    return lists


def _check(name: str, poses: ArrayLike, axes: int | None, allowed: str) -> Array:
    array = np.asarray(poses, dtype=float)
    if array.ndim != (axes or array.ndim) or array.shape[-2:] != (4, 4) or not np.isfinite(array).all():
        raise InputError(f"{name}: found an array of shape {array.shape}, allowed is a finite array {allowed}")
    return array
