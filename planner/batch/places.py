"""The places of a job drawn anew: what is taken stands elsewhere, and is set down elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hdplan.planner.job.spots import position_of, spots_of
from hdplan.scenes.errors import InputError
from hdplan.scenes.job import Grip
from hdplan.scenes.scene import Scene


def moved_places(scene: Scene, rng: np.random.Generator, jitter: float) -> Iterator[tuple[str, float]]:
    """Yield fields of a scene with a job in which what is gripped, and where it is let go, are moved along x and y, at
    most `jitter` [m]. Raises InputError for a stage whose goal cannot be moved, and a job that grips nothing."""
    assert scene.job is not None
    if not any(isinstance(stage, Grip) and stage.object for stage in scene.job.stages):
        raise InputError(f"{scene.source}: job: grips nothing, so there are no places to be drawn")
    where = {each.name: each.pose.position for each in scene.obstacles}
    for spot in spots_of(scene):
        by = rng.uniform(-jitter, jitter, 2)
        for number in spot.stages:
            if (found := position_of(scene, number)) is not None:
                field, position = found
                yield from ((f"job.{number}.{field}.{i}", position[i] + by[i]) for i in (0, 1))
        if spot.stands:
            place = where[spot.object]
            yield from ((f"obstacles.{spot.object}.pose.position.{i}", place[i] + by[i]) for i in (0, 1))
