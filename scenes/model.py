"""What a scene says: frozen data, no files, no geometry code.

Lengths in metres, angles in radians, frames: world unless said. Every value is checked when something is made of it,
whoever makes it: a file's reader or a program (`values`, `meaning`); what is not allowed raises an `InputError`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hdplan.scenes import meaning
from hdplan.scenes.errors import FieldError
from hdplan.scenes.output import check_writable, write_output
from hdplan.scenes.values import (
    Checked,
    Choice,
    Named,
    Number,
    Row,
    Whole,
    absolute_path,
    checked,
    is_row,
    path_of,
    text,
    wrong,
)

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

Name = Annotated[str, text]
Place = Annotated[Vector3, Row(Number(unit="m"), 3)]
Length = Annotated[float, Number(above=0.0, unit="m")]
Clearance = Annotated[float, Number(0.0, 1.0, unit="m")]
JointValue = Number(unit="rad or m")
FREE_ROTATIONS = ("none", "x", "y", "z", "all")
NO_TURN = "has no meaning with free_rotation: all, which lets the link turn as it likes; leave it out"
MOST_ROWS = 100_000  # of a motion in time
LINK_BODIES = ("fitted", "capsule", "outer-4", "outer-12", "box", "hull")
SCENE_FILES = (".yaml", ".yml")
NEEDED: Any = None  # default of a field behind others that have one: its check finds nothing and says what it wants


@dataclass(frozen=True, repr=False)
class Pose(Checked):
    """A placement: position [m] and unit quaternion (x, y, z, w); maps the object's frame into its parent's.

    Raises InputError for a position that is not three finite numbers, and for a quaternion whose length is not 1 to a
    hundredth; one nearer than that is normalized.
    """

    position: Place = (0.0, 0.0, 0.0)
    quaternion_xyzw: Annotated[Quaternion, meaning.rotation] = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def from_rpy(cls, position: Vector3, rpy: Vector3) -> Pose:
        """Return the pose at `position` [m] that is turned by roll, pitch and yaw [rad], R = Rz(yaw) Ry(pitch)
        Rx(roll), as URDF has it. Raises InputError for what is not three finite numbers."""
        return cls(position, meaning.from_rpy(*checked(Row(Number(unit="rad"), 3), rpy, "rpy")))

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """The same as a homogeneous matrix (4, 4)."""
        x, y, z, w = self.quaternion_xyzw
        transform = np.eye(4)
        transform[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        transform[:3, 3] = self.position
        transform.setflags(write=False)
        return transform


def placement(value: object) -> Pose:
    """Return a pose given as one, or as its position alone."""
    if isinstance(value, Pose):
        return value
    if not is_row(value) or len(value) != 3:
        raise wrong("a Pose, or a position of three numbers [m]", value)
    return Pose(value)  # type: ignore[arg-type]


Placement = Annotated[Pose, placement]


@dataclass(frozen=True, repr=False)
class _Solid(Checked):
    """A shape. In a scene's list of obstacles it may say itself what it is called and where it stands."""

    name: Name | None = field(default=None, kw_only=True)  # None: obstacle0, obstacle1, … by its place in the list
    pose: Placement | None = field(default=None, kw_only=True)  # in the world; None: at its origin


@dataclass(frozen=True, repr=False)
class Box(_Solid):
    """A box centred in its frame."""

    size: Annotated[Vector3, Row(Number(above=0.0, unit="m"), 3)]  # full edge lengths [m]


@dataclass(frozen=True, repr=False)
class Sphere(_Solid):
    """A ball centred in its frame."""

    radius: Length  # [m]


@dataclass(frozen=True, repr=False)
class Ellipsoid(_Solid):
    """An ellipsoid centred in its frame, its axes along x, y and z."""

    radii: Annotated[Vector3, Row(Number(above=0.0, unit="m"), 3)]  # half axes [m]


@dataclass(frozen=True, repr=False)
class Cylinder(_Solid):
    """A right circular cylinder centred in its frame, axis z."""

    radius: Length  # [m]
    length: Length  # [m]


@dataclass(frozen=True, repr=False)
class Capsule(_Solid):
    """A segment on the z axis, centred, swept by a ball."""

    radius: Length  # [m]
    length: Annotated[float, Number(low=0.0, unit="m")]  # between the centres of the two end spheres [m]


