"""Starts and goals: configurations, poses of a link, and goals with several alternatives."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from hdplan.scenes.errors import FieldError
from hdplan.scenes.poses import AnyPose, Placement, Pose
from hdplan.scenes.values import (
    NEEDED,
    Checked,
    Choice,
    JointValue,
    Name,
    Named,
    Number,
    Numbers,
    PerJoint,
    Row,
    checked,
    is_row,
    text,
    wrong,
)

FREE_ROTATIONS = ("none", "x", "y", "z", "all")
NO_TURN = "has no meaning with free_rotation: all, which allows any orientation; leave it out"

JointRates = tuple[float, ...] | Mapping[str, float]
"""A rate for each joint: in the order of the planned joints, or by name, the others 0."""


def joint_rates(unit: str) -> PerJoint:
    """Return the check of rates of the joints, as a list or by name."""
    allowed = f"a list of numbers, or a mapping from joint names to numbers [{unit}]"
    return PerJoint(Number(unit=unit), allowed, single=False)


@dataclass(frozen=True, repr=False)
class JointTarget(Checked):
    """A configuration as the scene gives it, by exactly one of `positions`, `by_name` and `state`; and how the robot
    moves through it: at rest by default."""

    field: str = dataclasses.field(
        compare=False, repr=False
    )  # where it stands in the file, for error messages: "start" or "goal"
    positions: Annotated[tuple[float, ...], Row(JointValue)] | None = None  # in the order of the planned joints
    by_name: Annotated[Mapping[str, float], Named(JointValue)] | None = None  # joint name -> value
    state: Name | None = None  # a named state of the SRDF
    velocity: Annotated[JointRates, joint_rates("rad/s or m/s")] | None = None  # None: at rest, and nobody asks
    acceleration: Annotated[JointRates, joint_rates("rad/s² or m/s²")] | None = (
        None  # None: 0 where there is a velocity
    )

    @property
    def moves(self) -> bool:
        """True if the robot is not at rest there."""
        return any(any(_values(rates)) for rates in (self.velocity, self.acceleration))

    def _check_whole(self) -> None:
        given = [name for name in ("positions", "by_name", "state") if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none of them"
            raise FieldError(f"must have exactly one of positions, by_name and state, found {found}")
        if not getattr(self, given[0]):
            raise FieldError("must not be empty", given[0])
        if self.acceleration is not None and self.velocity is None:
            raise FieldError("needs a velocity beside it, which may be 0", "acceleration")


def _values(rates: JointRates | None) -> Iterable[float]:
    return rates.values() if isinstance(rates, Mapping) else rates or ()


@dataclass(frozen=True, repr=False)
class PoseTarget(Checked):
    """A goal pose of a link: its origin within a ball, its orientation within an angle."""

    link: Name | None = None  # None: the end effector of the planned joints
    pose: Placement = NEEDED  # of the link's frame, in the world
    position_tolerance: Annotated[float, Number(high=1.0, above=0.0, unit="m")] = 1e-3  # of the link's origin [m]
    orientation_tolerance: Annotated[float, Number(high=math.pi, above=0.0, unit="rad")] = 1e-2
    """The tolerance of its orientation, beside its free rotation [rad]."""
    free_rotation: Annotated[str, Choice(FREE_ROTATIONS)] = "none"
    """The axis of the link about which it may rotate freely: none, x, y, z, or all (any orientation)."""
    field: str = dataclasses.field(
        default="goal", compare=False, repr=False
    )  # where it stands in the file: "goal.poses[1]"

    if TYPE_CHECKING:

        def __init__(
            self,
            link: str | None = None,
            pose: AnyPose = NEEDED,
            position_tolerance: float = 1e-3,
            orientation_tolerance: float = 1e-2,
            free_rotation: str = "none",
            field: str = "goal",
        ) -> None: ...

    @property
    def poses(self) -> tuple[PoseTarget, ...]:
        """The poses that are reached together: this one alone."""
        return (self,)

    def _check_whole(self) -> None:
        if self.free_rotation != "all":
            return
        if self.orientation_tolerance != PoseTarget.orientation_tolerance:
            raise FieldError(NO_TURN, "orientation_tolerance")
        if self.pose.quaternion_xyzw != Pose.quaternion_xyzw:
            raise FieldError(NO_TURN, "pose.quaternion_xyzw")


def _together(value: object) -> tuple[object, ...]:
    if not isinstance(value, list | tuple) or len(value) < 2 or {type(each) for each in value} != {PoseTarget}:
        raise wrong("a list of two or more PoseTargets", value)
    return tuple(value)


@dataclass(frozen=True, repr=False)
class AllOf(Checked):
    """Goal poses of different links, reached together by one configuration: one for each of two arms."""

    poses: Annotated[tuple[PoseTarget, ...], _together]
    field: str = dataclasses.field(default="goal", compare=False, repr=False)  # where it stands in the file: "goal.all"

    if TYPE_CHECKING:

        def __init__(self, poses: Sequence[PoseTarget], field: str = "goal") -> None: ...

    def _check_whole(self) -> None:
        if wrong_one := unlike_the_others(self.poses):
            raise FieldError(wrong_one[1], f"poses[{wrong_one[0]}]")


def unlike_the_others(poses: Sequence[PoseTarget]) -> tuple[int, str] | None:
    """Return the one of several poses that does not have a link of its own, and the fault; None if all are."""
    links = [target.link for target in poses]
    for i, link in enumerate(links):
        if link is None:
            return i, "names no link: each of several poses must name its own"
        if link in links[:i]:
            return i, f"the link {link!r} has a pose already: each of several poses must name its own"
    return None


def _choices(value: object) -> tuple[object, ...]:
    kinds = {type(target) for target in value} if isinstance(value, list | tuple) else set()
    if not isinstance(value, list | tuple) or not kinds or not kinds <= {JointTarget, PoseTarget, AllOf}:
        raise wrong("a list of one or more JointTargets and PoseTargets, or one AllOf", value)
    if AllOf in kinds and len(value) > 1:
        raise wrong("one AllOf alone", value)
    return tuple(value)


@dataclass(frozen=True, repr=False)
class Goals(Checked):
    """A goal with a choice: any of these targets will do, and any configuration that reaches a pose."""

    targets: Annotated[tuple[JointTarget | PoseTarget, ...] | tuple[AllOf], _choices]
    """Configurations and poses, or poses of several links together."""
    field: str = dataclasses.field(
        default="goal", compare=False, repr=False
    )  # where it stands in the file, for error messages

    def _check_whole(self) -> None:
        for target in self.targets:
            if isinstance(target, JointTarget) and target.velocity is not None:
                raise FieldError("one of several goals has a velocity: motions to a choice of goals end at rest")


@dataclass(frozen=True)
class Configuration:
    """A configuration in any of its forms: values in the order of the joints, values by joint name, or a named
    state."""

    field: str
    allowed: str = "a list of joint values, a mapping from joint names to values [rad or m], or the name of a state"

    def __call__(self, value: object) -> JointTarget:
        """The pose as a target."""
        if isinstance(value, JointTarget):
            return value
        if isinstance(value, State):
            return dataclasses.replace(
                value.joints, field=self.field, velocity=value.velocity, acceleration=value.acceleration
            )
        if isinstance(value, str):
            return JointTarget(self.field, state=text(value))
        if isinstance(value, Mapping) and value:
            return JointTarget(self.field, by_name=Named(JointValue)(value))
        if is_row(value) and len(value):
            return JointTarget(self.field, Row(JointValue)(value))
        raise wrong(self.allowed, value)


@dataclass(frozen=True, repr=False)
class State(Checked):
    """A state of a moving robot: its joint values in any form of a configuration, their velocities [rad/s or m/s] and
    accelerations [rad/s² or m/s²], each in the order of the joints, or by name, the others 0.

        scene = scene.with_start(hdplan.State(q, velocity=dq))
    """

    joints: Annotated[JointTarget, Configuration("joints")]
    velocity: Annotated[JointRates, joint_rates("rad/s or m/s")] | None = None
    acceleration: Annotated[JointRates, joint_rates("rad/s² or m/s²")] | None = None

    if TYPE_CHECKING:

        def __init__(
            self,
            joints: AnyConfiguration,
            velocity: Numbers | Mapping[str, float] | None = None,
            acceleration: Numbers | Mapping[str, float] | None = None,
        ) -> None: ...

    def _check_whole(self) -> None:
        if self.acceleration is not None and self.velocity is None:
            raise FieldError("needs a velocity beside it, which may be 0", "acceleration")


AnyConfiguration = JointTarget | State | Numbers | Mapping[str, float] | str
AnyGoal = AnyConfiguration | Goals | Pose | PoseTarget | AllOf | Sequence[AnyConfiguration | Pose | PoseTarget]


def goal_of(value: object) -> JointTarget | Goals:
    """Return a goal in any of its forms: a configuration, a link's pose (a Pose is that of the end effector), or a list
    of these, any of which will do; or poses of several links together."""
    if isinstance(value, Goals):
        return value
    if isinstance(value, Pose):
        value = PoseTarget(pose=value)
    if isinstance(value, PoseTarget | AllOf):
        return Goals((value,))  # type: ignore[arg-type]
    if not is_row(value) or not any(is_row(each) or isinstance(each, _SEVERAL) for each in value):
        return Configuration("goal", f"{Configuration.allowed}, a Pose, a PoseTarget, a list of these, or an AllOf")(
            value
        )
    targets: list[JointTarget | PoseTarget | AllOf] = []
    for i, each in enumerate(value):
        place = f"goal[{i}]"
        if isinstance(each, Pose):
            targets.append(PoseTarget(pose=each, field=place))
        elif isinstance(each, PoseTarget | AllOf):
            targets.append(dataclasses.replace(each, field=place))
        else:
            targets.append(checked(Configuration(place), each, f"[{i}]"))
    return Goals(targets)  # type: ignore[arg-type]


_SEVERAL = (Mapping, JointTarget, State, Pose, PoseTarget, AllOf)  # not a joint value, and so one of several targets
