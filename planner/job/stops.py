"""Stops: a stage that should blend into the next one, but at whose end the motion rests.

Whether it does follows from the motion alone: velocities and accelerations of the row at which the next stage begins
are 0, to the last bit. The stage is then judged as one without a blend, to the very end of its curve or to its goal.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.scenes.job import Job
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.stage import ArmStage


def stopping(scene: Scene, motion: Trajectory) -> list[int]:
    """Return the numbers of stages that a job blends into the next ones, and at whose ends a motion rests."""
    assert scene.job is not None
    ends = [*(mark.row for mark in motion.stages[1:]), len(motion) - 1]
    return [
        number
        for number, (stage, row) in enumerate(zip(scene.job.stages, ends, strict=False))
        if isinstance(stage, ArmStage) and stage.blend and rests(motion, row)
    ]


def rests(motion: Trajectory, row: int) -> bool:
    """True if nothing moves at a row of a motion, and nothing speeds up."""
    if motion.velocities is None or motion.accelerations is None:
        return False
    return not (motion.velocities[row].any() or motion.accelerations[row].any())


def with_stops(scene: Scene, numbers: Collection[int]) -> Scene:
    """Return the scene of a job in which these stages end at rest."""
    assert scene.job is not None
    stages = [
        replace(stage, blend=0.0) if i in numbers and isinstance(stage, ArmStage) else stage
        for i, stage in enumerate(scene.job.stages)
    ]
    return derived(scene, job=Job(stages))


def notes_on(scene: Scene, numbers: Collection[int]) -> tuple[str, ...]:
    """Say at which stages the motion stops."""
    assert scene.job is not None
    names = scene.job.names
    return tuple(f"{names[k]}: stops at its end, where the job blends it into '{names[k + 1]}'" for k in numbers)
