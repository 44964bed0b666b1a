"""Poses as files write them: a position with a quaternion or roll-pitch-yaw angles."""

from __future__ import annotations

import math
from collections.abc import Mapping

from hdplan.scenes.fields import Field
from hdplan.scenes.poses import Pose, Quaternion, Vector3, from_rpy, in_degrees, rotation

QUATERNION_ROUNDING = 1e-6  # a quaternion this close to unit length differs from it by its decimals only


def read_pose(section: Field) -> Pose:
    """Read ``{position, quaternion_xyzw | rpy}``; what is missing is zero. See `from_rpy` for the angles.

    Raises:
        InputError: both kinds of rotation, wrong lengths or types, or a quaternion that is not of unit length.
    """
    return pose_of(section, section.mapping(("position", "quaternion_xyzw", "rpy")))


def read_poses(section: Field) -> tuple[Pose, ...]:
    """Read a list of poses."""
    return tuple(read_pose(pose) for pose in section.items(of="poses"))


def pose_of(section: Field, keys: Mapping[str, Field]) -> Pose:
    """Read a pose from the keys of a section that may have other keys too."""
    if "quaternion_xyzw" in keys and "rpy" in keys:
        raise section.error("has both 'quaternion_xyzw' and 'rpy'; give one of them")
    position = read_vector(keys["position"], unit="m") if "position" in keys else (0.0, 0.0, 0.0)
    if "quaternion_xyzw" in keys:
        return Pose(position, read_quaternion(keys["quaternion_xyzw"]))
    if "rpy" not in keys:
        return Pose(position)
    angles = read_vector(keys["rpy"], unit="rad")
    if words := in_degrees(angles):
        keys["rpy"].note(words)
    return Pose(position, from_rpy(*angles))


def read_vector(entry: Field, unit: str = "") -> Vector3:
    """Read three finite numbers."""
    x, y, z = entry.numbers(3, unit=unit)
    return x, y, z


def read_quaternion(entry: Field) -> Quaternion:
    """Read a unit quaternion (x, y, z, w), normalized: silently within `ROUNDING`, with a note within
    `poses.CLOSE`.

    Raises:
        InputError: its length differs from 1 by more than that.
    """
    given = entry.numbers(4)
    x, y, z, w = entry.checked(rotation, given)
    if abs(math.hypot(*given) - 1.0) > QUATERNION_ROUNDING:
        entry.note(f"the quaternion of length {math.hypot(*given):.6g} was normalized")
    return x, y, z, w