@dataclass(frozen=True, repr=False)
class Points(_Solid):
    """The convex hull of points."""

    points: Annotated[tuple[Vector3, ...], meaning.volume]  # in the obstacle's frame [m]


@dataclass(frozen=True, repr=False)
class Mesh(_Solid):
    """A triangle mesh read from a file (anything that trimesh reads)."""

    file: Annotated[Path, absolute_path]
    scale: Annotated[Vector3, meaning.scale] = (1.0, 1.0, 1.0)  # factor along each axis of the file


Shape = Box | Sphere | Ellipsoid | Cylinder | Capsule | Points | Mesh


def _check_unplaced(shape: Shape, owner: str) -> None:
    """Refuse a shape that says itself what only its owner may say."""
    for key in ("name", "pose"):
        if getattr(shape, key) is not None:
            raise FieldError(f"is the {owner}'s to say: give it there, not to its shape", f"shape.{key}")


@dataclass(frozen=True, repr=False)
class SteadyMotion(Checked):
    """A body moves and turns evenly, from its pose at time 0 on."""

    velocity: Annotated[Vector3, Row(Number(unit="m/s"), 3)] = (0.0, 0.0, 0.0)  # of its origin, in the world [m/s]
    spin: Annotated[Vector3, Row(Number(unit="rad/s"), 3)] = (0.0, 0.0, 0.0)  # about its origin, in the world [rad/s]


@dataclass(frozen=True, repr=False)
class TimedPoses(Checked):
    """A body passes through poses: evenly from one to the next, at rest before the first and after the last."""

    times: Annotated[tuple[float, ...], meaning.rising]  # rising, at least two [s]
    poses: tuple[Pose, ...]  # one at each time, in the world

    def _check_whole(self) -> None:
        if len(self.poses) != len(self.times):
            raise FieldError(f"must be as many as the {len(self.times)} times, found {len(self.poses)}", "poses")


@dataclass(frozen=True, repr=False)
class Obstacle(Checked):
    """A body in the world; it stands still unless it has a motion."""

    name: Name
    shape: Shape
    pose: Placement = field(default_factory=Pose)  # at time 0, where it moves; of timed poses the first
    clearance: Clearance | None = None  # to be proven free around it [m]; None: planner.clearance
    motion: SteadyMotion | TimedPoses | None = None

    def _check_whole(self) -> None:
        _check_unplaced(self.shape, "obstacle")
        if isinstance(self.motion, TimedPoses):
            first = self.motion.poses[0]
            if self.pose not in (Pose(), first):
                raise FieldError("stands beside motion.poses, which say where the obstacle is: leave it out", "pose")
            object.__setattr__(self, "pose", first)


@dataclass(frozen=True, repr=False)
class Attached(Checked):
    """A body that a link holds: it moves with the link and collides as the link does."""

    name: Name
    link: Name
    shape: Shape
    pose: Placement = field(default_factory=Pose)  # in the link's frame
    touch_links: Annotated[tuple[str, ...], Row(text, of="link names")] = ()  # that it may touch, beside its own
    mass: Annotated[float, Number(above=0.0, unit="kg")] | None = None
    """[kg] of even density; counts where joint torques do (limits.torque). None: it weighs nothing."""

    def _check_whole(self) -> None:
        _check_unplaced(self.shape, "held object")


@dataclass(frozen=True, repr=False)
class Payload(Checked):
    """A mass that a link carries beside its own; it touches nothing."""

    link: Name
    mass: Annotated[float, Number(above=0.0, unit="kg")]  # [kg]
    com: Place = (0.0, 0.0, 0.0)  # its centre, in the link's frame [m]
    inertia: Annotated[tuple[float, float, float, float, float, float], meaning.inertia] = (0.0,) * 6
    """xx, xy, xz, yy, yz, zz about its centre, in the link's axes [kg m²]."""


