"""The robot of a scene, where it stands, and which of its joints are locked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from hdplan.scenes.errors import FieldError
from hdplan.scenes.poses import AnyPose, Placement, Pose
from hdplan.scenes.sizes import Calibration, Tracking
from hdplan.scenes.values import (
    Checked,
    Choice,
    FilePath,
    JointValue,
    Name,
    Named,
    Number,
    Row,
    absolute_path,
    is_row,
    text,
    wrong,
)


def pair(value: object) -> tuple[str, str]:
    """Return the names of two different links."""
    first, second = Row(text, 2, "link names")(value)
    if first == second:
        raise FieldError(f"must name two different links, found {first!r} twice")
    return first, second


def argument(value: object) -> str:
    """Return the value of a xacro argument as xacro's text: also of a number, or true and false."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        Number()(value)
        return repr(value)
    if not isinstance(value, str):
        raise wrong("a text, a number, true or false", value, "text")
    return text(value) if value else value


def group_of(value: object) -> str | tuple[str, ...]:
    """Return the name of a group, or the names of joints, each once."""
    if not is_row(value):
        return text(value)
    names = Row(text, of="joint names")(value)
    if not names:
        raise FieldError("must not be empty")
    for i, name in enumerate(names):
        if name in names[:i]:
            raise FieldError(f"the joint {name!r} appears twice", f"[{i}]")
    return names


def span(value: object) -> tuple[float, float]:
    """Return the range of a joint, from low to high."""
    low, high = Row(JointValue, 2)(value)
    if not low < high:
        raise FieldError(f"must be a range from low to high, found [{low:g}, {high:g}]", value=value)
    return low, high


Span = Annotated[tuple[float, float], span]


@dataclass(frozen=True, repr=False)
class PlanarBase(Checked):
    """A mobile base as three planned joints: `base_x` and `base_y` slide along the axes of the base's pose, then
    `base_yaw` turns about z."""

    x: Span  # [m]
    y: Span  # [m]
    yaw: Span  # [rad]
    kind: Annotated[str, Choice(("planar",))] = "planar"

    if TYPE_CHECKING:

        def __init__(
            self, x: Sequence[float], y: Sequence[float], yaw: Sequence[float], kind: str = "planar"
        ) -> None: ...


@dataclass(frozen=True, repr=False)
class RobotSpec(Checked):
    """A robot's description, its base, its planned joints, and the values of its locked ones."""

    name: Name | None = None  # of a robot in example-robot-data; or else `urdf`
    urdf: Annotated[Path, absolute_path] | None = None
    srdf: Annotated[Path, absolute_path] | None = None
    package_dirs: Annotated[
        tuple[Path, ...], Row(absolute_path, of="folders")
    ] = ()  # where the packages that the URDF or xacro names are sought first
    xacro_args: Annotated[Mapping[str, str], Named(argument)] = field(default_factory=dict)  # of a xacro: name -> value
    group: Annotated[str | tuple[str, ...], group_of] | None = None
    """The planned joints: those of a group of the SRDF, or these joints; None: those of the arm."""
    base: Placement = field(default_factory=Pose)  # of the URDF's root link
    base_joints: PlanarBase | None = None  # planned joints that carry the root link; at 0 it stands there
    locked: Annotated[Mapping[str, float], Named(JointValue)] = field(default_factory=dict)  # joint -> [rad] or [m]
    ignore_pairs: Annotated[tuple[tuple[str, str], ...], Row(pair, of="link pairs")] = ()  # not checked
    check_pairs: Annotated[tuple[tuple[str, str], ...], Row(pair, of="link pairs")] = ()
    """Pairs that are checked, although the SRDF disables them or they are neighbours."""
    tracking: Tracking | None = None  # how far the joints may be off while the motion is executed
    calibration: Calibration | None = None  # how far the base may be from its nominal pose
    source: str = field(default="", compare=False)  # for error messages: file or option; empty: the scene's file

    if TYPE_CHECKING:

        def __init__(
            self,
            name: str | None = None,
            urdf: FilePath | None = None,
            srdf: FilePath | None = None,
            package_dirs: Sequence[FilePath] = (),
            xacro_args: Mapping[str, str | bool | float] = {},
            group: str | Sequence[str] | None = None,
            base: AnyPose = Pose(),
            base_joints: PlanarBase | None = None,
            locked: Mapping[str, float] = {},
            ignore_pairs: Sequence[Sequence[str]] = (),
            check_pairs: Sequence[Sequence[str]] = (),
            tracking: Tracking | None = None,
            calibration: Calibration | None = None,
            source: str = "",
        ) -> None: ...

    def _check_whole(self) -> None:
        for key in ("tracking", "calibration"):  # without a size there is none
            if (given := getattr(self, key)) is not None and given == type(given)():
                object.__setattr__(self, key, None)
        if (self.name is None) == (self.urdf is None):
            raise FieldError(f"must have either 'name' or 'urdf', found {'neither' if self.name is None else 'both'}")
        for key in ("srdf", "package_dirs", "xacro_args"):
            if self.name is not None and getattr(self, key):
                raise FieldError("goes with 'urdf'; a robot given by name brings its own", key)
        ignored = {frozenset(each) for each in self.ignore_pairs}
        for i, each in enumerate(self.check_pairs):
            if frozenset(each) in ignored:
                raise FieldError(f"{each[0]!r} and {each[1]!r} are in ignore_pairs too", f"check_pairs[{i}]")


def robot_spec(value: object) -> RobotSpec:
    """Return a robot, given as a RobotSpec or by its name alone."""
    if isinstance(value, str):
        return RobotSpec(name=value)
    if not isinstance(value, RobotSpec):
        raise wrong("the name of a robot, or a RobotSpec", value)
    return value
