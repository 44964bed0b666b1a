"""Edits of a scene, as pure functions: another obstacle, another size, speed, clearance or setting.

Each takes a scene (`Edited`) and returns another, with the same checks as a scene file. Raises InputError, naming the
obstacle and the field, for what no file could say.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from hdplan.planner.geometry.opened import with_content
from hdplan.planner.view.drawing.motion import Tip
from hdplan.planner.view.drawing.skins import obstacle_mesh
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.things import Thing, moved
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.obstacles import Obstacle, SteadyMotion, TimedPoses
from hdplan.scenes.poses import Pose
from hdplan.scenes.shapes import Box, Capsule, Cylinder, Ellipsoid, Points, Shape, Sphere
from hdplan.scenes.timing import Timing
from hdplan.scenes.values import Number, checked

NEW: Mapping[str, Shape] = MappingProxyType(  # what is added by a word; meshes come from files
    {
        "box": Box((0.1, 0.1, 0.1)),
        "sphere": Sphere(0.06),
        "ellipsoid": Ellipsoid((0.08, 0.06, 0.04)),
        "cylinder": Cylinder(0.05, 0.15),
        "capsule": Capsule(0.05, 0.1),
        "points": Points(((-0.06, -0.05, -0.05), (0.06, -0.05, -0.05), (0.0, 0.06, -0.05), (0.0, 0.0, 0.07))),
    }
)
SNAP, SNAP_TURN = 0.01, 15.0  # [m], [°]
SNAPS = f"snap: to whole centimetres and {SNAP_TURN:g}°"
AROUND = 12  # places around the robot at which a new obstacle may appear
ROOMY = 0.6  # of the most room there is that serves as well
DUPLICATE_SHIFT = 1.2  # times its width from an obstacle to its duplicate
NO_TIMES = "obstacles.{name}.motion: only a motion through timed poses has a time that it takes"


def added(edited: Edited, shape: Shape, stem: str, eye: Array | None = None) -> tuple[Edited, Thing]:
    """The scene with a new obstacle, named after `stem`, within reach and away from start, goal and other obstacles;
    seen from an `eye` (3,) before the robot, where there is room."""
    name = free_name(edited, stem)
    obstacle = Obstacle(name, shape, Pose(_spot(edited, eye)))
    return edited.changed(obstacles=(*edited.scene.obstacles, obstacle)), Thing("obstacle", name)


def duplicated(edited: Edited, *names: str) -> tuple[Edited, tuple[Thing, ...]]:
    """The scene with second obstacles of the same shapes, clearances and motions, beside the first."""
    return pasted(edited, [edited.obstacle(name) for name in names])


def pasted(edited: Edited, obstacles: Sequence[Obstacle]) -> tuple[Edited, tuple[Thing, ...]]:
    """The scene with more obstacles, at least one: under names of their own, and all of them beside what has the names
    of some. They are returned, too."""
    if not obstacles:
        raise InputError("obstacles: none are pasted")
    taken = any(free_name(edited, each.name) != each.name for each in obstacles)
    beside, added = (_beside(obstacles) if taken else np.zeros(3)), []
    for each in obstacles:
        name = free_name(edited, each.name)
        place = each.pose.matrix[:3, 3] + beside
        new = moved(replace(each, name=name), replace(each.pose, position=tuple(place.tolist())))
        edited = edited.changed(obstacles=(*edited.scene.obstacles, new))
        added.append(Thing("obstacle", name))
    return edited, tuple(added)


def _beside(obstacles: Sequence[Obstacle]) -> Array:
    """The way (3,) [m] to a place beside obstacles: along the y axis of a single one, or else the world's."""
    meshes = [obstacle_mesh(with_content(each, "obstacles")) for each in obstacles]
    if len(obstacles) == 1:
        along: Array = DUPLICATE_SHIFT * float(np.ptp(meshes[0].vertices[:, 1])) * obstacles[0].pose.matrix[:3, 1]
        return along
    sides = [
        (mesh.vertices @ each.pose.matrix[:3, :3].T + each.pose.matrix[:3, 3])[:, 1]
        for mesh, each in zip(meshes, obstacles, strict=True)
    ]
    width = max(float(side.max()) for side in sides) - min(float(side.min()) for side in sides)
    return np.array([0.0, DUPLICATE_SHIFT * width, 0.0])


