"""Stages in which a link's frame follows a curve: a line, an arc of a circle, a list of poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from hdplan.scenes.errors import FieldError
from hdplan.scenes.limits import Limits
from hdplan.scenes.path_constraints import FREE_AXES, poses_along
from hdplan.scenes.pose_table import read_pose_table
from hdplan.scenes.poses import Place, Pose, Vector3
from hdplan.scenes.stage import AnyTouch, ArmStage
from hdplan.scenes.values import NEEDED, Choice, Name, Number, Numbers, Row

WORLD, TOOL = "world", "tool"  # frames, beside the names of objects

Angles = Annotated[Vector3, Row(Number(unit="rad"), 3)]
Turn = Annotated[Vector3, Row(Number(-math.pi, math.pi, unit="rad"), 3)]  # beyond, the shortest way is the other one


@dataclass(frozen=True, repr=False)
class Curve(ArmStage):
    """A stage in which a link's frame follows a curve. All along, its origin stays within `position_tolerance` of where
    it is to be, and its rotation within `orientation_tolerance`."""

    link: Name | None = field(default=None, kw_only=True)  # None: the end effector
    position_tolerance: Annotated[float, Number(high=0.1, above=0.0, unit="m")] = field(default=1e-3, kw_only=True)
    orientation_tolerance: Annotated[float, Number(high=1.0, above=0.0, unit="rad")] = field(default=1e-2, kw_only=True)
    free_rotation: Annotated[str, Choice(FREE_AXES)] = field(default="none", kw_only=True)
    """The axis of the link about which its rotation is free."""
    tool_speed: Annotated[float, Number(above=0.0, unit="m/s")] | None = field(default=None, kw_only=True)
    """The greatest speed of the link's origin [m/s]."""
    tool_acceleration: Annotated[float, Number(above=0.0, unit="m/s²")] | None = field(default=None, kw_only=True)
    """The greatest acceleration of the link's origin [m/s²]."""


@dataclass(frozen=True, repr=False)
class _ToEnd(Curve):
    """A curve that leads from where the link is to an end, given by a shift and a turn, or in the world."""

    by: Place | None = None  # a shift in `frame` [m]
    to: Place | None = None  # a position in the world [m]
    frame: Name = WORLD  # of `by` and `turn`: "world", "tool", as it is at the beginning, or an object's name
    turn: Turn | None = None  # with `by`: roll, pitch and yaw about the axes of `frame` [rad]
    rpy: Angles | None = None  # with `to`: the orientation in the world at the end [rad]

    def _check_whole(self) -> None:
        if (self.by is None) == (self.to is None):
            found = "neither" if self.by is None else "both"
            raise FieldError(f"must have either 'by' or 'to', found {found}")
        if self.by is None and self.frame != WORLD:
            raise FieldError("goes with 'by': 'to' is a position in the world", "frame")
        if self.by is None and self.turn is not None:
            raise FieldError("goes with 'by': the orientation at the end is 'rpy', beside 'to'", "turn")
        if self.to is None and self.rpy is not None:
            raise FieldError("goes with 'to': a turn beside 'by' is 'turn'", "rpy")


@dataclass(frozen=True, repr=False)
class Line(_ToEnd):
    """A stage in which a link's frame moves on a straight line: `by` a shift, or `to` a position; it turns evenly, by
    the shortest turn, where one is given."""

    if TYPE_CHECKING:

        def __init__(
            self,
            by: Numbers | None = None,
            to: Numbers | None = None,
            frame: str = WORLD,
            turn: Numbers | None = None,
            rpy: Numbers | None = None,
            *,
            name: str | None = None,
            touch: AnyTouch = (),
            limits: Limits | None = None,
            speed: float = 1.0,
            blend: float = 0.0,
            link: str | None = None,
            position_tolerance: float = 1e-3,
            orientation_tolerance: float = 1e-2,
            free_rotation: str = "none",
            tool_speed: float | None = None,
            tool_acceleration: float | None = None,
        ) -> None: ...

    def _check_whole(self) -> None:
        super()._check_whole()
        if self.by is not None and not any(self.by) and not any(self.turn or ()):
            raise FieldError("has no length: give a shift that is not 0", "by")


@dataclass(frozen=True, repr=False)
class Circle(_ToEnd):
    """A stage in which a link's frame moves on an arc of a circle to an end, like a line: `interim` is a point on the
    arc, or `center` its centre, around which it takes the shorter way. With `by` they are shifts in `frame` from the
    link's place at the beginning, with `to` positions in the world."""

    interim: Place | None = None  # [m]
    center: Place | None = None  # [m]

    if TYPE_CHECKING:

        def __init__(
            self,
            by: Numbers | None = None,
            to: Numbers | None = None,
            frame: str = WORLD,
            turn: Numbers | None = None,
            rpy: Numbers | None = None,
            interim: Numbers | None = None,
            center: Numbers | None = None,
            *,
            name: str | None = None,
            touch: AnyTouch = (),
            limits: Limits | None = None,
            speed: float = 1.0,
            blend: float = 0.0,
            link: str | None = None,
            position_tolerance: float = 1e-3,
            orientation_tolerance: float = 1e-2,
            free_rotation: str = "none",
            tool_speed: float | None = None,
            tool_acceleration: float | None = None,
        ) -> None: ...

    def _check_whole(self) -> None:
        super()._check_whole()
        if (self.interim is None) == (self.center is None):
            found = "neither" if self.interim is None else "both"
            raise FieldError(f"must have either 'interim' or 'center', found {found}")


@dataclass(frozen=True, repr=False)
class Along(Curve):
    """A stage in which a link's frame follows poses in a `frame`, from the first, its current one, to the last:
    straight from each to the next, turning evenly."""

    poses: Annotated[tuple[Pose, ...], poses_along] = NEEDED
    frame: Name = WORLD  # "world", "tool", as it is at the beginning, or an object's name

    if TYPE_CHECKING:

        def __init__(
            self,
            poses: Sequence[Pose] = NEEDED,
            frame: str = WORLD,
            *,
            name: str | None = None,
            touch: AnyTouch = (),
            limits: Limits | None = None,
            speed: float = 1.0,
            blend: float = 0.0,
            link: str | None = None,
            position_tolerance: float = 1e-3,
            orientation_tolerance: float = 1e-2,
            free_rotation: str = "none",
            tool_speed: float | None = None,
            tool_acceleration: float | None = None,
        ) -> None: ...

    @staticmethod
    def read(path: str | Path) -> tuple[Pose, ...]:
        """Return the poses of a CSV file with the columns x, y, z, qx, qy, qz and qw, in any order, and maybe time,
        which is not used. Raises InputError."""
        return read_pose_table(path)