@dataclass(frozen=True, repr=False)
class RobotSpec(Checked):
    """Which robot, where it stands, and what the scene fixes about it."""

    name: Name | None = None  # of example-robot-data; or else a URDF:
    urdf: Annotated[Path, absolute_path] | None = None
    srdf: Annotated[Path, absolute_path] | None = None
    package_dirs: Annotated[
        tuple[Path, ...], Row(absolute_path, of="folders")
    ] = ()  # where package:// addresses of the URDF are looked up
    group: Name | None = None  # of the SRDF: its joints are planned; None: those of its arm
    base: Placement = field(default_factory=Pose)  # of the URDF's root link
    locked: Annotated[Mapping[str, float], Named(JointValue)] = field(default_factory=dict)  # joint -> [rad] or [m]
    ignore_pairs: Annotated[tuple[tuple[str, str], ...], Row(meaning.pair, of="link pairs")] = ()  # not checked
    source: str = field(default="", compare=False)  # for error messages: the file or option; empty: the scene's file

    def _check_whole(self) -> None:
        if (self.name is None) == (self.urdf is None):
            raise FieldError(f"must have either 'name' or 'urdf', found {'neither' if self.name is None else 'both'}")
        for key in ("srdf", "package_dirs"):
            if self.name is not None and getattr(self, key):
                raise FieldError("goes with 'urdf'; a robot given by name brings its own", key)


def robot_spec(value: object) -> RobotSpec:
    """Return which robot is meant, given as a RobotSpec or by its name alone."""
    if isinstance(value, str):
        return RobotSpec(name=value)
    if not isinstance(value, RobotSpec):
        raise wrong("the name of a robot, or a RobotSpec", value)
    return value


