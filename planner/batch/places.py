"""The places of a job drawn anew: what is taken stands elsewhere, and is set down elsewhere.

An object is moved together with all that leads to it, the positions in the world to which the stages before its grip
go. The same holds for the place where it is let go, and for the lines that lead away from there.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hdplan.scenes.curve_stages import Along, Circle, Line
from hdplan.scenes.errors import InputError
from hdplan.scenes.job import Grip, Move, Release
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import Goals, JointTarget, PoseTarget


def moved_places(scene: Scene, rng: np.random.Generator, jitter: float) -> Iterator[tuple[str, float]]:
    """Yield fields of a scene with a job in which what is gripped, and where it is let go, are moved along x and y, at
    most `jitter` [m]. Raises InputError for a stage whose goal cannot be moved, and a job that grips nothing."""
    assert scene.job is not None
    stages = scene.job.stages
    if not any(isinstance(stage, Grip) and stage.object for stage in stages):
        raise InputError(f"{scene.source}: job: grips nothing, so there are no places to be drawn")
    where = {each.name: each.pose.position for each in scene.obstacles}
    waiting: list[int] = []  # stages that lead to the next grip or release
    last = np.zeros(2)
    leaves = False  # whether the stages since a release are lines alone
    for number, stage in enumerate(stages):
        if isinstance(stage, Line) and leaves:
            yield from _moved(scene, number, last)
        elif isinstance(stage, Grip | Release) and stage.object is not None:
            last = rng.uniform(-jitter, jitter, 2)
            for each in waiting:
                yield from _moved(scene, each, last)
            waiting, leaves = [], isinstance(stage, Release)
            if isinstance(stage, Grip) and stage.object in where:
                place = where.pop(stage.object)
                yield from ((f"obstacles.{stage.object}.pose.position.{i}", place[i] + last[i]) for i in (0, 1))
        else:
            waiting.append(number)
            leaves = False


def _moved(scene: Scene, number: int, by: np.ndarray) -> Iterator[tuple[str, float]]:
    """Yield the fields of a stage whose position in the world is moved."""
    assert scene.job is not None
    stage = scene.job.stages[number]
    key = f"job.{number}"
    if isinstance(stage, Line) and stage.to is not None:
        yield from ((f"{key}.line.to.{i}", stage.to[i] + by[i]) for i in (0, 1))
    elif isinstance(stage, Along) or (isinstance(stage, Circle) and stage.to is not None):
        name = scene.job.names[number]
        raise InputError(f"{scene.source}: job[{number}] ({name}): curves in the world cannot be drawn anew; give 'by'")
    elif isinstance(stage, Move) and not isinstance(stage.goal, JointTarget):
        target = stage.goal.targets[0] if isinstance(stage.goal, Goals) and len(stage.goal.targets) == 1 else None
        if not isinstance(target, PoseTarget):
            name = scene.job.names[number]
            raise InputError(
                f"{scene.source}: job[{number}] ({name}): move: only joints and one pose can be drawn anew"
            )
        yield from ((f"{key}.move.pose.position.{i}", target.pose.position[i] + by[i]) for i in (0, 1))
