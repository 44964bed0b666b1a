"""Poses given by a user: rigid transforms world from body, as finite arrays of the right shape.

Poses that are not rigid are refused, and the first one is named: a scaled or mirrored body could seem separated where
it overlaps. In bulk the check takes about 20 ns per pose, for a single pose 2 µs.
"""

from __future__ import annotations

from math import prod

import numpy as np
from numpy.typing import ArrayLike

from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

RIGID_ERROR = 1e-5  # error allowed in a rotation, which may be rounded to six decimals or a product in float32
FARTHEST_POSE = 1e100  # [m] beyond, squares overflow
FEW_POSES = 12  # poses up to which plain numbers are faster than arrays
BLOCK = 4096  # poses at once, few enough for the processor's cache
NEXT, LAST = [1, 2, 0], [2, 0, 1]  # rows of a cross product's factors


def check_poses(name: str, poses: ArrayLike) -> Array:
    """Return poses (..., 4, 4) in float64; raises InputError for another shape, and names the first that is not finite
    or not rigid: columns of unit length at right angles, right-handed, and a last row 0 0 0 1, to ``RIGID``."""
    return _check(name, poses, None, "(..., 4, 4)")


def check_pose(name: str, pose: ArrayLike) -> Array:
    """Return one pose (4, 4); raises InputError as ``check_poses``."""
    return _check(name, pose, 2, "(4, 4)")


def check_pose_lists(poses_a: ArrayLike, poses_b: ArrayLike) -> tuple[Array, Array]:
    """Return two lists of poses (N, 4, 4); raises InputError as ``check_poses``, and for lists of unequal length."""
    lists = _check("poses_a", poses_a, 3, "(N, 4, 4)"), _check("poses_b", poses_b, 3, "(N, 4, 4)")
    count, other = map(len, lists)
    if count != other:
        raise InputError(f"poses_b: found {other} poses, allowed are as many as poses_a has: {count}")
    return lists


def placement_rows(poses: Array) -> Array:
    """Return poses (..., 4, 4) as rows (..., 12): the rotation row by row, then the origin."""
    return np.concatenate([poses[..., :3, :3].reshape(*poses.shape[:-2], 9), poses[..., :3, 3]], axis=-1)


def _check(name: str, poses: ArrayLike, axes: int | None, allowed: str) -> Array:
    try:
        array = np.asarray(poses)
        if array.dtype.kind in "cSU":
            raise TypeError
        array = array.astype(float, copy=False)
    except (TypeError, ValueError):
        raise InputError(f"{name}: not an array of numbers, allowed is an array {allowed}") from None
    if array.ndim != (axes or array.ndim) or array.shape[-2:] != (4, 4):
        raise InputError(f"{name}: found an array of shape {array.shape}, allowed is a finite array {allowed}")
    rows = array.reshape(-1, 16)
    for start in range(0, len(rows), BLOCK):
        block = rows[start : start + BLOCK]
        if not (_all_are_rigid(block) if len(block) > FEW_POSES else all(map(_one_is_rigid, block.tolist()))):
            number = start + next(k for k, row in enumerate(block.tolist()) if not _one_is_rigid(row))
            raise InputError(_what_is_wrong(name, array, number))
    return array


def _all_are_rigid(rows: Array) -> bool:
    """Return whether poses (N, 16), row by row, are rigid; NaN is not."""
    with np.errstate(invalid="ignore", over="ignore"):
        table = np.ascontiguousarray(rows.T).reshape(4, 4, -1)
        first, second, third = table[:3, :3]
        misses = first[NEXT] * second[LAST]
        misses -= first[LAST] * second[NEXT]
        misses -= third
        lengths = table[:2, :3]
        lengths = (lengths * lengths).sum(axis=1)
        lengths -= 1.0
        slants = (first * second).sum(axis=0)
        table[3, 3] -= 1.0
        return bool(
            np.abs(misses).max() <= RIGID_ERROR
            and np.abs(lengths).max() <= RIGID_ERROR
            and np.abs(slants).max() <= RIGID_ERROR
            and np.abs(table[3]).max() <= RIGID_ERROR
            and np.abs(table[:3, 3]).max() <= FARTHEST_POSE
        )


def _one_is_rigid(row: list[float]) -> bool:
    """Return whether one pose is rigid, without the overhead of arrays."""
    a, b, c, x, d, e, f, y, g, h, i, z, j, k, m, one = row
    return (
        abs(a * a + b * b + c * c - 1.0) <= RIGID_ERROR
        and abs(d * d + e * e + f * f - 1.0) <= RIGID_ERROR
        and abs(a * d + b * e + c * f) <= RIGID_ERROR
        and abs(b * f - c * e - g) <= RIGID_ERROR
        and abs(c * d - a * f - h) <= RIGID_ERROR
        and abs(a * e - b * d - i) <= RIGID_ERROR
        and abs(j) + abs(k) + abs(m) + abs(one - 1.0) <= RIGID_ERROR
        and abs(x) <= FARTHEST_POSE
        and abs(y) <= FARTHEST_POSE
        and abs(z) <= FARTHEST_POSE
    )


def _what_is_wrong(name: str, poses: Array, number: int) -> str:
    """Return the message on pose ``number`` of those in the array."""
    index = np.unravel_index(number, poses.shape[:-2]) if prod(poses.shape[:-2]) > 1 else ()
    where = f"{name}[{', '.join(map(str, index))}]" if index else name
    pose = poses.reshape(-1, 4, 4)[number]
    if not np.isfinite(pose).all():
        row, column = np.argwhere(~np.isfinite(pose))[0].tolist()
        return f"{where}: found {pose[row, column]} in row {row}, column {column}, allowed are finite numbers"
    if np.abs(pose[:3, 3]).max() > FARTHEST_POSE:
        return f"{where}: found a position of {pose[:3, 3].tolist()} m, allowed is up to {FARTHEST_POSE:g} m"
    if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > RIGID_ERROR:
        return f"{where}: found the last row {pose[3].tolist()}, allowed is [0, 0, 0, 1]"
    rotation = pose[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        lengths = np.sqrt(np.sum(rotation**2, axis=0)).tolist()
        turned = float(np.linalg.det(rotation))
    if turned < 0 and np.abs(np.array(lengths) - 1.0).max() <= RIGID_ERROR:
        return f"{where}: found a reflection (determinant {turned:.6g}), allowed is a rotation, of determinant 1"
    found = ", ".join(f"{length:.6g}" for length in lengths)
    return (
        f"{where}: found a rotation whose columns have lengths {found} and determinant {turned:.6g}, "
        f"allowed is a rigid transform: columns of length 1 at right angles"
    )
