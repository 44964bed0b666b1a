"""What a scene says: frozen data, no files, no geometry code.

Lengths in metres, angles in radians, frames: world unless said.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class Pose:
    """A placement: position [m] and unit quaternion (x, y, z, w); maps the object's frame into its parent's."""

    position: Vector3 = (0.0, 0.0, 0.0)
    quaternion_xyzw: Quaternion = (0.0, 0.0, 0.0, 1.0)

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


@dataclass(frozen=True)
class Box:
    """A box centred in its frame."""

    size: Vector3  # full edge lengths [m]


@dataclass(frozen=True)
class Sphere:
    """A ball centred in its frame."""

    radius: float  # [m]


@dataclass(frozen=True)
class Cylinder:
    """A right circular cylinder centred in its frame, axis z."""

    radius: float  # [m]
    length: float  # [m]


@dataclass(frozen=True)
class Capsule:
    """A segment on the z axis, centred, swept by a ball."""

    radius: float  # [m]
    length: float  # between the centres of the two end spheres [m]


@dataclass(frozen=True)
class Points:
    """The convex hull of points."""

    points: tuple[Vector3, ...]  # in the obstacle's frame [m]


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh read from a file (anything that trimesh reads)."""

    file: Path
    scale: Vector3 = (1.0, 1.0, 1.0)  # factor along each axis of the file


Shape = Box | Sphere | Cylinder | Capsule | Points | Mesh


@dataclass(frozen=True)
class SteadyMotion:
    """A body moves and turns evenly, from its pose at time 0 on."""

    velocity: Vector3 = (0.0, 0.0, 0.0)  # of its origin, in the world [m/s]
    spin: Vector3 = (0.0, 0.0, 0.0)  # angular velocity about its origin, in the world [rad/s]


@dataclass(frozen=True)
class TimedPoses:
    """A body passes through poses: evenly from one to the next, at rest before the first and after the last."""

    times: tuple[float, ...]  # rising, at least two [s]
    poses: tuple[Pose, ...]  # one at each time, in the world


@dataclass(frozen=True)
class Obstacle:
    """A body in the world; it stands still unless it has a motion."""

    name: str
    shape: Shape
    pose: Pose = field(default_factory=Pose)  # at time 0, where it moves; of timed poses the first
    clearance: float | None = None  # to be proven free around it [m]; None: planner.clearance
    motion: SteadyMotion | TimedPoses | None = None


@dataclass(frozen=True)
class Attached:
    """A body that a link holds: it moves with the link and collides as the link does."""

    name: str
    link: str
    shape: Shape
    pose: Pose = field(default_factory=Pose)  # in the link's frame
    touch_links: tuple[str, ...] = ()  # links that it may touch, beside the one that holds it
    mass: float = 0.0  # [kg] of even density; counts where joint torques do (limits.torque)


@dataclass(frozen=True)
class Payload:
    """A mass that a link carries beside its own; it touches nothing."""

    link: str
    mass: float  # [kg]
    com: Vector3 = (0.0, 0.0, 0.0)  # its centre, in the link's frame [m]
    inertia: tuple[float, float, float, float, float, float] = (0.0,) * 6
    """xx, xy, xz, yy, yz, zz about its centre, in the link's axes [kg m²]."""


@dataclass(frozen=True)
class RobotSpec:
    """Which robot, where it stands, and what the scene fixes about it."""

    name: str | None = None  # of example-robot-data; or else a URDF:
    urdf: Path | None = None
    srdf: Path | None = None
    package_dirs: tuple[Path, ...] = ()  # where package:// addresses of the URDF are looked up
    group: str | None = None  # of the SRDF: its joints are planned; None: those of its arm
    base: Pose = field(default_factory=Pose)  # of the URDF's root link
    locked: Mapping[str, float] = field(default_factory=dict)  # joint name -> value [rad] or [m]
    ignore_pairs: tuple[tuple[str, str], ...] = ()  # link pairs not checked against each other
    source: str = field(default="", compare=False)  # for error messages: the file or option; empty: the scene's file


@dataclass(frozen=True)
class JointTarget:
    """A configuration as the scene writes it: exactly one of the last three is given."""

    field: str = dataclasses.field(compare=False)  # where it stands in the file, for error messages: "start" or "goal"
    positions: tuple[float, ...] | None = None  # in the order of the planned joints
    by_name: Mapping[str, float] | None = None  # joint name -> value
    state: str | None = None  # a named state of the SRDF