@dataclass(frozen=True, repr=False)
class JointTarget(Checked):
    """A configuration as the scene writes it: exactly one of the last three is given."""

    field: str = dataclasses.field(
        compare=False, repr=False
    )  # where it stands in the file, for error messages: "start" or "goal"
    positions: Annotated[tuple[float, ...], Row(JointValue)] | None = None  # in the order of the planned joints
    by_name: Annotated[Mapping[str, float], Named(JointValue)] | None = None  # joint name -> value
    state: Name | None = None  # a named state of the SRDF

    def _check_whole(self) -> None:
        given = [name for name in ("positions", "by_name", "state") if getattr(self, name) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none of them"
            raise FieldError(f"must have exactly one of positions, by_name and state, found {found}")
        if not getattr(self, given[0]):
            raise FieldError("must not be empty", given[0])


@dataclass(frozen=True, repr=False)
class PoseTarget(Checked):
    """Where a link is to be: origin within a ball, and turned by no more than an angle away."""

    link: Name
    pose: Pose  # of the link's frame, in the world
    position_tolerance: Annotated[float, Number(high=1.0, above=0.0, unit="m")] = 1e-3  # of the link's origin [m]
    orientation_tolerance: Annotated[float, Number(high=math.pi, above=0.0, unit="rad")] = 1e-2
    """How far it may be turned away, its free turns left out [rad]."""
    free_rotation: Annotated[str, Choice(FREE_ROTATIONS)] = "none"
    """About which axis of the link it may turn freely: none, x, y, z, or all (any turn)."""
    field: str = dataclasses.field(
        default="goal", compare=False, repr=False
    )  # where it stands in the file: "goal.poses[1]"

    def _check_whole(self) -> None:
        if self.free_rotation != "all":
            return
        if self.orientation_tolerance != PoseTarget.orientation_tolerance:
            raise FieldError(NO_TURN, "orientation_tolerance")
        if self.pose.quaternion_xyzw != Pose.quaternion_xyzw:
            raise FieldError(NO_TURN, "pose.quaternion_xyzw")


def _choices(value: object) -> tuple[object, ...]:
    kinds = {type(target) for target in value} if isinstance(value, list | tuple) else set()
    if not isinstance(value, list | tuple) or kinds not in ({JointTarget}, {PoseTarget}):
        raise wrong("a list of one or more JointTargets, or of PoseTargets", value)
    return tuple(value)


@dataclass(frozen=True, repr=False)
class Goals(Checked):
    """A goal that leaves a choice: any of these targets will do, and any configuration that reaches a pose."""

    targets: Annotated[tuple[JointTarget, ...] | tuple[PoseTarget, ...], _choices]  # configurations by values, or poses
    field: str = dataclasses.field(
        default="goal", compare=False, repr=False
    )  # where it stands in the file, for error messages


@dataclass(frozen=True)
class _Configuration:
    """A configuration in any of its forms: values in the order of the joints, by their names, or a named state."""

    field: str
    allowed: str = "a list of joint values, a mapping from joint names to values [rad or m], or the name of a state"

    def __call__(self, value: object) -> JointTarget:
        """Return it as a target."""
        if isinstance(value, JointTarget):
            return value
        if isinstance(value, str):
            return JointTarget(self.field, state=text(value))
        if isinstance(value, Mapping) and value:
            return JointTarget(self.field, by_name=Named(JointValue)(value))
        if is_row(value) and len(value):
            return JointTarget(self.field, Row(JointValue)(value))
        raise wrong(self.allowed, value)


def _goal(value: object) -> JointTarget | Goals:
    """Return a goal in any of its forms: a configuration, a link's pose, or a list of either, any of which will do."""
    if isinstance(value, Goals):
        return value
    if isinstance(value, PoseTarget):
        return Goals((value,))
    if not is_row(value) or not any(is_row(each) or isinstance(each, _SEVERAL) for each in value):
        return _Configuration("goal", f"{_Configuration.allowed}, a PoseTarget, or a list of any one of these")(value)
    targets = []
    for i, each in enumerate(value):
        place = f"goal[{i}]"
        if isinstance(each, PoseTarget):
            targets.append(dataclasses.replace(each, field=place))
        else:
            targets.append(checked(_Configuration(place), each, f"[{i}]"))
    return Goals(targets)  # type: ignore[arg-type]


_SEVERAL = (Mapping, JointTarget, PoseTarget)  # what is no joint value, and so one of several targets


def _obstacles(value: object) -> tuple[Obstacle, ...]:
    """Return obstacles; a shape becomes one, with the name and pose that it says or those that a file would give it."""
    if not is_row(value):
        raise wrong("a list of obstacles", value)
    return tuple(checked(_obstacle_of(i), each, f"[{i}]") for i, each in enumerate(value))


def _obstacle_of(place: int) -> Callable[[object], Obstacle]:
    def made(value: object) -> Obstacle:
        if isinstance(value, Obstacle):
            return value
        if not isinstance(value, _Solid):
            shapes = ", ".join(kind.__name__ for kind in get_args(Shape))
            raise wrong(f"an Obstacle, or one of the shapes {shapes}", value)
        bare: Any = dataclasses.replace(value, name=None, pose=None)
        return Obstacle(value.name or f"obstacle{place}", bare, value.pose or Pose())

    return made


@dataclass(frozen=True, repr=False)
class SelfCollision(Checked):
    """What links and held objects are to keep from each other."""

    checked: bool = True
    clearance: Clearance = 0.0  # to be proven free between them [m]

    def _check_whole(self) -> None:
        if self.clearance and not self.checked:
            raise FieldError("has no meaning where nothing is checked; leave it out", "clearance")


FromUrdf = Literal["urdf"]
JointValues = FromUrdf | float | tuple[float, ...] | Mapping[str, float]
"""A value for each joint: the URDF's, the same for all, one each in the order of the planned joints, or by name (the
others keep the URDF's)."""


RATES = {
    "velocity": meaning.JointRates("velocity", "rad/s or m/s", order=1, in_urdf=True),
    "acceleration": meaning.JointRates("acceleration", "rad/s² or m/s²", order=2),
    "jerk": meaning.JointRates("jerk", "rad/s³ or m/s³", order=3),
    "torque": meaning.JointRates("torque", "Nm or N", in_urdf=True),
}
"""Limits beside those of positions."""


@dataclass(frozen=True, repr=False)
class Limits(Checked):
    """What the joints can do, beside what the URDF says of their positions; None: does not matter here."""

    position: Annotated[Mapping[str, tuple[float, float]], meaning.ranges] = field(default_factory=dict)
    """Joint -> range within the URDF's [rad] or [m]."""
    velocity: Annotated[JointValues | None, RATES["velocity"]] = None  # as soon as the motion is timed: the URDF's
    acceleration: Annotated[JointValues | None, RATES["acceleration"]] = None
    jerk: Annotated[JointValues | None, RATES["jerk"]] = None
    torque: Annotated[JointValues | None, RATES["torque"]] = None


@dataclass(frozen=True, repr=False)
class Timing(Checked):
    """When the motion is where."""

    duration: Annotated[float, Number(above=0.0, unit="s")] | None = None  # of the whole motion [s]; None: the fastest
    scale: Annotated[float, Number(high=1.0, above=0.0)] = 1.0  # share of the speed that the limits allow
    rate: Annotated[float, Number(1.0, 1e4, unit="1/s")] = 100.0  # rows of the result in a second [1/s]

    def _check_whole(self) -> None:
        if self.duration is None:
            return
        if self.scale != 1.0:
            raise FieldError("has both 'duration' and 'scale'; a duration leaves nothing to scale: give one of them")
        if self.duration * self.rate > MOST_ROWS:
            raise FieldError(
                f"{self.duration:g} s are {self.duration * self.rate:.4g} rows at a rate of {self.rate:g} 1/s, at most "
                f"{MOST_ROWS} are kept: give a shorter duration or a lower rate",
                "duration",
            )


@dataclass(frozen=True, repr=False)
class Upright(Checked):
    """A link's axis stays close to the world's upward direction, all the way."""

    link: Name
    axis: Annotated[Vector3, meaning.direction] = (0.0, 0.0, 1.0)  # in the link's frame, of length one
    tolerance: Annotated[float, Number(high=math.pi, above=0.0, unit="rad")] = 0.1  # of its turn away [rad]


@dataclass(frozen=True, repr=False)
class Within(Checked):
    """A point of a link stays in a box, all the way."""

    link: Name
    size: Annotated[Vector3, meaning.extent]  # full edge lengths of the box [m]; inf where any place will do
    pose: Pose = field(default_factory=Pose)  # of the box's centre, in the world
    point: Place = (0.0, 0.0, 0.0)  # in the link's frame [m]


@dataclass(frozen=True, repr=False)
class PathConstraints(Checked):
    """What must hold all along the way, between the waypoints too."""

    upright: Upright | None = None
    position: Within | None = None


@dataclass(frozen=True, repr=False)
class PlannerSettings(Checked):
    """The `planner` section. Every value has a default; `hdplan explain` shows the ones in force."""

    waypoints: Annotated[int, Whole(3, 1000)] = 32  # number of rows of the trajectory, start and goal included
    clearance: Annotated[float, Number(0.0, 1.0)] = 0.0  # what must be proven free around the robot [m]
    activation: Annotated[float, Number(0.0, 1.0)] = 0.02  # beyond the clearance, where the penalty sets in [m]
    gamma: Annotated[int, Whole(1, 32)] = 2  # order of differentiability of the distance
    shaping_length: Annotated[float, Number(1e-9, 1.0)] = 1e-3  # width of the distance's flat spot at contact [m]
    distance: Annotated[str, Choice(("hdsdf", "fcl"))] = "hdsdf"  # of the obstacle penalty: fcl is the exact one
    link_bodies: Annotated[str, Choice(LINK_BODIES)] = "fitted"  # what encloses a link
    swept: bool = False  # hulls of link bodies at neighbouring waypoints in place of samples between them
    normals: Annotated[str, Choice(("faces", "box", "sphere"))] = "box"
    """Planes of an obstacle: faces (6 of a box), box (26) or sphere (122)."""


@dataclass(frozen=True, repr=False)
class Scene(Checked):
    """One planning problem, whole. Scenes are equal that say the same, whatever file they come from, or none.

        scene = hdplan.Scene(
            robot="panda",
            obstacles=[hdplan.Box([0.1, 0.1, 0.6], pose=[0.6, 0.0, 0.3])],
            start="default",
            goal=[0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785],
        )

    Give arguments by their names. `robot` is a name of `hdplan robots`, or a RobotSpec. `obstacles` are Obstacles, or
    shapes that say where they stand. `start` is a row of joint values in the robot's order [rad or m], a mapping from
    joint names to values, or the name of a state of the SRDF. `goal` is one of these too, or a PoseTarget, or a list of
    either: then any of them will do. All other sections are those of a scene file.

    Raises InputError for any value that a file is refused, in the same words. What joints, links, states and robots are
    called, and what one section needs of another, is checked when the scene is planned.
    """

    name: str = field(default="scene", compare=False)
    source: Path = field(default=Path(), compare=False, repr=False)  # the file it was read from; none: its name
    robot: Annotated[RobotSpec, robot_spec] = NEEDED
    obstacles: Annotated[tuple[Obstacle, ...], _obstacles] = ()
    start: Annotated[JointTarget, _Configuration("start")] = NEEDED
    goal: Annotated[JointTarget | Goals, _goal] = NEEDED
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    from_request: bool = False  # ends as MoveIt requests have them: of whole robots, and a little beyond limits
    attached: tuple[Attached, ...] = ()  # held objects
    self_collision: SelfCollision = field(default_factory=SelfCollision)
    limits: Limits = field(default_factory=Limits)
    payload: Payload | None = None
    path: PathConstraints = field(default_factory=PathConstraints)
    timing: Timing | None = None
    notes: tuple[str, ...] = field(default=(), compare=False)  # what the reader changed or left out, in words

    def _check_whole(self) -> None:
        if self.source == Path():
            object.__setattr__(self, "source", Path(self.name))
        taken: dict[str, str] = {}
        named = [(f"obstacles[{i}]", "obstacle", obstacle.name) for i, obstacle in enumerate(self.obstacles)]
        named += [(f"attached[{i}]", "held object", held.name) for i, held in enumerate(self.attached)]
        for where, kind, name in named:
            if name in taken:
                other = f"{'earlier ' * (taken[name] == kind)}{taken[name]}"
                raise FieldError(f"the name {name!r} is taken by an {other}; names must differ", where)
            taken[name] = kind

    def with_start(self, start: object) -> Scene:
        """Return the same scene with another start, in any form that `Scene` takes. Raises InputError as it does."""
        return dataclasses.replace(self, start=start)  # type: ignore[arg-type]

    def with_goal(self, goal: object) -> Scene:
        """Return the same scene with another goal, in any form that `Scene` takes. Raises InputError as it does."""
        return dataclasses.replace(self, goal=goal)  # type: ignore[arg-type]

    def save(self, path: str | Path) -> None:
        """Write the scene as a hdplan scene file, whole or not at all; `load_scene` gives an equal scene back.

        `path` ends with .yaml or .yml. Files that the scene names are written with their whole paths, so it may be
        saved anywhere. Raises InputError for another ending, a path that cannot be written, and what no file may say:
        a section without another one that it needs, a text with half a character.
        """
        import hdplan.scenes

        file = checked(path_of, path, "path")
        check_writable(file, SCENE_FILES)
        self.check_effects()
        write_output(file, hdplan.scenes.scene_text(self).encode())

    def check_effects(self) -> None:
        """Refuse what can only be planned beside a section that is missing: a payload without limits of torque, moving
        obstacles without a duration, a motion in time with neither a duration nor limits of acceleration."""
        if self.payload is not None and self.limits.torque is None:
            raise FieldError("counts where joint torques do: limits.torque is missing", "payload")
        duration = self.timing.duration if self.timing else None
        for i, obstacle in enumerate(self.obstacles):
            if obstacle.motion is not None and duration is None:
                raise FieldError("must be met at known times: timing.duration is missing", f"obstacles[{i}].motion")
        if self.timed and duration is None and self.limits.acceleration is None:
            given = next((name for name in RATES if getattr(self.limits, name) is not None), None)
            raise FieldError(
                "makes the motion timed, and a URDF holds no accelerations to time it by: timing.duration or "
                "limits.acceleration is missing",
                "timing" if self.timing is not None or given is None else f"limits.{given}",
            )

    @property
    def timed(self) -> bool:
        """Whether the result is to say when the motion is where: something in the scene depends on it."""
        limits = self.limits
        asked = (limits.velocity, limits.acceleration, limits.jerk, limits.torque)
        return self.timing is not None or any(limit is not None for limit in asked)

    @property
    def standing(self) -> tuple[Obstacle, ...]:
        """The obstacles that stand still."""
        return tuple(obstacle for obstacle in self.obstacles if obstacle.motion is None)

    @property
    def moving(self) -> tuple[Obstacle, ...]:
        """The obstacles that move."""
        return tuple(obstacle for obstacle in self.obstacles if obstacle.motion is not None)

    @property
    def end_time(self) -> float:
        """When the motion ends [s], as far as anything in the scene depends on it; else 0."""
        return 0.0 if self.timing is None or self.timing.duration is None else self.timing.duration

    @property
    def clearances(self) -> dict[str, float]:
        """What must be proven free around each obstacle [m]: its own clearance, or else planner.clearance."""
        return {
            obstacle.name: self.planner.clearance if obstacle.clearance is None else obstacle.clearance
            for obstacle in self.obstacles
        }
