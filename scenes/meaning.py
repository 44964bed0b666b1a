"""What numbers must be together to mean something: a rotation, a direction, a volume, a body's inertia, times in order.

Checks as those of `values`, which the model's annotations name.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hdplan.scenes.errors import FieldError
from hdplan.scenes.values import Choice, Named, Number, Row, describe, is_row, text, wrong

EXACT = 1e-12  # a length this close to one stays as it is, so that what was written reads back bit for bit
CLOSE = 1e-2  # up to here a quaternion is normalized; beyond, it is a mistake
FLAT = 1e-9  # thickness over size below which points lie in one plane
ROUNDING = 1e-9  # share of the largest principal moment by which an inertia may break the laws of a body
AXES: Mapping[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
ANYWHERE = (math.inf, math.inf, math.inf)


def rotation(value: object) -> tuple[float, ...]:
    """Return a unit quaternion (x, y, z, w); one whose length is within CLOSE of 1 is normalized."""
    quaternion = Row(Number(), 4)(value)
    length = math.hypot(*quaternion)
    if not abs(length - 1.0) <= CLOSE:
        found = "[" + ", ".join(f"{part:g}" for part in quaternion) + "]"
        raise FieldError(f"must be a unit quaternion (x, y, z, w), found {found} of length {length:.6g}")
    return quaternion if abs(length - 1.0) <= EXACT else tuple(part / length for part in quaternion)


def from_rpy(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion of R = Rz(yaw) Ry(pitch) Rx(roll) [rad], URDF's turns about the fixed axes x, y, z."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle / 2), math.sin(angle / 2)) for angle in (roll, pitch, yaw))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def direction(value: object) -> tuple[float, ...]:
    """Return an axis by its name, or a vector of any length but 0, as a vector of length 1."""
    if isinstance(value, str):
        return AXES[Choice(AXES)(value)]
    if not is_row(value):
        raise wrong(f"one of {', '.join(AXES)}, or three numbers", value)
    vector = Row(Number(), 3)(value)
    length = math.hypot(*vector)
    if length == 0.0:
        raise wrong("a direction, which has a length above 0", value)
    return vector if abs(length - 1.0) <= EXACT else tuple(part / length for part in vector)


def volume(value: object) -> tuple[tuple[float, ...], ...]:
    """Return points that span a volume."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    points = Row(Row(Number(unit="m"), 3), of="points")(value)
    spread = np.ptp(points, axis=0).max() if points else 0.0
    if not points or np.linalg.matrix_rank(np.subtract(points, points[0]), tol=FLAT * spread) < 3:
        raise FieldError(
            f"must be points that span a volume (four or more, not in one plane), found {len(points)} that do not"
        )
    return points


def extent(value: object) -> tuple[float, ...]:
    """Return the edge lengths [m] of a box that may reach on without end, though not along all axes."""
    size = Row(_edge, 3, "edge lengths")(value)
    if size == ANYWHERE:
        raise FieldError("is infinite along all axes, so any place will do: leave the section out")
    return size


def _edge(value: object) -> float:
    if isinstance(value, float) and value == math.inf:
        return math.inf
    if isinstance(value, float) and not math.isfinite(value):
        raise wrong("a number greater than 0 [m], or .inf", value)
    return Number(above=0.0, unit="m")(value)


def scale(value: object) -> tuple[float, ...]:
    """Return factors along three axes, given as such or as one for all."""
    factor = Number(above=0.0)
    return Row(factor, 3)(value) if is_row(value) else (factor(value),) * 3


def inertia(value: object) -> tuple[float, ...]:
    """Return xx, xy, xz, yy, yz, zz [kg m²] of a body that can exist: no principal moment is below 0, or above the sum
    of the other two."""
    xx, xy, xz, yy, yz, zz = numbers = Row(Number(unit="kg m²"), 6)(value)
    least, middle, most = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    moments = f"its principal moments are {least:.4g}, {middle:.4g} and {most:.4g} kg m²"
    slack = ROUNDING * max(abs(least), abs(most))
    if least < -slack:
        raise FieldError(f"(xx, xy, xz, yy, yz, zz) belongs to no body: {moments}, and none may be negative")
    if least + middle < most - slack:
        raise FieldError(
            f"(xx, xy, xz, yy, yz, zz) belongs to no body: {moments}, and none may exceed the sum of the other two"
        )
    return numbers


def rising(value: object) -> tuple[float, ...]:
    """Return two or more times [s] from 0 on, each later than the one before."""
    times = Row(Number(low=0.0, unit="s"), of="times")(value)
    if len(times) < 2:
        raise FieldError(f"must be two or more times [s], found {len(times)}")
    for before, after in itertools.pairwise(times):
        if not before < after:
            raise FieldError(f"must rise from one to the next [s], found {before:g} before {after:g}")
    return times


def ranges(value: object) -> dict[str, tuple[float, float]]:
    """Return ranges of joints, by name."""
    return Named(_range)(value)


def _range(value: object) -> tuple[float, ...]:
    low, high = Row(Number(unit="rad or m"), 2)(value)
    if not low < high:
        raise FieldError(f"must be [low, high] with low < high [rad or m], found [{low:g}, {high:g}]")
    return low, high


@dataclass(frozen=True)
class JointRates:
    """Values above 0 for joints: one for all, one each, by name, or the word urdf for what a URDF holds."""

    quantity: str
    unit: str  # of a joint that turns, or of one that slides
    order: int | None = None  # of the derivative of a joint's value by time that it is; None: it is none
    in_urdf: bool = False

    def __call__(self, value: object) -> Any:
        """Return a float, a tuple, a dictionary, or "urdf"; None as it is."""
        number = Number(above=0.0, unit=self.unit)
        if isinstance(value, np.ndarray) and value.ndim:  # it equals no word
            value = list(value)
        match value:
            case None:
                return None
            case "urdf" if self.in_urdf:
                return "urdf"
            case "urdf":
                raise FieldError(f"a URDF holds no {self.quantity} limits: give numbers [{self.unit}]", value=value)
            case str(word) if word[:1] in "+-.0123456789":  # meant as a number: its own words say how to write it
                return number(value)
            case {**named} if named:
                return Named(number)(value)
            case [_, *_]:
                return Row(number)(value)
            case bool() | str() | dict() | list() | tuple() | np.ndarray():
                raise self._wrong(value)
        try:
            return number(value)
        except FieldError as error:
            raise self._wrong(value) if error.kind else error from None

    @property
    def units(self) -> tuple[str, str]:
        """The unit of a joint that turns, and of one that slides."""
        turns, slides = self.unit.split(" or ")
        return turns, slides

    def _wrong(self, value: object) -> FieldError:
        urdf = "urdf, " * self.in_urdf
        allowed = f"{urdf}a number, a list of numbers, or a mapping from joint names to numbers, all above 0"
        return FieldError(f"must be {allowed} [{self.unit}], found {describe(value)}", value=value)


def pair(value: object) -> tuple[str, str]:
    """Return the names of two different links."""
    first, second = Row(text, 2, "link names")(value)
    if first == second:
        raise FieldError(f"must name two different links, found {first!r} twice")
    return first, second
