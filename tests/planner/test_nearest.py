"""The closest places of one configuration agree with all pairs' distances, and are exact for hollow meshes."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.planner.certificate import Certifier
from hdplan.planner.scene_robot import load_scene_robot
from hdplan.scenes.reader import load_scene


@pytest.mark.parametrize("name", ["panda_corridor", "ur5_table", "empty"])
def test_nearest_is_the_least_of_all_pairs(name: str) -> None:
    scene = load_scene(name)
    robot = load_scene_robot(scene)
    certifier = Certifier(scene, robot)
    hollow, group = certifier.sweep.hollow, certifier.sweep.pairs.group
    rng = np.random.default_rng(3)
    for q in rng.uniform(np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0), size=(12, robot.n)):
        spots = certifier.sweep.distances(q)
        for which, place in enumerate(certifier.nearest(q)):
            hulls = [spot for spot in spots if group[spot.pair] == which]
            if not hulls:
                assert place is None
                continue
            assert place is not None
            least = min(spot.distance for spot in hulls)
            assert place.distance >= least  # a surface is no closer than its hull
            solid = [spot.distance for spot in hulls if not hollow[spot.pair] or spot.touching]
            assert place.distance <= min(solid, default=np.inf)
            if not hollow.any():
                assert place.distance == least
