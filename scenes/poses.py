"""Poses: a position and a rotation."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes.errors import FieldError
from hdplan.scenes.values import Checked, Number, Numbers, Row, checked, is_row, wrong

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Place = Annotated[Vector3, Row(Number(unit="m"), 3)]

# a vector this close to unit length is kept as it is, so that what was written reads back bit for bit
UNIT_ERROR = 1e-12
LARGEST_ANGLE = 6.3  # [rad] a little more than a whole turn
NORMALIZED_ERROR = 1e-2  # of unit length: a quaternion up to here is normalized, beyond it is refused


def rotation(value: object) -> tuple[float, ...]:
    """Return a unit quaternion (x, y, z, w); one whose length is within NORMALIZED_ERROR of 1 is normalized."""
    quaternion = Row(Number(), 4)(value)
    length = math.hypot(*quaternion)
    if not abs(length - 1.0) <= NORMALIZED_ERROR:
        found = "[" + ", ".join(f"{part:g}" for part in quaternion) + "]"
        raise FieldError(f"must be a unit quaternion (x, y, z, w), found {found} of length {length:.6g}")
    return quaternion if abs(length - 1.0) <= UNIT_ERROR else tuple(part / length for part in quaternion)


def from_rpy(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion of R = Rz(yaw) Ry(pitch) Rx(roll) [rad], URDF's rotations about the fixed axes x, y and
    z."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle / 2), math.sin(angle / 2)) for angle in (roll, pitch, yaw))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def in_degrees(rpy: Numbers) -> str:
    """Question whether angles are in degrees, of which one is beyond a whole turn; empty if none is."""
    beyond = [angle for angle in rpy if abs(angle) > LARGEST_ANGLE]
    return f"{beyond[0]:g} is beyond a whole turn: is it in degrees? hdplan takes radians" if beyond else ""


@dataclass(frozen=True, repr=False)
class Pose(Checked):
    """A pose: position [m] and unit quaternion (x, y, z, w); it maps the object's frame into its parent's.

    Raises InputError for a position that is not three finite numbers, and for a quaternion whose length differs from 1
    by more than 0.01; one that is closer is normalized.
    """

    position: Place = (0.0, 0.0, 0.0)
    quaternion_xyzw: Annotated[Quaternion, rotation] = (0.0, 0.0, 0.0, 1.0)

    if TYPE_CHECKING:

        def __init__(
            self, position: Numbers = (0.0, 0.0, 0.0), quaternion_xyzw: Numbers = (0.0, 0.0, 0.0, 1.0)
        ) -> None: ...

    @classmethod
    def from_rpy(cls, position: Numbers, rpy: Numbers) -> Pose:
        """Return the pose at `position` [m], rotated by roll, pitch and yaw [rad], R = Rz(yaw) Ry(pitch) Rx(roll), as
        in URDF. Warns of an angle beyond a whole turn, which may be in degrees. Raises InputError for anything but
        three finite numbers each."""
        angles = checked(Row(Number(unit="rad"), 3), rpy, "rpy")
        if words := in_degrees(angles):
            warnings.warn(f"rpy: {words}", stacklevel=2)
        return cls(position, from_rpy(*angles))

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """The pose as a homogeneous matrix (4, 4)."""
        x, y, z, w = self.quaternion_xyzw
        transform = np.eye(4)
        transform[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        transform[:3, 3] = self.position
        transform.setflags(write=False)
        return transform


def placement(value: object) -> Pose:
    """Return a pose, given as a Pose or as its position alone."""
    if isinstance(value, Pose):
        return value
    if not is_row(value) or len(value) != 3:
        raise wrong("a Pose, or a position of three numbers [m]", value)
    return Pose(value)


Placement = Annotated[Pose, placement]
AnyPose = Pose | Numbers


IDENTITY = Pose()


def compose(outer: Pose, inner: Pose) -> Pose:
    """Return the pose whose matrix is ``outer.matrix @ inner.matrix``."""
    if outer == IDENTITY:
        return inner
    if inner == IDENTITY:
        return outer
    ax, ay, az, aw = outer.quaternion_xyzw
    bx, by, bz, bw = inner.quaternion_xyzw
    x, y, z = (outer.matrix[:3, :3] @ inner.position + outer.position).tolist()
    return Pose(
        (x, y, z),
        (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ),
    )
