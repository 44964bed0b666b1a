"""The closest places of one configuration agree with all pairs' distances, and are exact for hollow meshes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hdplan import Box, Obstacle, Pose, SteadyMotion, Timing, load_scene
from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.robot.scene_robot import load_scene_robot
from hdplan.planner.robot.self_pairs import NEVER_TOUCHING
from hdplan.planner.robot.setup import Setup

SCENES = ["panda_corridor", "ur5_table", "empty"]


@pytest.mark.parametrize("name", SCENES)
def test_nearest_is_the_least_of_all_pairs(name: str) -> None:
    scene = load_scene(name)
    robot = load_scene_robot(scene)
    certifier = Certifier(Setup.of(scene, robot))
    hollow, group = certifier.sweep.hollow, certifier.sweep.pairs.group
    rng = np.random.default_rng(3)
    for q in rng.uniform(np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0), size=(12, robot.n)):
        spots = certifier.sweep.distances(q)
        for which, place in enumerate(certifier.nearest(q)):
            hulls = [spot for spot in spots if group[spot.pair] == which]
            if not hulls:
                assert place is None
                continue
            least = min(spot.distance for spot in hulls)
            assert place.distance >= least  # a surface is no closer than its hull
            solid = [spot.distance for spot in hulls if not hollow[spot.pair] or spot.touching]
            assert place.distance <= min(solid, default=np.inf)
            if not hollow.any():
                assert place.distance == least


def test_the_deepest_of_many_contacts_is_the_nearest() -> None:
    """A box holds the centres of several links; many configurations and times give what each alone does."""
    box = Obstacle("box", Box((0.8, 0.8, 0.8)), Pose((0.5, 0.2, 0.6)), motion=SteadyMotion((0.1, 0.0, 0.0)))
    scene = dataclasses.replace(load_scene("panda_cage"), obstacles=[box], timing=Timing(duration=4.0))
    certifier = Certifier(Setup.of(scene))
    sweep, robot = certifier.sweep, certifier.robot
    rows, times = robot.draw(np.random.default_rng(1), 8), np.linspace(0.0, 4.0, 8)
    for q, time, places in zip(rows, times, certifier.nearest_along(rows, times), strict=True):
        assert places == certifier.nearest(q, time=time)
        spots = sweep.distances(robot.expand(q), time=time, surfaces=True)
        least = [min(spot.distance for spot in spots if sweep.pairs.group[spot.pair] == group) for group in (0, 1)]
        assert [place.distance for place in places if place] == least


@pytest.mark.parametrize("name", [*SCENES, "kinova_shelf"])
def test_the_closest_points_are_as_far_apart_as_their_bodies(name: str) -> None:
    scene = load_scene(name)
    robot = load_scene_robot(scene)
    certifier = Certifier(Setup.of(scene, robot))
    for q in robot.draw(np.random.default_rng(4), 4):
        for place, closest in zip(certifier.nearest(q), certifier.closest(q), strict=True):
            assert (place is None) == (closest is None)
            if place is None or closest is None:
                continue
            assert (closest.link, closest.other, closest.distance) == (place.link, place.other, place.distance)
            if closest.distance > 0.0:
                between = np.linalg.norm(closest.points[0] - closest.points[1])
                assert between == pytest.approx(closest.distance, abs=2e-5)


def test_pairs_that_never_touch_count_in_what_is_claimed() -> None:
    """They need no proof, but the clearance between links is of all links."""
    setup = Setup.of(load_scene("panda_cage"))
    pair, *others = setup.robot.self_pairs
    unchecked = {**setup.robot.unchecked, pair: NEVER_TOUCHING}
    proven = dataclasses.replace(setup.robot, self_pairs=tuple(others), unchecked=unchecked)
    whole, fewer = Certifier(setup), Certifier(dataclasses.replace(setup, robot=proven))
    named = [{each._names(row) for row in range(len(each.sweep.pairs.a))} for each in (whole, fewer)]
    assert named[0] == named[1]
    q = setup.query.start
    one, other = (each.nearest(q)[1] for each in (whole, fewer))
    assert one.distance == other.distance
