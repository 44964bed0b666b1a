"""Edits of what a scene asks for, as pure functions: another obstacle, another size, speed, clearance or setting.

Each takes a scene (`Edited`) and returns another, with the same checks as a scene file. Raises InputError, naming the
obstacle and the field, for what no file could say.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

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
AROUND = 12  # places around the robot at which a new obstacle may appear
ROOMY = 0.6  # of the most room there is that serves as well
DUPLICATE_SHIFT = 1.2  # times its width from an obstacle to its duplicate
NO_TIMES = "obstacles.{name}.motion: only a motion through timed poses has a time that it takes"


def added(edited: Edited, shape: Shape, stem: str, eye: Array | None = None) -> tuple[Edited, Thing]:
    """Return it with a new obstacle, named after `stem`, within reach and away from start, goal and other obstacles;
    seen from an `eye` (3,) before the robot, where there is room."""
    name = free_name(edited, stem)
    obstacle = Obstacle(name, shape, Pose(_spot(edited, eye)))
    return edited.changed(obstacles=(*edited.scene.obstacles, obstacle)), Thing("obstacle", name)


def duplicated(edited: Edited, name: str) -> tuple[Edited, Thing]:
    """Return it with a second obstacle of the same shape, clearance and motion, beside the first."""
    first = obstacle_of(edited, Thing("obstacle", name))
    width = float(obstacle_mesh(with_content(first, "obstacles")).extents[1])
    place = first.pose.matrix[:3, 3] + DUPLICATE_SHIFT * width * first.pose.matrix[:3, 1]
    second = moved(replace(first, name=free_name(edited, name)), replace(first.pose, position=tuple(place.tolist())))
    return edited.changed(obstacles=(*edited.scene.obstacles, second)), Thing("obstacle", second.name)


def deleted(edited: Edited, name: str) -> Edited:
    """Return it without an obstacle."""
    return edited.changed(obstacles=tuple(each for each in edited.scene.obstacles if each.name != name))


def renamed(edited: Edited, name: str, new: str) -> Edited:
    """Return it with an obstacle of another name."""
    return _with(edited, name, name=new)


def resized(edited: Edited, name: str, **sizes: object) -> Edited:
    """Return it with an obstacle of the same kind of shape but other `sizes`, the fields of its class [m]."""
    with naming(f"obstacle {name}"):
        shape: Any = replace(obstacle_of(edited, Thing("obstacle", name)).shape, **sizes)  # type: ignore[arg-type]
    return _with(edited, name, shape=shape)


def placed(edited: Edited, name: str, position: tuple[float, float, float]) -> Edited:
    """Return it with an obstacle that is at `position` (world frame) [m] at 0 s, turned as before."""
    obstacle = obstacle_of(edited, Thing("obstacle", name))
    with naming(f"obstacle {name}"):
        other = moved(obstacle, replace(obstacle.pose, position=position))
    return _exchanged(edited, name, other)


def kept_clear(edited: Edited, name: str, clearance: float | None) -> Edited:
    """Return it with another clearance to be proven around an obstacle [m]; None: the scene's."""
    return _with(edited, name, clearance=clearance)


def moving(edited: Edited, name: str, velocity: tuple[float, float, float], spin: tuple[float, float, float]) -> Edited:
    """Return it with an obstacle that moves at a velocity [m/s] and spin [rad/s] in the world; at rest if both are
    0."""
    with naming(f"obstacle {name}"):
        motion = SteadyMotion(velocity, spin)
    return _whole(_with(edited, name, motion=motion if any(motion.velocity + motion.spin) else None))


def passing(edited: Edited, name: str, seconds: float) -> Edited:
    """Return it with an obstacle that takes so long [s] from the first of its timed poses to the last."""
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
    """Return it with other settings of the planner: fields of `PlannerSettings`."""
    with naming("planner"):
        planner = replace(edited.scene.planner, **settings)  # type: ignore[arg-type]
    return _whole(edited.changed(planner=planner))


def lasting(edited: Edited, duration: float | None) -> Edited:
    """Return it with a motion of another duration [s]; None: as long as it takes."""
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
    """Return it if its sections fit together. Raises InputError."""
    edited.scene.check_effects()
    return edited


def _spot(edited: Edited, eye: Array | None) -> tuple[float, float, float]:
    """Where there is most room on a circle about the base, as far out and as high as start and goal are; seen from an
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
