"""Obstacles, static or moving, and the robot itself: the bodies from which it keeps clear."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, get_args

from hdplan.scenes.clouds import Cloud
from hdplan.scenes.errors import FieldError
from hdplan.scenes.poses import AnyPose, Placement, Pose, Vector3
from hdplan.scenes.shapes import Shape, Solid, check_unplaced
from hdplan.scenes.sizes import Uncertainty
from hdplan.scenes.values import Checked, Name, Number, Numbers, Row, checked, is_row, wrong
from hdplan.scenes.voxel_grids import OctoMap, Voxels

Seen = Cloud | Voxels | OctoMap  # what a camera or a map gives, in place of a shape
Clearance = Annotated[float, Number(0.0, 1.0, unit="m")]


def rising_times(value: object) -> tuple[float, ...]:
    """Return two or more times [s], the first at least 0, each later than the one before."""
    times = Row(Number(low=0.0, unit="s"), of="times")(value)
    if len(times) < 2:
        raise FieldError(f"must be two or more times [s], found {len(times)}")
    for before, after in itertools.pairwise(times):
        if not before < after:
            raise FieldError(f"must increase [s], found {before:g} before {after:g}")
    return times


@dataclass(frozen=True, repr=False)
class SteadyMotion(Checked):
    """A motion with `velocity` [m/s] and `spin` [rad/s] about the body's origin, both constant and in the
    world, beginning with its pose at time 0."""

    velocity: Annotated[Vector3, Row(Number(unit="m/s"), 3)] = (0.0, 0.0, 0.0)
    spin: Annotated[Vector3, Row(Number(unit="rad/s"), 3)] = (0.0, 0.0, 0.0)

    if TYPE_CHECKING:

        def __init__(self, velocity: Numbers = (0.0, 0.0, 0.0), spin: Numbers = (0.0, 0.0, 0.0)) -> None: ...


@dataclass(frozen=True, repr=False)
class TimedPoses(Checked):
    """A motion through `poses` in the world at `times` [s]: at constant velocities from each to the next, at rest
    before the first and after the last."""

    times: Annotated[tuple[float, ...], rising_times]  # increasing, at least two [s]
    poses: tuple[Placement, ...]  # one at each time, in the world

    if TYPE_CHECKING:

        def __init__(self, times: Numbers, poses: Sequence[AnyPose]) -> None: ...

    def _check_whole(self) -> None:
        if len(self.poses) != len(self.times):
            raise FieldError(f"must be as many as the {len(self.times)} times, found {len(self.poses)}", "poses")


@dataclass(frozen=True, repr=False)
class Obstacle(Checked):
    """A body in the world; static unless it has a motion."""

    name: Name
    shape: Shape | Cloud | Voxels | OctoMap
    pose: Placement = field(default_factory=Pose)  # at time 0, if it moves; with timed poses, the first of them
    clearance: Clearance | None = None  # to be proven around it [m]; None: planner.clearance
    motion: SteadyMotion | TimedPoses | None = None
    uncertainty: Uncertainty | None = None  # how far it may be from there

    if TYPE_CHECKING:

        def __init__(
            self,
            name: str,
            shape: Solid | Seen,
            pose: AnyPose = Pose(),
            clearance: float | None = None,
            motion: SteadyMotion | TimedPoses | None = None,
            uncertainty: Uncertainty | None = None,
        ) -> None: ...

    @property
    def moves(self) -> bool:
        """True if the obstacle may be elsewhere at another time."""
        return self.motion is not None or (self.uncertainty is not None and self.uncertainty.speed > 0.0)

    def _check_whole(self) -> None:
        check_unplaced(self.shape, "obstacle")
        if self.uncertainty == Uncertainty():  # nothing is unknown
            object.__setattr__(self, "uncertainty", None)
        if isinstance(self.motion, TimedPoses):
            first = self.motion.poses[0]
            if self.pose not in (Pose(), first):
                raise FieldError("is given twice: motion.poses give the obstacle's poses, so leave it out", "pose")
            object.__setattr__(self, "pose", first)


@dataclass(frozen=True, repr=False)
class SelfCollision(Checked):
    """The clearance of links and held objects from each other."""

    checked: bool = True
    clearance: Clearance = 0.0  # to be proven between them [m]

    def _check_whole(self) -> None:
        if self.clearance and not self.checked:
            raise FieldError("has no meaning if nothing is checked; leave it out", "clearance")


def obstacles_of(value: object) -> tuple[Obstacle, ...]:
    """Return obstacles; a shape becomes an obstacle with its own name and pose, or the defaults of a file."""
    if not is_row(value):
        raise wrong("a list of obstacles", value)
    return tuple(checked(_obstacle_of(i), each, f"[{i}]") for i, each in enumerate(value))


def _obstacle_of(place: int) -> Callable[[object], Obstacle]:
    def made(value: object) -> Obstacle:
        if isinstance(value, Obstacle):
            return value
        if not isinstance(value, Solid | Seen):
            shapes = ", ".join(kind.__name__ for kind in (*get_args(Shape), *get_args(Seen)))
            raise wrong(f"an Obstacle, or one of the shapes {shapes}", value)
        bare: Any = dataclasses.replace(value, name=None, pose=None)
        return Obstacle(value.name or f"obstacle{place}", bare, value.pose or Pose())

    return made
