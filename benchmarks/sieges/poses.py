"""Placements by SciPy's formulas: URDF's angles, quaternions, turns about an axis. All (..., 4, 4)."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hdplan.scenes.array_types import Array


def turn(axis: Array, angle: Array) -> Array:
    """Return rotations (T, 3, 3) about an axis (3,) by angles (T,) times its length."""
    return np.asarray(Rotation.from_rotvec(np.multiply.outer(angle, axis)).as_matrix())


def from_rpy(xyz: Any, rpy: Any) -> Array:
    """Return the placement of URDF's origin: turns about the fixed axes x, y, z, one after the other."""
    return _placed(xyz, Rotation.from_euler("xyz", np.array(rpy, dtype=float)))


def from_quaternion(xyz: Any, xyzw: Any) -> Array:
    """Return the placement of a position and a quaternion x, y, z, w of any length."""
    return _placed(xyz, Rotation.from_quat(np.array(xyzw, dtype=float)))


def of_scene(pose: dict[str, Any] | None) -> Array:
    """Return the placement that a hdplan scene writes."""
    pose = pose or {}
    place = pose.get("position", [0, 0, 0])
    if "quaternion_xyzw" in pose:
        return from_quaternion(place, pose["quaternion_xyzw"])
    return from_rpy(place, pose.get("rpy", [0, 0, 0]))


def vector_of(rotation: Array) -> Array:
    """Return the rotation vector (3,) of a rotation (3, 3), at most π long."""
    return np.asarray(Rotation.from_matrix(rotation).as_rotvec())


def quaternion_of(rotation: Array) -> list[float]:
    """Return the quaternion x, y, z, w of a rotation (3, 3)."""
    return [float(value) for value in Rotation.from_matrix(rotation).as_quat()]


def _placed(xyz: Any, rotation: Any) -> Array:
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation.as_matrix(), np.array(xyz, dtype=float)
    return placement