@dataclass(frozen=True)
class PoseTarget:
    """Where a link is to be: origin within a ball, and turned by no more than an angle away."""

    field: str = dataclasses.field(compare=False)  # where it stands in the file: "goal.pose" or "goal.poses[1]"
    link: str
    pose: Pose  # of the link's frame, in the world
    position_tolerance: float = 1e-3  # how far the link's origin may be off [m]
    orientation_tolerance: float = 1e-2  # how far it may be turned away, its free turns left out [rad]
    free_rotation: str = "none"  # about which axis of the link it may turn freely: none, x, y, z, or all (any turn)


@dataclass(frozen=True)
class Goals:
    """A goal that leaves a choice: any of these targets will do, and any configuration that reaches a pose."""

    targets: tuple[JointTarget, ...] | tuple[PoseTarget, ...]  # configurations by values, or poses
    field: str = dataclasses.field(default="goal", compare=False)  # where it stands in the file, for error messages


@dataclass(frozen=True)
class SelfCollision:
    """What links and held objects are to keep from each other."""

    checked: bool = True
    clearance: float = 0.0  # to be proven free between them [m]


FromUrdf = Literal["urdf"]
JointValues = FromUrdf | float | tuple[float, ...] | Mapping[str, float]
"""A value for each joint: the URDF's, the same for all, one each in the order of the planned joints, or by name (the
others keep the URDF's)."""


@dataclass(frozen=True)
class Limits:
    """What the joints can do, beside what the URDF says of their positions; None: does not matter here."""

    position: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # joint -> range within the URDF's
    velocity: JointValues | None = None  # [rad/s] or [m/s]; as soon as the motion is timed: the URDF's
    acceleration: JointValues | None = None  # [rad/s²] or [m/s²]
    jerk: JointValues | None = None  # [rad/s³] or [m/s³]
    torque: JointValues | None = None  # [Nm] or [N]


@dataclass(frozen=True)
class Timing:
    """When the motion is where."""

    duration: float | None = None  # of the whole motion [s]; None: as fast as the limits allow, times 1/scale
    scale: float = 1.0  # share of the speed that the limits allow (above 0, at most 1)
    rate: float = 100.0  # rows of the result in a second [1/s]


@dataclass(frozen=True)
class Upright:
    """A link's axis stays close to the world's upward direction, all the way."""

    link: str
    axis: Vector3 = (0.0, 0.0, 1.0)  # in the link's frame, of length one
    tolerance: float = 0.1  # by which it may be turned away [rad]


@dataclass(frozen=True)
class Within:
    """A point of a link stays in a box, all the way."""

    link: str
    size: Vector3  # full edge lengths of the box [m]; inf where any place will do
    pose: Pose = field(default_factory=Pose)  # of the box's centre, in the world
    point: Vector3 = (0.0, 0.0, 0.0)  # in the link's frame [m]


@dataclass(frozen=True)
class PathConstraints:
    """What must hold all along the way, between the waypoints too."""

    upright: Upright | None = None
    position: Within | None = None


@dataclass(frozen=True)
class PlannerSettings:
    """The `planner` section. Every value has a default; `hdplan explain` shows the ones in force."""

    waypoints: int = 32  # number of rows of the trajectory, start and goal included (3 to 1000)
    clearance: float = 0.0  # what must be proven free around the robot [m] (0 to 1)
    activation: float = 0.02  # beyond the clearance, where the obstacle penalty sets in [m] (0 to 1)
    gamma: int = 2  # order of differentiability of the distance (1 to 32)
    shaping_length: float = 1e-3  # width of the distance's flat spot at contact [m] (1e-9 to 1)
    distance: str = "hdsdf"  # of the obstacle penalty: hdsdf, or fcl, the exact Euclidean one
    link_bodies: str = "fitted"  # what encloses a link: fitted, capsule, outer-4, outer-12, box, hull
    swept: bool = False  # hulls of link bodies at neighbouring waypoints in place of samples between them
    normals: str = "box"  # planes of an obstacle: faces (6 of a box), box (26) or sphere (122)


@dataclass(frozen=True)
class Scene:
    """One planning problem, whole. Scenes are equal that say the same, whatever file they come from."""

    name: str = field(compare=False)
    source: Path = field(compare=False)  # the file it was read from
    robot: RobotSpec
    obstacles: tuple[Obstacle, ...]
    start: JointTarget
    goal: JointTarget | Goals
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    from_request: bool = False  # ends as MoveIt requests have them: of whole robots, and a little beyond limits
    attached: tuple[Attached, ...] = ()  # held objects
    self_collision: SelfCollision = field(default_factory=SelfCollision)
    limits: Limits = field(default_factory=Limits)
    payload: Payload | None = None
    path: PathConstraints = field(default_factory=PathConstraints)
    timing: Timing | None = None
    notes: tuple[str, ...] = field(default=(), compare=False)  # what the reader changed or left out, in words

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
