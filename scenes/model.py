"""What a scene says: frozen data, no files, no geometry code.

Lengths in metres, angles in radians, frames: world unless said.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

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
class Obstacle:
    """A body that stands still in the world."""

    name: str
    shape: Shape
    pose: Pose = field(default_factory=Pose)


@dataclass(frozen=True)
class Attached:
    """A body that a link holds: it moves with the link and collides as the link does."""

    name: str
    link: str
    shape: Shape
    pose: Pose = field(default_factory=Pose)  # in the link's frame
    touch_links: tuple[str, ...] = ()  # links that it may touch, beside the one that holds it


@dataclass(frozen=True)
class RobotSpec:
    """Which robot, where it stands, and what the scene fixes about it."""

    name: str | None = None  # of example-robot-data; or else a URDF:
    urdf: Path | None = None
    srdf: Path | None = None
    package_dirs: tuple[Path, ...] = ()  # where package:// addresses of the URDF are looked up
    base: Pose = field(default_factory=Pose)  # of the URDF's root link
    locked: Mapping[str, float] = field(default_factory=dict)  # joint name -> value [rad] or [m]
    ignore_pairs: tuple[tuple[str, str], ...] = ()  # link pairs not checked against each other
    source: str = field(default="", compare=False)  # for error messages: the file or option; empty: the scene's file


@dataclass(frozen=True)
class JointTarget:
    """A configuration as the scene writes it: exactly one of the first three is given."""

    field: str  # where it stands in the file, for error messages: "start" or "goal"
    positions: tuple[float, ...] | None = None  # in the order of the planned joints
    by_name: Mapping[str, float] | None = None  # joint name -> value
    state: str | None = None  # a named state of the SRDF


@dataclass(frozen=True)
class PoseTarget:
    """Where a link is to be: origin within a ball, and turned by no more than an angle away."""

    field: str  # where it stands in the file, for error messages: "goal.pose" or "goal.poses[1]"
    link: str
    pose: Pose  # of the link's frame, in the world
    position_tolerance: float = 1e-3  # how far the link's origin may be off [m]
    orientation_tolerance: float = 1e-2  # how far it may be turned away, its free turns left out [rad]
    free_rotation: str = "none"  # about which axis of the link it may turn freely: none, x, y, z, or all (any turn)


@dataclass(frozen=True)
class Goals:
    """A goal that leaves a choice: any of these targets will do, and any configuration that reaches a pose."""

    targets: tuple[JointTarget, ...] | tuple[PoseTarget, ...]  # configurations by values, or poses
    field: str = "goal"  # where it stands in the file, for error messages


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
    """One planning problem, whole."""

    name: str
    source: Path  # the file it was read from
    robot: RobotSpec
    obstacles: tuple[Obstacle, ...]
    start: JointTarget
    goal: JointTarget | Goals
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    from_request: bool = False  # a MoveIt request: its ends may sit on a joint limit to rounding
    attached: tuple[Attached, ...] = ()  # held objects
    notes: tuple[str, ...] = ()  # what the reader changed or left out, in words
