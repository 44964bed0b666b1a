"""Benchmarks: what the peers of hdplan are given is the same problem, an interrupted run continues, and waiting takes
nothing from processor time."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import hdplan

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "benchmarks"))
import narrow_steps
import quality
from peer_task import Task, evenly
from peer_urdf import describe
from processor_time import add_processor_time, set_clock
from resumed import kept, read

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


def outcome(problem: str, verdict: str = "certified", energy: float = 1.5) -> quality.Outcome:
    return quality.Outcome(
        "panda", "pose", 0, 3.0, "box", problem, verdict, 1.25, 3.5, 499.0, energy, *RNG.uniform(size=3).tolist()
    )


def test_finished_measurements_are_kept(tmp_path: Path) -> None:
    file = tmp_path / "quality.csv"
    done = [outcome("0001"), outcome("0002", 'in contact: "a", b', np.nan), outcome("0003")]
    assert list(kept(file, quality.Outcome, [], iter(done))) == done
    text = file.read_text(encoding="utf-8")
    assert [str(each) for each in read(file, quality.Outcome)] == [str(each) for each in done]
    for end in range(text.index("\n") + 1, len(text)):  # wherever it is cut, what is whole is read
        file.write_text(text[:end], encoding="utf-8")
        whole = text[:end].count("\n") - 1
        assert [str(each) for each in read(file, quality.Outcome)] == [str(each) for each in done[:whole]]
    more = outcome("0004")
    list(kept(file, quality.Outcome, read(file, quality.Outcome), iter([more])))
    assert [str(each) for each in read(file, quality.Outcome)] == [str(each) for each in [*done[:2], more]]


def test_another_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "other.csv"
    file.write_text("robot,goals\npanda,pose\n", encoding="utf-8")
    with pytest.raises(SystemExit, match="not a file of this benchmark"):
        read(file, quality.Outcome)


def test_steps_that_were_cut_off_go_on_as_if_they_were_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A setting is given up, some ends are not free, and the first problem with free ends is planned twice."""
    draw, scene = np.random.default_rng(7), hdplan.load_scene("panda_cage")
    steps, numbers, planned = list(narrow_steps.STEPS), [f"{i:03}" for i in range(7)], []
    certified = {(step, number): bool(draw.random() < 0.4) for step in steps for number in numbers}
    certified |= {(steps[1], number): number == "005" for number in numbers}  # too late

    def run(kind: str, step: str, number: str, _: hdplan.Scene, limit: float) -> narrow_steps.Outcome | None:
        planned.append((step, number, limit))
        if number in ("000", "002"):
            return None
        return narrow_steps.Outcome(kind, step, number, certified[step, number], 3, 1.5)

    def problems(*_: object) -> Iterator[tuple[str, hdplan.Scene]]:
        yield from ((number, scene) for number in numbers)

    monkeypatch.setattr(narrow_steps, "run", run)
    monkeypatch.setattr(narrow_steps, "problems", problems)
    arguments = argparse.Namespace(folder=tmp_path, set=["cage"], every=1, first=0, give_up=3, time_limit=10.0)
    whole = list(narrow_steps.planned(arguments, [], tmp_path))
    warm_ups = [(step, number) for step, number, limit in planned if limit == narrow_steps.WARM_UP]
    assert warm_ups == [(step, "001") for step in steps[1:]]
    assert planned[:3] == [(steps[0], number, 10.0) for number in ("000", "001", "001")]
    assert {each.number for each in whole} == set(numbers) - {"000", "002"}
    assert [each.number for each in whole if each.step == steps[1]] == ["001", "003", "004"]
    for cut in range(len(whole) + 1):
        planned.clear()
        rest = list(narrow_steps.planned(arguments, whole[:cut], tmp_path))
        assert whole[:cut] + rest == whole
        again = {(step, number) for step, number, _ in planned}
        assert not again & {(each.step, each.number) for each in whole[:cut]}
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
