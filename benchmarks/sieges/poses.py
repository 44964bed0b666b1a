"""Placements by the judge's own formulas: URDF's angles, quaternions, turns about an axis. All (..., 4, 4)."""

from __future__ import annotations

from typing import Any

import numpy as np

from hdplan.scenes.array_types import Array


def turn(axis: Array, angle: Array) -> Array:
    """Return rotations (T, 3, 3) about an axis (3,) by angles (T,): I + sin θ K + (1 − cos θ) K²."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, rest = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    turned: Array = np.eye(3) + sine * cross + rest * (cross @ cross)
    return turned


def from_rpy(xyz: Any, rpy: Any) -> Array:
    """Return the placement of URDF's origin: turns about the fixed axes x, y, z, one after the other."""
    roll, pitch, yaw = (
        turn(axis, np.array([angle]))[0] for axis, angle in zip(np.eye(3), map(float, rpy), strict=True)
    )
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = yaw @ pitch @ roll, [float(value) for value in xyz]
    return placement


def from_quaternion(xyz: Any, xyzw: Any) -> Array:
    """Return the placement of a position and a quaternion x, y, z, w of any length."""
    values = np.array([float(value) for value in xyzw])
    half = values / np.linalg.norm(values)
    sine = float(np.linalg.norm(half[:3]))
    axis = half[:3] / sine if sine > 0.0 else np.array([0.0, 0.0, 1.0])
    placement = np.eye(4)
    placement[:3, :3] = turn(axis, np.array([2.0 * np.arctan2(sine, half[3])]))[0]
    placement[:3, 3] = [float(value) for value in xyz]
    return placement


def of_scene(pose: dict[str, Any] | None) -> Array:
    """Return the placement that a hdplan scene writes."""
    pose = pose or {}
    place = pose.get("position", [0, 0, 0])
    if "quaternion_xyzw" in pose:
        return from_quaternion(place, pose["quaternion_xyzw"])
    return from_rpy(place, pose.get("rpy", [0, 0, 0]))


def vector_of(rotation: Array) -> Array:
    """Return the rotation vector (3,) of a rotation (3, 3), at most π long."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(skew)), 0.5 * (float(np.trace(rotation)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    if sine > 1e-9:
        return np.asarray(skew * (angle / sine))
    if cosine > 0.0:
        return skew
    column = int(np.argmax(np.diag(rotation)))
    axis = rotation[:, column] + np.eye(3)[column]
    return np.asarray(np.pi * axis / np.linalg.norm(axis))
