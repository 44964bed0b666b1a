"""The places of a job drawn at random: objects are taken and set down elsewhere."""

from __future__ import annotations

import numpy as np

from hdplan.planner.job.spots import moved, positions_of, spots_of
from hdplan.scenes.errors import InputError
from hdplan.scenes.job import Grip
from hdplan.scenes.scene import Scene


def moved_places(scene: Scene, rng: np.random.Generator, jitter: float) -> tuple[dict[str, float], Scene]:
    """Return fields of a scene with a job in which what is gripped, and where it is released, are moved along x and y,
    at most `jitter` [m], and the scene with these. Raises InputError for a stage whose goal cannot be moved, and a job
    that grips nothing."""
    assert scene.job is not None
    if not any(isinstance(stage, Grip) and stage.object for stage in scene.job.stages):
        raise InputError(f"{scene.source}: job: grips nothing, so there are no places to draw")
    fields: dict[str, float] = {}
    drawn, where = scene, {each.name: each.pose.position for each in scene.obstacles}
    for spot in spots_of(scene):
        by = np.append(rng.uniform(-jitter, jitter, 2), 0.0)
        drawn = moved(drawn, spot, by)
        places = [
            (f"job.{number}.{field}", position)
            for number in spot.stages
            for field, position in positions_of(scene, number)
        ]
        if spot.stands:
            places.append((f"obstacles.{spot.object}.pose.position", where[spot.object]))
        fields |= {f"{field}.{i}": float(position[i] + by[i]) for field, position in places for i in (0, 1)}
    return fields, drawn
