"""A job: stages that a robot does one after the other, each beginning where the last one ended.

A stage moves the arm (`Move`, `Line`, `Circle`, `Along`), moves the fingers and takes hold of an object or releases
it (`Grip`, `Release`), sets outputs (`Set`), or waits (`Wait`). What each names is looked up when the job is planned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, get_args

from hdplan.scenes.curve_stages import Along, Circle, Line
from hdplan.scenes.errors import FieldError
from hdplan.scenes.limits import Limits
from hdplan.scenes.path_constraints import PathConstraints
from hdplan.scenes.stage import AnyStage, AnyTouch, ArmStage
from hdplan.scenes.targets import AnyGoal, Goals, JointTarget, goal_of
from hdplan.scenes.values import NEEDED, Checked, JointValue, Name, Named, Number, is_row, text, wrong

MOST_STAGES = 1000

Output = bool | float | str


@dataclass(frozen=True, repr=False)
class Move(ArmStage):
    """A stage in which the arm moves to a goal, in any form that a scene's goal has."""

    goal: Annotated[JointTarget | Goals, goal_of] = NEEDED
    path: PathConstraints = field(default_factory=PathConstraints)  # constraints in this stage

    if TYPE_CHECKING:

        def __init__(
            self,
            goal: AnyGoal = NEEDED,
            path: PathConstraints = PathConstraints(),
            *,
            name: str | None = None,
            touch: AnyTouch = (),
            limits: Limits | None = None,
            speed: float = 1.0,
            blend: float = 0.0,
        ) -> None: ...

    def _check_whole(self) -> None:
        if isinstance(self.goal, JointTarget) and self.goal.velocity is not None:
            raise FieldError("applies to a single motion: every stage of a job ends at rest", "goal.velocity")


@dataclass(frozen=True, repr=False)
class _Hand(AnyStage):
    """A stage in which fingers move to `joints` while the arm stands still."""

    joints: Annotated[Mapping[str, float], Named(JointValue)] = field(default_factory=dict)
    """Values of the fingers' joints, which the arm's stages hold [rad] or [m]; none for a hand without fingers."""
    object: Name | None = None

    if TYPE_CHECKING:

        def __init__(
            self,
            joints: Mapping[str, float] = {},
            object: str | None = None,
            *,
            name: str | None = None,
            touch: AnyTouch = (),
            limits: Limits | None = None,
            speed: float = 1.0,
        ) -> None: ...

    def _check_whole(self) -> None:
        if not self.joints and self.object is None:
            raise FieldError("must have 'joints', 'object' or both, found neither")


@dataclass(frozen=True, repr=False)
class Grip(_Hand):
    """A stage in which fingers close on an `object`, which is then held by `link` at its current pose; without an
    object they only move. Contacts of the object with the hand that `touch` allows are allowed until its release."""

    link: Name | None = None  # the link that carries the object; None: the end effector
    mass: Annotated[float, Number(above=0.0, unit="kg")] | None = None  # of the object; where torques are limited [kg]

    if TYPE_CHECKING:

        def __init__(
            self,
            joints: Mapping[str, float] = {},
            object: str | None = None,
            link: str | None = None,
            mass: float | None = None,
            *,
            name: str | None = None,
            touch: AnyTouch = (),
            limits: Limits | None = None,
            speed: float = 1.0,
        ) -> None: ...

    def _check_whole(self) -> None:
        super()._check_whole()
        for key in ("link", "mass"):
            if self.object is None and getattr(self, key) is not None:
                raise FieldError("goes with 'object', which is missing", key)


@dataclass(frozen=True, repr=False)
class Release(_Hand):
    """A stage in which fingers open and release an `object`, which stays in its place; without an object they only
    move."""


@dataclass(frozen=True, repr=False)
class Wait(AnyStage):
    """A stage in which the robot stands still."""

    seconds: Annotated[float, Number(high=1e4, above=0.0, unit="s")] = NEEDED  # [s]

    if TYPE_CHECKING:

        def __init__(
            self,
            seconds: float = NEEDED,
            *,
            name: str | None = None,
            touch: AnyTouch = (),
            limits: Limits | None = None,
            speed: float = 1.0,
        ) -> None: ...


