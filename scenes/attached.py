"""Loads of links: held objects, which collide like the links, and payloads, which only have mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

import numpy as np

from hdplan.scenes.errors import FieldError
from hdplan.scenes.poses import AnyPose, Place, Placement, Pose
from hdplan.scenes.shapes import Shape, Solid, check_unplaced
from hdplan.scenes.values import Checked, Name, Number, Numbers, Row, text

MOMENT_ROUNDING = 1e-9  # share of the largest principal moment by which an inertia may violate these bounds


def body_inertia(value: object) -> tuple[float, ...]:
    """Return xx, xy, xz, yy, yz, zz [kg m²] of a physically possible body: no principal moment is negative, or above
    the sum of the other two."""
    xx, xy, xz, yy, yz, zz = numbers = Row(Number(unit="kg m²"), 6)(value)
    least, middle, most = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
    moments = f"its principal moments are {least:.4g}, {middle:.4g} and {most:.4g} kg m²"
    slack = MOMENT_ROUNDING * max(abs(least), abs(most))
    if least < -slack:
        raise FieldError(f"(xx, xy, xz, yy, yz, zz) is not physical: {moments}, and none may be negative")
    if least + middle < most - slack:
        raise FieldError(
            f"(xx, xy, xz, yy, yz, zz) is not physical: {moments}, and none may exceed the sum of the other two"
        )
    return numbers


@dataclass(frozen=True, repr=False)
class Attached(Checked):
    """A body held by a link: it moves with the link and collides as the link does."""

    name: Name
    link: Name
    shape: Shape
    pose: Placement = field(default_factory=Pose)  # in the link's frame
    touch_links: Annotated[tuple[str, ...], Row(text, of="link names")] = ()  # links that it may touch, beside its own
    mass: Annotated[float, Number(above=0.0, unit="kg")] | None = None
    """[kg] at uniform density; matters where joint torques are limited (limits.torque). None: massless."""

    if TYPE_CHECKING:

        def __init__(
            self,
            name: str,
            link: str,
            shape: Solid,
            pose: AnyPose = Pose(),
            touch_links: Sequence[str] = (),
            mass: float | None = None,
        ) -> None: ...

    def _check_whole(self) -> None:
        check_unplaced(self.shape, "held object")


@dataclass(frozen=True, repr=False)
class Payload(Checked):
    """A mass that a link carries beside its own; it cannot collide."""

    link: Name
    mass: Annotated[float, Number(above=0.0, unit="kg")]  # [kg]
    com: Place = (0.0, 0.0, 0.0)  # its centre of mass, in the link's frame [m]
    inertia: Annotated[tuple[float, float, float, float, float, float], body_inertia] = (0.0,) * 6
    """xx, xy, xz, yy, yz, zz about its centre of mass, along the link's axes [kg m²]."""

    if TYPE_CHECKING:

        def __init__(
            self, link: str, mass: float, com: Numbers = (0.0, 0.0, 0.0), inertia: Numbers = (0.0,) * 6
        ) -> None: ...
