"""Benchmarks: the peers of hdplan get the same problem, settings that never succeed are given up, and waiting takes
nothing from processor time."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import hdplan

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))
import narrow_steps
from peer_task import Task, evenly
from peer_urdf import describe
from processor_time import add_processor_time, set_clock

RNG = np.random.default_rng(16)


BODIES = [
    hdplan.Box([0.1, 0.1, 0.6], pose=hdplan.Pose([0.6, 0.2, 0.6], [0.1, 0.3, -0.3, 0.9])),
    hdplan.Cylinder(0.05, 0.4, pose=hdplan.Pose([-0.3, 0.5, 0.5], [0.0, 0.6, 0.0, 0.8])),
    hdplan.Sphere(0.1, pose=[0.3, -0.6, 0.9]),
]


@pytest.mark.parametrize(("robot", "hand"), [("panda", None), ("panda", "panda_hand"), ("ur5", "tool0")])
def test_the_description_is_the_task(robot: str, hand: str | None, tmp_path: Path) -> None:
    ends = {"panda": ("default", [0.6, -0.3, 0, -2, 0, 1.8, 0.785]), "ur5": ([0, -1, 1, 0, 0, 0], [1, -1, 1, 0, 0, 0])}
    task = Task.of(hdplan.Scene(robot=robot, obstacles=BODIES, start=ends[robot][0], goal=ends[robot][1]), hand)
    found = describe(task, tmp_path)
    model = pin.buildModelFromXML(found.urdf)
    geometry = pin.GeometryModel()
    pin.buildGeomFromUrdfString(model, found.urdf, pin.GeometryType.COLLISION, geometry)
    geometry.addAllCollisionPairs()
    pin.removeCollisionPairsFromXML(model, geometry, found.srdf)
    ours = task.geometry()
    names = [[item.name.removesuffix("_0") for item in each.geometryObjects] for each in (geometry, ours)]
    body = {f"body_{index}": name for index, name in enumerate(names[1])}

    def distances(
        each: pin.GeometryModel, of: pin.Model, q: np.ndarray, name: list[str]
    ) -> dict[frozenset[str], float]:
        data = pin.GeometryData(each)
        pin.computeDistances(of, of.createData(), each, data, q)
        pairs = [frozenset((name[pair.first], name[pair.second])) for pair in each.collisionPairs]
        return {pair: result.min_distance for pair, result in zip(pairs, data.distanceResults, strict=True)}

    assert tuple(model.names)[1:] == found.joints == task.robot.joint_names
    np.testing.assert_allclose((model.lowerPositionLimit, model.upperPositionLimit), (task.lower, task.upper))
    for q in RNG.uniform(task.lower, task.upper, (5, task.robot.n)):
        theirs = distances(geometry, model, q, [body[name] for name in names[0]])
        assert theirs == pytest.approx(distances(ours, task.robot.model, task.robot.pin_q(q), names[1]), abs=1e-5)
    if hand:
        places = []
        for of, link, q in ((model, "hand", task.goal), (task.robot.model, hand, task.robot.pin_q(task.goal))):
            data = of.createData()
            pin.framesForwardKinematics(of, data, q)
            places.append(data.oMf[of.getFrameId(link)].homogeneous)
        np.testing.assert_allclose(*places, atol=1e-9)


def test_a_shape_that_no_file_holds_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="URDF knows no capsule"):
        describe(Task.of(hdplan.load_scene("panda_cage")), tmp_path)


def test_a_path_cut_evenly_lies_on_the_path() -> None:
    for steps in (1, 7, 31):
        path = RNG.normal(size=(4, 3)).cumsum(axis=0)
        cut = evenly(path, steps)
        assert len(cut) == steps + 1
        assert (cut[[0, -1]] == path[[0, -1]]).all()
        pieces = np.linalg.norm(np.diff(path, axis=0), axis=1)
        assert np.linalg.norm(np.diff(cut, axis=0), axis=1).max() <= pieces.sum() / steps * (1 + 1e-12)
        for q in cut:
            detours = np.linalg.norm(q - path[:-1], axis=1) + np.linalg.norm(q - path[1:], axis=1) - pieces
            assert detours.min() < 1e-12


def test_a_setting_that_never_succeeds_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some ends are not free, and each setting first plans a problem that is not counted."""
    draw, scene = np.random.default_rng(7), hdplan.load_scene("panda_cage")
    steps, blocked, ran = list(narrow_steps.STEPS), {0, 2}, []
    scenes = [replace(scene, name=f"{i:03}") for i in range(7)]
    certified = {(step, i): bool(draw.random() < 0.4) for step in steps for i in range(7)}
    certified |= {(steps[1], i): i == 5 for i in range(7)}  # too late

    def run(kind: str, step: str, given: hdplan.Scene, limit: float) -> narrow_steps.Outcome | None:
        number = int(given.name)
        ran.append((step, number, limit))
        return None if number in blocked else narrow_steps.Outcome(kind, step, certified[step, number], 3, 1.5)

    monkeypatch.setattr(narrow_steps, "run", run)
    monkeypatch.setattr(narrow_steps, "problems", lambda *_: iter(scenes))
    options = argparse.Namespace(folder=tmp_path, set=["cage"], every=1, first=0, give_up=3, time_limit=10.0)
    whole = list(narrow_steps.planned(options, tmp_path))
    counted = [(step, number) for step, number, limit in ran if limit == 10.0 and number not in blocked]
    assert [number for step, number in counted if step == steps[1]] == [1, 3, 4]
    assert [(step, number) for step, number, limit in ran if limit == narrow_steps.WARM_UP] == [
        (s, 1) for s in steps[1:]
    ]
    assert f"| cage | {steps[1]} | 0 of 3 |" in narrow_steps.table(whole)


def test_a_limit_of_processor_time_is_not_spent_by_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "perf_counter", wall := time.perf_counter)  # put back at the end
    parser = argparse.ArgumentParser()
    add_processor_time(parser)
    set_clock(parser.parse_args([]))
    assert time.perf_counter is wall
    set_clock(parser.parse_args(["--processor-time"]))
    limit, waits = 1.0, []

    def wait() -> bool:
        """Wait for longer than the limit, once."""
        if not waits:
            time.sleep(1.2 * limit)
        waits.append(time.perf_counter())
        return False

    began = wall()
    found = hdplan.plan(hdplan.load_scene("panda_cage"), time_limit=limit, stop=wait)
    assert waits
    assert wall() - began > limit
    assert found.certified
    assert not found.ended
