"""Limits of joints beside those of their URDF: on position, velocity, acceleration, jerk and torque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal

from hdplan.scenes.errors import FieldError
from hdplan.scenes.values import FORMS, Checked, Named, Number, Numbers, PerJoint, Row

FromUrdf = Literal["urdf"]
JointValues = FromUrdf | float | tuple[float, ...] | Mapping[str, float]
"""A value for each joint: the URDF's, one for all, one each in the order of the planned joints, or by name (the
others keep the URDF's)."""
AnyJointValues = FromUrdf | float | Numbers | Mapping[str, float]


def ranges(value: object) -> dict[str, tuple[float, float]]:
    """Return position ranges by joint name."""
    return Named(_range)(value)


def _range(value: object) -> tuple[float, ...]:
    low, high = Row(Number(unit="rad or m"), 2)(value)
    if not low < high:
        raise FieldError(f"must be [low, high] with low < high [rad or m], found [{low:g}, {high:g}]")
    return low, high


@dataclass(frozen=True)
class JointQuantity:
    """Something of every joint that can be limited. Its values are above 0: one for all joints, one each, by name, or
    the word urdf for what a URDF holds."""

    name: str
    unit: str  # of a joint that turns, or of one that slides
    order: int | None = None  # of the derivative of a joint's value by time that it is; None: it is none
    in_urdf: bool = False

    @property
    def units(self) -> tuple[str, str]:
        """The unit of a joint that turns, and of one that slides."""
        turns, slides = self.unit.split(" or ")
        return turns, slides

    @property
    def numbers(self) -> PerJoint:
        """The check of all values but the word."""
        allowed = f"{'urdf, ' * self.in_urdf}{FORMS}, all above 0 [{self.unit}]"
        return PerJoint(Number(above=0.0, unit=self.unit), allowed)

    def __call__(self, value: object) -> Any:
        """Return a float, a tuple, a dictionary, or "urdf"; None as it is."""
        if value is None:
            return None
        if isinstance(value, str) and value == "urdf":
            if self.in_urdf:
                return "urdf"
            raise FieldError(f"a URDF holds no {self.name} limits: give numbers [{self.unit}]", value=value)
        return self.numbers(value)


QUANTITIES = {
    "velocity": JointQuantity("velocity", "rad/s or m/s", order=1, in_urdf=True),
    "acceleration": JointQuantity("acceleration", "rad/s² or m/s²", order=2),
    "jerk": JointQuantity("jerk", "rad/s³ or m/s³", order=3),
    "torque": JointQuantity("torque", "Nm or N", in_urdf=True),
}
"""Quantities with limits beside positions."""


@dataclass(frozen=True, repr=False)
class Limits(Checked):
    """Limits of the joints, beside the URDF's limits of position; None: not limited."""

    position: Annotated[Mapping[str, tuple[float, float]], ranges] = field(default_factory=dict)
    """Joint -> range within the URDF's [rad] or [m]."""
    velocity: Annotated[JointValues | None, QUANTITIES["velocity"]] = None  # of a motion with times: the URDF's
    acceleration: Annotated[JointValues | None, QUANTITIES["acceleration"]] = None
    jerk: Annotated[JointValues | None, QUANTITIES["jerk"]] = None
    torque: Annotated[JointValues | None, QUANTITIES["torque"]] = None

    if TYPE_CHECKING:

        def __init__(
            self,
            position: Mapping[str, Numbers] = {},
            velocity: AnyJointValues | None = None,
            acceleration: AnyJointValues | None = None,
            jerk: AnyJointValues | None = None,
            torque: AnyJointValues | None = None,
        ) -> None: ...
