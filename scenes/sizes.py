"""Sizes of a scene's uncertainties: of the poses of obstacles, of a controller's errors and of the robot's place. A
world is *within the sizes* if all its parts are; a certificate holds in every such world."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np

from hdplan.scenes.values import FORMS, Checked, Number, Numbers, PerJoint

Distance = Annotated[float, Number(0.0, 1.0, unit="m")]
Turn = Annotated[float, Number(0.0, math.pi, unit="rad")]
JointSizes = float | tuple[float, ...] | Mapping[str, float]
"""A size for each joint: one for all, one each in the order of the planned joints, or by name, the others 0."""
AnyJointSizes = float | Numbers | Mapping[str, float]


def joint_sizes(unit: str, most: float = math.inf) -> PerJoint:
    """Return the check of a size of every joint, at least 0."""
    size = Number(0.0, most, unit=unit)
    return PerJoint(size, f"{FORMS}, {size.range}")


class Sized(Checked):
    """Sizes that can be made smaller together."""

    def times(self, share: float) -> Self:
        """Return so much of every size."""
        return type(self)(**{each.name: _times(getattr(self, each.name), share) for each in fields(self)})  # type: ignore[arg-type]


def _times(size: JointSizes, share: float) -> JointSizes:
    if isinstance(size, Mapping):
        return {name: share * value for name, value in size.items()}
    return tuple(share * value for value in size) if isinstance(size, tuple) else share * size


@dataclass(frozen=True, repr=False)
class Uncertainty(Sized):
    """The uncertainty of an obstacle's pose: each of its points may be up to `position` away from its place in the
    pose, turned by up to `orientation` about the obstacle's origin, and up to `speed` times the time farther."""

    position: Distance = 0.0  # [m]
    orientation: Turn = 0.0  # [rad] about any axis through its origin
    speed: Annotated[float, Number(0.0, 100.0, unit="m/s")] = 0.0  # at which it may leave its pose, after time 0


@dataclass(frozen=True, repr=False)
class Tracking(Sized):
    """The largest deviations of the joints from the motion while a controller executes it."""

    position: Annotated[JointSizes, joint_sizes("rad or m", 1.0)] = 0.0
    velocity: Annotated[JointSizes, joint_sizes("rad/s or m/s")] = 0.0

    if TYPE_CHECKING:

        def __init__(self, position: AnyJointSizes = 0.0, velocity: AnyJointSizes = 0.0) -> None: ...

    def _check_whole(self) -> None:
        for name in ("position", "velocity"):  # zeros in any form are none
            given = getattr(self, name)
            if not any(given.values() if isinstance(given, Mapping) else np.atleast_1d(given)):
                object.__setattr__(self, name, 0.0)

    @property
    def of_rates(self) -> bool:
        """True if any joint's velocity may be off."""
        return self.velocity != 0.0


@dataclass(frozen=True, repr=False)
class Calibration(Sized):
    """The uncertainty of the base: up to `position` away from `robot.base`, turned by up to `orientation` about it."""

    position: Distance = 0.0  # [m]
    orientation: Turn = 0.0  # [rad] about any axis through the base's origin


def chord(angle: float) -> float:
    """Return the largest shift of a point by a turn, as a fraction of its distance from the origin."""
    return 2.0 * math.sin(0.5 * angle)