def deleted(edited: Edited, *names: str) -> Edited:
    """The scene without some obstacles."""
    return edited.changed(obstacles=tuple(each for each in edited.scene.obstacles if each.name not in names))


def renamed(edited: Edited, name: str, new: str) -> Edited:
    """The scene with an obstacle under another name."""
    return _with(edited, name, name=new)


def resized(edited: Edited, name: str, **sizes: object) -> Edited:
    """The scene with an obstacle of the same kind of shape but other `sizes`, the fields of its class [m]."""
    with naming(f"obstacle {name}"):
        shape: Any = replace(edited.obstacle(name).shape, **sizes)  # type: ignore[arg-type]
    return _with(edited, name, shape=shape)


def placed(edited: Edited, name: str, position: tuple[float, float, float]) -> Edited:
    """The scene with an obstacle that is at `position` (world frame) [m] at 0 s, turned as before."""
    return _posed(edited, name, lambda pose: replace(pose, position=position))


def turned(edited: Edited, name: str, degrees: tuple[float, float, float]) -> Edited:
    """The scene with an obstacle turned by roll, pitch and yaw [°], about the world's axes in this order, at 0 s."""
    return _posed(edited, name, lambda pose: pose_turned(pose, degrees))


def oriented(edited: Edited, name: str, quaternion: Sequence[float]) -> Edited:
    """The scene with an obstacle turned as a quaternion x y z w says, which is normalized, at 0 s."""
    return _posed(edited, name, lambda pose: pose_oriented(pose, quaternion))


def pose_turned(pose: Pose, degrees: tuple[float, float, float]) -> Pose:
    """Return a pose turned by roll, pitch and yaw [°], about the world's axes in this order."""
    x, y, z, w = scipy.spatial.transform.Rotation.from_euler("xyz", degrees, degrees=True).as_quat().tolist()
    return replace(pose, quaternion_xyzw=(x, y, z, w))


def pose_oriented(pose: Pose, quaternion: Sequence[float]) -> Pose:
    """Return a pose turned as a quaternion x y z w says, which is normalized. Raises InputError for any other."""
    length = float(np.linalg.norm(quaternion))
    if len(quaternion) != 4 or not 1e-6 < length < np.inf:
        raise InputError(f"quaternion: must be four numbers, not all 0, found {len(quaternion)} of length {length:g}")
    x, y, z, w = (np.asarray(quaternion) / length).tolist()
    return replace(pose, quaternion_xyzw=(x, y, z, w))


def pose_snapped(pose: Pose) -> Pose:
    """Return the nearest pose at a whole centimetre and turned by whole steps of SNAP_TURN."""
    x, y, z = (round(round(value / SNAP) * SNAP, 6) for value in pose.position)
    roll, pitch, yaw = (round(value / SNAP_TURN) * SNAP_TURN for value in turn_of(pose))
    return pose_turned(replace(pose, position=(x, y, z)), (roll, pitch, yaw))


def turn_of(pose: Pose) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [°] of a pose."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # at a pitch of 90° one of two may be chosen, and is
        roll, pitch, yaw = (
            scipy.spatial.transform.Rotation.from_quat(pose.quaternion_xyzw).as_euler("xyz", degrees=True).tolist()
        )
    return roll, pitch, yaw


def snapped(edited: Edited, *names: str) -> Edited:
    """The scene with obstacles at whole centimetres and turned by whole steps of SNAP_TURN."""
    for name in names:
        edited = _posed(edited, name, pose_snapped)
    return edited


def kept_clear(edited: Edited, name: str, clearance: float | None) -> Edited:
    """The scene with another clearance to be proven around an obstacle [m]; None: the scene's."""
    return _with(edited, name, clearance=clearance)


