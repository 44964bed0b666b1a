"""Path constraints, which hold along the whole motion: a link upright, a point of a link within a box, a link's pose
relative to another, a curve of poses that a link follows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Annotated, assert_never

import numpy as np

from hdplan.scenes.errors import FieldError
from hdplan.scenes.poses import UNIT_ERROR, AnyPose, Place, Placement, Pose, Vector3
from hdplan.scenes.values import Checked, Choice, Name, Number, Numbers, Row, is_row, wrong

AXES: Mapping[str, tuple[float, float, float]] = {
    "x": (1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "z": (0.0, 0.0, 1.0),
    "-x": (-1.0, 0.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
FREE_AXES = ("none", "x", "y", "z")
MOST_POSES = 20_000
MOST_TURN = 3.0  # [rad] from one pose of a curve to the next
UNBOUNDED_BOX = (math.inf, math.inf, math.inf)


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
    return vector if abs(length - 1.0) <= UNIT_ERROR else tuple(part / length for part in vector)


def extent(value: object) -> tuple[float, ...]:
    """Return the edge lengths [m] of a box that may be infinite along some axes, but not along all."""
    size = Row(_edge, 3, "edge lengths")(value)
    if size == UNBOUNDED_BOX:
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
    """A constraint: a link's axis stays close to the world's upward direction along the whole motion."""

    link: Name
    axis: Annotated[Vector3, direction] = (0.0, 0.0, 1.0)  # in the link's frame, of unit length
    tolerance: Annotated[float, Number(high=math.pi, above=0.0, unit="rad")] = 0.1  # angle to the upward axis [rad]

    if TYPE_CHECKING:

        def __init__(self, link: str, axis: str | Numbers = (0.0, 0.0, 1.0), tolerance: float = 0.1) -> None: ...


@dataclass(frozen=True, repr=False)
class Within(Checked):
    """A constraint: a point of a link stays in a box along the whole motion."""

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
    """A constraint: a link keeps its pose relative to another one along the whole motion, as for two hands on one
    object."""

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


def poses_along(value: object) -> tuple[Pose, ...]:
    """Return two or more poses, each less than half a turn from the last one, so that there is one shortest turn."""
    poses: tuple[Pose, ...] = Row(_pose, of="poses")(value)
    if not 2 <= len(poses) <= MOST_POSES:
        raise FieldError(f"must be 2 to {MOST_POSES} poses, found {len(poses)}")
    turns = np.array([pose.quaternion_xyzw for pose in poses])
    cosines = np.abs((turns[1:] * turns[:-1]).sum(axis=1))  # of half the angle
    if (far := np.flatnonzero(cosines < math.cos(0.5 * MOST_TURN))).size:
        i = int(far[0])
        angle = 2.0 * math.acos(min(1.0, float(cosines[i])))
        words = f"turns by {angle:.3g} rad from the pose before; at most {MOST_TURN:g} are allowed: give one between"
        raise FieldError(words, f"[{i + 1}]")
    return poses


def _pose(value: object) -> Pose:
    if not isinstance(value, Pose):
        raise wrong("a Pose", value)
    return value


@dataclass(frozen=True, repr=False)
class Follow(Checked):
    """A constraint: a link follows a curve of poses, from the first to the last without going back: straight from each
    to the next, turning about a fixed axis by the shortest turn. With a free rotation only that axis of the link
    counts, which goes the shortest way."""

    link: Name
    poses: Annotated[tuple[Pose, ...], poses_along]  # in the world
    position_tolerance: Annotated[float, Number(high=1.0, above=0.0, unit="m")] = 1e-3  # of the link's origin [m]
    orientation_tolerance: Annotated[float, Number(high=math.pi, above=0.0, unit="rad")] = 1e-2  # angle [rad]
    free_rotation: Annotated[str, Choice(FREE_AXES)] = "none"
    """The axis of the link about which its rotation is free."""
    speed: Annotated[float, Number(above=0.0, unit="m/s")] | None = None  # of the link's origin, at most [m/s]
    acceleration: Annotated[float, Number(above=0.0, unit="m/s²")] | None = None  # [m/s²]
    begin_tolerance: Annotated[float, Number(high=1.0, above=0.0, unit="m")] | None = None
    """Radius around the first pose, within which the link comes onto the curve from elsewhere [m]."""
    end_tolerance: Annotated[float, Number(high=1.0, above=0.0, unit="m")] | None = None
    """Radius around the last pose, within which it leaves the curve [m]."""

    if TYPE_CHECKING:

        def __init__(
            self,
            link: str,
            poses: Sequence[Pose],
            position_tolerance: float = 1e-3,
            orientation_tolerance: float = 1e-2,
            free_rotation: str = "none",
            speed: float | None = None,
            acceleration: float | None = None,
            begin_tolerance: float | None = None,
            end_tolerance: float | None = None,
        ) -> None: ...

    def _check_whole(self) -> None:
        if self.free_rotation == "none":
            return
        axes = np.array([pose.matrix[:3, "xyz".index(self.free_rotation)] for pose in self.poses])
        cosines = (axes[1:] * axes[:-1]).sum(axis=1)
        if (far := np.flatnonzero(cosines < math.cos(MOST_TURN))).size:
            raise FieldError("turns its free axis round from the pose before: give one between", f"poses[{far[0] + 1}]")

    @property
    def rated(self) -> bool:
        """True if the constraint concerns more than places."""
        return self.speed is not None or self.acceleration is not None


PathConstraint = Upright | Within | Relative | Follow


@dataclass(frozen=True, repr=False)
class PathConstraints(Checked):
    """Constraints on the whole motion, between the waypoints too."""

    upright: Upright | None = None
    position: Within | None = None
    relative: Relative | None = None
    follow: Follow | None = None

    @property
    def given(self) -> dict[str, PathConstraint]:
        """The constraints that there are, by their fields in the scene: "path.upright"."""
        every = {f"path.{each.name}": getattr(self, each.name) for each in fields(self)}
        return {name: constraint for name, constraint in every.items() if constraint is not None}

    @property
    def regions(self) -> tuple[Within, ...]:
        """The constraints that can be drawn: boxes in which points of links are to stay."""
        return tuple(box for each in self.given.values() for box in _region(each))


def _region(constraint: PathConstraint) -> tuple[Within, ...]:
    match constraint:
        case Within():
            return (constraint,)
        case Upright() | Relative() | Follow():
            return ()
        case _:
            assert_never(constraint)
