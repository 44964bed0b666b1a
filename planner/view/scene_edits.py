"""Edits of what a scene asks for, as pure functions: another obstacle, another size, speed, clearance or setting.

Each takes a scene (`Edited`) and returns another, with the same checks as a scene file. Raises InputError, naming the
obstacle and the field, for what no file could say.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hdplan.planner.geometry.opened import with_content
from hdplan.planner.view.drawing.motion import Tip
from hdplan.planner.view.drawing.skins import obstacle_mesh
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.things import Thing, moved, obstacle_of
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError, naming
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


def duplicated(edited: Edited, name: str) -> tuple[Edited, Thing]:
    """The scene with a second obstacle of the same shape, clearance and motion, beside the first."""
    return pasted(edited, (obstacle_of(edited, Thing("obstacle", name)),))


def pasted(edited: Edited, obstacles: Sequence[Obstacle]) -> tuple[Edited, Thing]:
    """The scene with more obstacles, at least one: under names of their own, beside what has their names. The last of
    them is returned, too."""
    if not obstacles:
        raise InputError("obstacles: none are pasted")
    for each in obstacles:
        name = free_name(edited, each.name)
        if name != each.name:
            width = float(obstacle_mesh(with_content(each, "obstacles")).extents[1])
            place = each.pose.matrix[:3, 3] + DUPLICATE_SHIFT * width * each.pose.matrix[:3, 1]
            each = moved(replace(each, name=name), replace(each.pose, position=tuple(place.tolist())))
        edited = edited.changed(obstacles=(*edited.scene.obstacles, each))
    return edited, Thing("obstacle", name)


def deleted(edited: Edited, name: str) -> Edited:
    """The scene without an obstacle."""
    return edited.changed(obstacles=tuple(each for each in edited.scene.obstacles if each.name != name))


def renamed(edited: Edited, name: str, new: str) -> Edited:
    """The scene with an obstacle under another name."""
    return _with(edited, name, name=new)


def resized(edited: Edited, name: str, **sizes: object) -> Edited:
    """The scene with an obstacle of the same kind of shape but other `sizes`, the fields of its class [m]."""
    with naming(f"obstacle {name}"):
        shape: Any = replace(obstacle_of(edited, Thing("obstacle", name)).shape, **sizes)  # type: ignore[arg-type]
    return _with(edited, name, shape=shape)


def placed(edited: Edited, name: str, position: tuple[float, float, float]) -> Edited:
    """The scene with an obstacle that is at `position` (world frame) [m] at 0 s, turned as before."""
    obstacle = obstacle_of(edited, Thing("obstacle", name))
    with naming(f"obstacle {name}"):
        other = moved(obstacle, replace(obstacle.pose, position=position))
    return _exchanged(edited, name, other)


def turned(edited: Edited, name: str, degrees: tuple[float, float, float]) -> Edited:
    """The scene with an obstacle turned by roll, pitch and yaw [°], about the world's axes in this order, at 0 s."""
    obstacle = obstacle_of(edited, Thing("obstacle", name))
    with naming(f"obstacle {name}"):
        quaternion = tuple(Rotation.from_euler("xyz", degrees, degrees=True).as_quat().tolist())
        other = moved(obstacle, replace(obstacle.pose, quaternion_xyzw=quaternion))
    return _exchanged(edited, name, other)


def oriented(edited: Edited, name: str, quaternion: Sequence[float]) -> Edited:
    """The scene with an obstacle turned as a quaternion x y z w says, which is normalized, at 0 s."""
    obstacle = obstacle_of(edited, Thing("obstacle", name))
    with naming(f"obstacle {name}"):
        length = float(np.linalg.norm(quaternion)) if len(quaternion) == 4 else 0.0
        if not 1e-6 < length < np.inf:
            raise InputError(
                f"quaternion: must be four numbers, not all 0, found {len(quaternion)} of length {length:g}"
            )
        unit = tuple((np.asarray(quaternion) / length).tolist())
        other = moved(obstacle, replace(obstacle.pose, quaternion_xyzw=unit))
    return _exchanged(edited, name, other)


def turn_of(pose: Pose) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [°] of a pose."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # at a pitch of 90° one of two may be chosen, and is
        roll, pitch, yaw = Rotation.from_quat(pose.quaternion_xyzw).as_euler("xyz", degrees=True).tolist()
    return roll, pitch, yaw


def snapped(edited: Edited, name: str) -> Edited:
    """The scene with an obstacle at a whole centimetre and turned by whole steps of SNAP_TURN."""
    pose = obstacle_of(edited, Thing("obstacle", name)).pose
    x, y, z = (round(value / SNAP) * SNAP for value in pose.position)
    roll, pitch, yaw = (round(value / SNAP_TURN) * SNAP_TURN for value in turn_of(pose))
    return turned(placed(edited, name, (round(x, 6), round(y, 6), round(z, 6))), name, (roll, pitch, yaw))


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
    motion = obstacle_of(edited, Thing("obstacle", name)).motion
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


def _with(edited: Edited, name: str, /, **fields: Any) -> Edited:
    with naming(f"obstacle {name}"):
        other = replace(obstacle_of(edited, Thing("obstacle", name)), **fields)
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
