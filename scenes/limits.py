"""What the joints can do, beside what their URDF says: ranges of positions, limits of velocity, torque and others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np

from hdplan.scenes.errors import FieldError
from hdplan.scenes.values import Checked, Named, Number, Row, describe

FromUrdf = Literal["urdf"]
JointValues = FromUrdf | float | tuple[float, ...] | Mapping[str, float]
"""A value for each joint: the URDF's, the same for all, one each in the order of the planned joints, or by name (the
others keep the URDF's)."""


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
    unit: str
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

    def _wrong(self, value: object) -> FieldError:
        urdf = "urdf, " * self.in_urdf
        allowed = f"{urdf}a number, a list of numbers, or a mapping from joint names to numbers, all above 0"
        return FieldError(f"must be {allowed} [{self.unit}], found {describe(value)}", value=value)


RATES = {
    "velocity": JointRates("velocity", "rad/s or m/s", in_urdf=True),
    "acceleration": JointRates("acceleration", "rad/s² or m/s²"),
    "jerk": JointRates("jerk", "rad/s³ or m/s³"),
    "torque": JointRates("torque", "Nm or N", in_urdf=True),
}
"""Limits beside those of positions."""


@dataclass(frozen=True, repr=False)
class Limits(Checked):
    """What the joints can do, beside what the URDF says of their positions; None: does not matter here."""

    position: Annotated[Mapping[str, tuple[float, float]], ranges] = field(default_factory=dict)
    """Joint -> range within the URDF's [rad] or [m]."""
    velocity: Annotated[JointValues | None, RATES["velocity"]] = None  # as soon as the motion is timed: the URDF's
    acceleration: Annotated[JointValues | None, RATES["acceleration"]] = None
    jerk: Annotated[JointValues | None, RATES["jerk"]] = None
    torque: Annotated[JointValues | None, RATES["torque"]] = None
