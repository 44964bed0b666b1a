"""The spots of a job, at which objects are taken and left, each with the stages that lead there and away.

An object is moved together with all that leads to it, the positions in the world to which the stages before its grip
go. The same holds for the place where it is released, and for the lines that lead away from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from hdplan.scenes.array_types import Array
from hdplan.scenes.curve_stages import Along, Circle, Line
from hdplan.scenes.errors import InputError
from hdplan.scenes.job import Grip, Job, Move, Release
from hdplan.scenes.poses import Vector3
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget


@dataclass(frozen=True)
class Spot:
    """A place at which an object is taken or left."""

    object: str
    number: int  # of the stage that grips or releases it
    stages: tuple[int, ...]  # numbers of those that lead there, and of the lines that lead away
    stands: bool  # whether the object stands there where the job begins


def spots_of(scene: Scene) -> tuple[Spot, ...]:
    """Return the spots of a scene's job, in the order in which the robot comes to them."""
    return tuple(_spots(scene))


def _spots(scene: Scene) -> Iterator[Spot]:
    assert scene.job is not None
    standing = {each.name for each in scene.obstacles}
    waiting: list[int] = []  # stages that lead to the next grip or release
    spot: Spot | None = None
    leaves = False  # whether the stages since a release are lines alone
    for number, stage in enumerate(scene.job.stages):
        if isinstance(stage, Line) and leaves and spot is not None:
            spot = replace(spot, stages=(*spot.stages, number))
        elif isinstance(stage, Grip | Release) and stage.object is not None:
            if spot is not None:
                yield spot
            stands = isinstance(stage, Grip) and stage.object in standing
            spot = Spot(stage.object, number, tuple(waiting), stands)
            standing -= {stage.object} if stands else set()
            waiting, leaves = [], isinstance(stage, Release)
        else:
            waiting.append(number)
            leaves = False
    if spot is not None:
        yield spot


def positions_of(scene: Scene, number: int) -> list[tuple[str, Vector3]]:
    """Return the positions in the world that a stage names, each with its field: one, those of several poses
    to choose between, or none. Raises InputError for what cannot be moved."""
    assert scene.job is not None
    stage = scene.job.stages[number]
    where = f"{scene.source}: job[{number}] ({scene.job.names[number]})"
    if isinstance(stage, Line) and stage.to is not None:
        return [("line.to", stage.to)]
    if isinstance(stage, Along) or (isinstance(stage, Circle) and stage.to is not None):
        raise InputError(f"{where}: curves in the world cannot be moved; give 'by'")
    if not isinstance(stage, Move) or isinstance(stage.goal, JointTarget):
        return []
    targets = stage.goal.targets
    poses = [target for target in targets if isinstance(target, PoseTarget)]
    if not poses and all(isinstance(target, JointTarget) for target in targets):
        return []
    if len(poses) < len(targets):
        raise InputError(f"{where}: move: only joints alone, and one or several poses to choose between, can be moved")
    return [(f"{_field_of(target)}.position", target.pose.position) for target in poses]


def _field_of(target: PoseTarget) -> str:
    """Return the field of a move that holds a pose: "move.poses.1"."""
    _, found, field = target.field.rpartition("move.")
    return f"move.{field}".replace("[", ".").replace("]", "") if found else "move.pose"


def moved(scene: Scene, spot: Spot, by: Array) -> Scene:
    """Return a scene in which a spot is moved by a vector (3,) [m]: the stages, and the object if it stands there.
    Raises InputError for stages that cannot be moved."""
    assert scene.job is not None
    stages = list(scene.job.stages)
    for number in spot.stages:
        positions, stage = [_sum(each, by) for _, each in positions_of(scene, number)], stages[number]
        if positions and isinstance(stage, Line):
            stages[number] = replace(stage, to=positions[0])
        elif positions and isinstance(stage, Move) and isinstance(stage.goal, Goals):
            poses = [target for target in stage.goal.targets if isinstance(target, PoseTarget)]
            goals = tuple(
                replace(target, pose=replace(target.pose, position=position))
                for target, position in zip(poses, positions, strict=True)
            )
            stages[number] = replace(stage, goal=replace(stage.goal, targets=goals))
    obstacles = [
        replace(each, pose=replace(each.pose, position=_sum(each.pose.position, by)))
        if spot.stands and each.name == spot.object
        else each
        for each in scene.obstacles
    ]
    return derived(scene, job=Job(stages), obstacles=tuple(obstacles))


def _sum(position: Vector3, by: Array) -> Vector3:
    x, y, z = (np.asarray(position) + by).tolist()
    return x, y, z
