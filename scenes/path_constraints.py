"""Path constraints, which hold along the whole motion: a link upright, a point of a link within a box, a link's pose
relative to another."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Annotated, assert_never

from hdplan.scenes.errors import FieldError
from hdplan.scenes.poses import EXACT, AnyPose, Place, Placement, Pose, Vector3
from hdplan.scenes.values import Checked, Choice, Name, Number, Numbers, Row, is_row, wrong

AXES: Mapping[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
ANYWHERE = (math.inf, math.inf, math.inf)


def direction(value: object) -> tuple[float, ...]:
    """Return a unit vector, given as the name of an axis or as a vector of any length but 0."""
    if isinstance(value, str):
        return AXES[Choice(AXES)(value)]
    if not is_row(value):
        raise wrong(f"one of {', '.join(AXES)}, or three numbers", value)
    vector = Row(Number(), 3)(value)
    length = math.hypot(*vector)
    if length == 0.0:
        raise wrong("a direction, which has a length above 0", value)
    return vector if abs(length - 1.0) <= EXACT else tuple(part / length for part in vector)


def extent(value: object) -> tuple[float, ...]:
    """Return the edge lengths [m] of a box that may be infinite along some axes, but not along all."""
    size = Row(_edge, 3, "edge lengths")(value)
    if size == ANYWHERE:
        raise FieldError("is infinite along all axes, which constrains nothing: leave the section out")
    return size


def _edge(value: object) -> float:
    if isinstance(value, float) and value == math.inf:
        return math.inf
    if isinstance(value, float) and not math.isfinite(value):
        raise wrong("a number greater than 0 [m], or .inf", value)
    return Number(above=0.0, unit="m")(value)


@dataclass(frozen=True, repr=False)
class Upright(Checked):
    """A link's axis stays close to the world's upward direction along the whole motion."""

    link: Name
    axis: Annotated[Vector3, direction] = (0.0, 0.0, 1.0)  # in the link's frame, of unit length
    tolerance: Annotated[float, Number(high=math.pi, above=0.0, unit="rad")] = 0.1  # angle to the upward axis [rad]

    if TYPE_CHECKING:

        def __init__(self, link: str, axis: str | Numbers = (0.0, 0.0, 1.0), tolerance: float = 0.1) -> None: ...


@dataclass(frozen=True, repr=False)
class Within(Checked):
    """A point of a link stays in a box along the whole motion."""

    link: Name
    size: Annotated[Vector3, extent]  # full edge lengths of the box [m]; inf: unbounded along that axis
    pose: Placement = field(default_factory=Pose)  # of the box's centre, in the world
    point: Place = (0.0, 0.0, 0.0)  # in the link's frame [m]

    if TYPE_CHECKING:

        def __init__(
            self, link: str, size: Numbers, pose: AnyPose = Pose(), point: Numbers = (0.0, 0.0, 0.0)
        ) -> None: ...


@dataclass(frozen=True, repr=False)
class Relative(Checked):
    """A link keeps its pose relative to another link along the whole motion, as two tools do that hold one object."""

    link: Name
    to: Name  # the other link
    pose: Placement | None = None  # of the link's frame, in that of `to`; None: as it is at the start
    position_tolerance: Annotated[float, Number(high=1.0, above=0.0, unit="m")] = 5e-3  # of the link's origin [m]
    orientation_tolerance: Annotated[float, Number(high=math.pi, above=0.0, unit="rad")] = 0.05  # angle [rad]

    if TYPE_CHECKING:

        def __init__(
            self,
            link: str,
            to: str,
            pose: AnyPose | None = None,
            position_tolerance: float = 5e-3,
            orientation_tolerance: float = 0.05,
        ) -> None: ...

    def _check_whole(self) -> None:
        if self.link == self.to:
            raise FieldError(f"must be another link than 'link', found {self.to!r} twice", "to")


PathConstraint = Upright | Within | Relative


@dataclass(frozen=True, repr=False)
class PathConstraints(Checked):
    """Constraints on the whole motion, between the waypoints too."""

    upright: Upright | None = None
    position: Within | None = None
    relative: Relative | None = None

    @property
    def asked(self) -> dict[str, PathConstraint]:
        """The constraints that there are, by their fields in the scene: "path.upright"."""
        given = {f"path.{each.name}": getattr(self, each.name) for each in fields(self)}
        return {name: constraint for name, constraint in given.items() if constraint is not None}

    @property
    def regions(self) -> tuple[Within, ...]:
        """The constraints that can be drawn: boxes in which points of links are to stay."""
        return tuple(box for asked in self.asked.values() for box in _region(asked))


def _region(asked: PathConstraint) -> tuple[Within, ...]:
    match asked:
        case Within():
            return (asked,)
        case Upright() | Relative():
            return ()
        case _:
            assert_never(asked)
