"""The benchmark of replanning looks for contacts only where they can be: what it does not measure is no closer than it
says."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import coal
import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

import replanning_world as worlds

import hdplan
from hdplan.planner.robot.setup import Setup

DT = 0.005  # [s]


def test_links_that_are_not_measured_are_farther_than_the_closest() -> None:
    """Hulls decide which meshes are measured; the least distance is that of all meshes, wherever there is contact."""
    judge, rng = worlds.Judge(hdplan.load_robot("ur5"), floor=False), np.random.default_rng(5)
    touching = 0
    for _ in range(40):
        q, turn = judge.robot.draw(rng, 1)[0], pin.exp3(rng.normal(size=3))
        at = judge.hand(q) + rng.uniform(0.05, 0.6) * rng.normal(size=3)
        box = SimpleNamespace(name="box", shape=hdplan.Box([0.2] * 3), at=at, turn=turn, lever=0.2)
        found, cube, place = judge.distance(q, [box], 0.5), coal.Box(0.2, 0.2, 0.2), coal.Transform3s(turn, at)
        meshes = [judge.items.geometryObjects[i].geometry for i in judge.moving]
        places = [coal.Transform3s(judge.places.oMg[i]) for i in judge.moving]
        each = np.array([worlds.measured(*link, cube, place).min_distance for link in zip(meshes, places, strict=True)])
        bounds = [worlds.apart(judge.hulls[i], at, cube, place) for i, at in zip(judge.moving, places, strict=True)]
        assert (bounds <= np.maximum(each, 0.0) + 1e-9).all()
        touching += each.min() <= 0.0
        assert (found <= 0.0) == (each.min() <= 0.0)
        assert found <= 0.0 or abs(found - min(each.min(), 0.5)) < 1e-9
    assert 3 < touching < 30


def test_a_gap_that_is_not_measured_is_no_smaller_than_stated() -> None:
    """A robot at its greatest speeds among all that moves in a world: every contact and each distance
    below the threshold are found, though most distances are not measured."""
    scene, _ = worlds.scene_of(3)
    judge = worlds.Judge(Setup.of(scene).robot)
    gaps, world, rng = worlds.Gaps(judge), worlds.World(3), np.random.default_rng(3)
    measured, looks, near = 0, 0, 0
    whole = judge.distance

    def counted(*args: object, **named: object) -> float:
        nonlocal measured
        measured += 1
        return float(whole(*args, **named))

    gaps.judge.distance = counted  # type: ignore[method-assign]
    q, dq = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]), np.zeros(7)
    for k in range(400):
        if k % 20 == 0:
            dq = rng.uniform(-1.0, 1.0, 7) * judge.robot.model.velocityLimit[:7]
        q = np.clip(q + DT * dq, judge.robot.lower, judge.robot.upper)
        gaps.move(q, DT)
        there = world.there(k * DT)
        most = rng.uniform(0.0, 0.15)
        found = gaps.below(there, most, floor=True)
        looks += 1 + len(there)
        if k % 5 == 0:
            least = min(whole(q, there, most), most)
            assert abs(found - least) < 1e-9, (found, least)
            near += least < most
        world.go(k * DT, DT, lambda at=q: judge.hand(at))
    assert near > 3
    assert measured < 0.5 * looks
