"""Distances of the pairs of bodies that may touch in a stage of a job."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.job.changes import GRIP_REACH
from hdplan.planner.job.stage_scenes import moves_fingers, stage_scene, standing_scene
from hdplan.planner.job.world import World
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array
from hdplan.scenes.job import Job, stage_name
from hdplan.scenes.scene import derived


def touched(world: World, number: int, rows: Array) -> dict[tuple[str, str], float]:
    """Return the least distance [m] of each pair that may touch in a stage, by its `touch` or as a finger that
    moves and what is held, at some configurations (k, n) of its scene's robot: negative where they overlap,
    infinite beyond GRIP_REACH."""
    stages = list(world.job.stages)
    stages[number] = replace(stage := stages[number], touch=(), name=stage_name(stage, number))
    held = tuple(replace(each, touch_links=()) for each in world.held)
    bare = replace(world, scene=derived(world.scene, goal=None, job=Job(stages)), held=held)
    looked, pairs = [(stage_scene(bare, number), rows)], stage.touch
    if moves_fingers(stage):
        looked.append((standing_scene(bare, number), world.q[None]))
        pairs += tuple((each.name, link) for each in world.held for link in each.touch_links)
    near: dict[frozenset[str], float] = {}
    for scene, configurations in looked:
        certifier = Certifier(Setup.of(scene))
        for q in configurations:
            found = [(each.link, each.other, each.distance) for each, _ in certifier.too_close(q, GRIP_REACH)]
            found += [(each.link, each.other, -each.depth) for each in certifier.contacts(q)]
            for one, other, distance in found:
                pair = frozenset((one, other))
                near[pair] = min(distance, near.get(pair, np.inf))
    standing = {each.name for each in world.obstacles}
    return {pair: near.get(frozenset(pair), np.inf) for pair in pairs if not standing.issuperset(pair)}