def outputs_of(value: object) -> dict[str, Output]:
    """Return the values of outputs by name: true, false, numbers or texts."""
    found: dict[str, Output] = Named(_output)(value)
    if not found:
        raise FieldError("must name one output or more, found none")
    return found


def _output(value: object) -> Output:
    return value if isinstance(value, bool) else text(value) if isinstance(value, str) else Number()(value)


@dataclass(frozen=True, repr=False)
class Set(AnyStage):
    """A stage that sets outputs, by name, where it begins; the robot stands still for a moment. hdplan does not
    interpret them: the marks of the motion hold them."""

    outputs: Annotated[Mapping[str, Output], outputs_of] = NEEDED

    if TYPE_CHECKING:

        def __init__(
            self,
            outputs: Mapping[str, Output] = NEEDED,
            *,
            name: str | None = None,
            touch: AnyTouch = (),
            limits: Limits | None = None,
            speed: float = 1.0,
        ) -> None: ...


Stage = Move | Line | Circle | Along | Grip | Release | Set | Wait
KINDS: Mapping[str, type[Stage]] = {kind.__name__.lower(): kind for kind in get_args(Stage)}


def stages_of(value: object) -> tuple[Stage, ...]:
    """Return stages, each with a name of its own."""
    if not is_row(value) or not len(value):
        raise wrong("a list of one or more stages", value)
    if len(value) > MOST_STAGES:
        raise FieldError(f"has {len(value)} stages, at most {MOST_STAGES} are allowed")
    names: dict[str, int] = {}
    for i, stage in enumerate(value):
        if not isinstance(stage, get_args(Stage)):
            raise wrong(f"a stage: {', '.join(kind.__name__ for kind in get_args(Stage))}", stage).within(f"[{i}]")
        name = stage_name(stage, i)
        if name in names:
            raise FieldError(f"the name {name!r} is that of stage {names[name]} too; names must differ", f"[{i}]")
        names[name] = i
    for i, (stage, following) in enumerate(zip(value, [*value[1:], None], strict=True)):
        if why := _unblended(stage, following):
            raise FieldError(f"stage '{stage_name(stage, i)}' {why}", f"[{i}].blend")
    return tuple(value)


def _unblended(stage: Stage, following: Stage | None) -> str:
    """Return the reason why a stage cannot be blended into the next one as it specifies; empty if it can, or does not
    ask."""
    if not isinstance(stage, ArmStage) or not stage.blend:
        return ""
    if following is None:
        return "is the last stage, which ends at rest: there is no next stage for a blend"
    if not isinstance(following, ArmStage):
        return f"ends at rest: in '{following.kind}', which follows, the arm stands still"
    if stage.limits != following.limits:
        return "has other limits than the stage into which it is blended: they are timed as one motion"
    return ""


def stage_name(stage: Stage, number: int) -> str:
    """Return a stage's own name, or its kind and number, counted from 0."""
    return stage.name if stage.name is not None else f"{stage.kind} {number}"


@dataclass(frozen=True, repr=False)
class Job(Checked):
    """A sequence of stages.

        job = hdplan.Job([
            hdplan.Move(hdplan.Pose.from_rpy([0.5, 0.0, 0.4], [3.1416, 0.0, 0.0])),
            hdplan.Line(by=[0.0, 0.0, -0.1]),
            hdplan.Wait(0.5),
        ])

    Raises InputError for an empty list, for anything but stages, and for two stages of one name.
    """

    stages: Annotated[tuple[Stage, ...], stages_of] = NEEDED

    if TYPE_CHECKING:

        def __init__(self, stages: Sequence[Stage] = NEEDED) -> None: ...

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the stages."""
        return tuple(stage_name(stage, i) for i, stage in enumerate(self.stages))

    def handling(self, name: str) -> str | None:
        """Return the first stage that grips an object, or in which something may touch it; None if there is none."""
        for found, stage in zip(self.names, self.stages, strict=True):
            if getattr(stage, "object", None) == name or any(name in pair for pair in stage.touch):
                return found
        return None