def moving(edited: Edited, name: str, velocity: tuple[float, float, float], spin: tuple[float, float, float]) -> Edited:
    """The scene with an obstacle that moves at a velocity [m/s] and spin [rad/s] in the world; at rest if both are
    0."""
    with naming(f"obstacle {name}"):
        motion = SteadyMotion(velocity, spin)
    return _whole(_with(edited, name, motion=motion if any(motion.velocity + motion.spin) else None))


def passing(edited: Edited, name: str, seconds: float) -> Edited:
    """The scene with an obstacle that takes so long [s] from the first of its timed poses to the last."""
    motion = edited.obstacle(name).motion
    if not isinstance(motion, TimedPoses):
        raise InputError(NO_TIMES.format(name=name))
    with naming(f"obstacle {name}"):
        seconds = checked(Number(above=0.0, unit="s"), seconds, "passes in")
        first, last = motion.times[0], motion.times[-1]
        times = [first + (time - first) * seconds / (last - first) for time in motion.times]
        other = replace(motion, times=times)  # type: ignore[arg-type]
    return _whole(_with(edited, name, motion=other))


def planned_by(edited: Edited, **settings: object) -> Edited:
    """The scene with other settings of the planner: fields of `PlannerSettings`."""
    with naming("planner"):
        planner = replace(edited.scene.planner, **settings)  # type: ignore[arg-type]
    return _whole(edited.changed(planner=planner))


def lasting(edited: Edited, duration: float | None) -> Edited:
    """The scene with a motion of another duration [s]; None: as long as it takes."""
    timing = edited.scene.timing
    with naming("timing"):
        other = Timing(duration) if timing is None else replace(timing, duration=duration)
    return _whole(edited.changed(timing=None if other == Timing() else other))


def free_name(edited: Edited, stem: str) -> str:
    """Return a name that no obstacle, held object or link has: `stem`, or else with a number."""
    taken = {obstacle.name for obstacle in edited.scene.obstacles} | set(edited.robot.links)
    taken |= {held.name for held in edited.scene.attached}
    bare = stem.rstrip("0123456789") or stem
    numbers = (f"{bare}{number}" for number in range(2, len(taken) + 3))
    return stem if stem not in taken else next(name for name in numbers if name not in taken)


def _posed(edited: Edited, name: str, posed: Callable[[Pose], Pose]) -> Edited:
    """The scene with an obstacle at another pose at 0 s."""
    obstacle = edited.obstacle(name)
    with naming(f"obstacle {name}"):
        other = moved(obstacle, posed(obstacle.pose))
    return _exchanged(edited, name, other)


def _with(edited: Edited, name: str, /, **fields: Any) -> Edited:
    with naming(f"obstacle {name}"):
        other = replace(edited.obstacle(name), **fields)
    return _exchanged(edited, name, other)


def _exchanged(edited: Edited, name: str, other: Obstacle) -> Edited:
    return edited.changed(obstacles=tuple(other if each.name == name else each for each in edited.scene.obstacles))


def _whole(edited: Edited) -> Edited:
    """The scene, if its sections fit together. Raises InputError."""
    edited.scene.check_effects()
    return edited


def _spot(edited: Edited, eye: Array | None) -> tuple[float, float, float]:
    """The place with most room on a circle about the base, as far out and as high as start and goal are; seen from an
    eye (3,), of the places with about as much room the nearest."""
    tip = Tip.of(edited.robot)
    ends = np.array([tip.placement(q).translation for q in (edited.start, edited.goal)])
    base = np.array(edited.robot.base.position)
    reach = float(np.linalg.norm((ends - base)[:, :2], axis=1).max())
    angles = np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(AROUND)], axis=1) * max(reach, 0.2)
    ring += [base[0], base[1], ends[:, 2].mean()]
    others = np.array([*ends, *(obstacle.pose.position for obstacle in edited.scene.obstacles)])
    room = np.linalg.norm(ring[:, None] - others, axis=2).min(axis=1)
    away = np.zeros(AROUND) if eye is None else np.linalg.norm(ring - eye, axis=1)
    x, y, z = np.round(ring[np.lexsort((-room, np.where(room < ROOMY * room.max(), np.inf, away)))[0]], 3).tolist()
    return x, y, z
