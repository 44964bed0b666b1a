"""Jobs of several stages among many problems: outcomes, data sets with stages, places drawn again."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

import hdplan
from hdplan import InputError, StageMark, Trajectory
from hdplan.planner.batch.job import Job
from hdplan.planner.batch.journal import Journal
from hdplan.planner.batch.lerobot import samples_of, write_lerobot
from hdplan.planner.batch.outcome import Options, Outcome, solve
from hdplan.planner.batch.run import _does
from hdplan.planner.batch.sample import sample
from hdplan.planner.batch.tables import MOTIONS, write_tables
from hdplan.scenes.yaml_format.variants import load_variant

FINGER = "panda_finger_joint1"
FPS = 50


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    stages = [hdplan.Wait(0.1, name="stand"), hdplan.Grip({FINGER: 0.02}, name="close"), hdplan.Wait(0.05, name="rest")]
    limits = hdplan.Limits(acceleration=4.0)
    scene = hdplan.Scene(robot="panda", start="default", limits=limits, job=hdplan.Job(stages))
    return solve(Job("wave", "", scene), Options(files=True, proofs=True))


def test_a_job_is_an_outcome_like_any_other(outcome: Outcome, tmp_path: Path) -> None:
    assert outcome.certified, outcome.text
    assert (outcome.figures["proof"], outcome.figures["robot"]) == ("written", "panda")
    assert outcome.files[".proof"].startswith(b"hdplan job proof")
    assert outcome.trajectory is not None
    with contextlib.closing(Journal(tmp_path / "journal")) as journal:
        journal.add(0, outcome)
        ((_, again),) = journal
        assert again.trajectory is not None
        assert again.trajectory.stages == outcome.trajectory.stages
        write_tables(tmp_path, journal)
    assert _does(again) == "stand, close, rest"
    stages = pyarrow.parquet.read_table(tmp_path / MOTIONS)["stage"].to_pylist()
    assert stages == [name for name in outcome.trajectory.stage_names for _ in outcome.trajectory.joint_names]


def test_a_job_that_fails_names_the_stage() -> None:
    away = hdplan.Job([hdplan.Wait(0.1), hdplan.Line(by=[1.5, 0.0, 0.0], name="away")])
    scene = hdplan.Scene(robot="panda", start="default", limits=hdplan.Limits(acceleration=4.0), job=away)
    found = solve(Job("far", "", scene), Options(diagnose=True))
    assert (found.status, found.cause) == ("not_certified", "stage_failed")
    assert "stage 'away'" in found.text
    refused = solve(Job("far", "", scene), Options(solver="chomp"))
    assert (refused.status, refused.cause) == ("refused", "bad_input")
    assert "--solver chomp: plans a single motion" in refused.text


def test_samples_know_their_stage(outcome: Outcome, tmp_path: Path) -> None:
    motion = outcome.trajectory
    assert motion is not None
    assert motion.times is not None
    other = Outcome("w2", "certified", "", "", Trajectory(
        motion.joint_names, motion.positions, {}, motion.times, stages=(StageMark("rest", 0), StageMark("more", 1))
    ), {"robot": "panda"})  # fmt: skip
    assert write_lerobot(tmp_path / "set", [(outcome, "one"), (other, "two")], FPS) == 2
    data = pyarrow.parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet").to_pydict()
    names = pyarrow.parquet.read_table(tmp_path / "set/meta/subtasks.parquet").to_pydict()["__index_level_0__"]
    assert names == ["stand", "close", "rest", "more"]
    count = len(samples_of(motion, FPS))
    for first, episode in ((0, motion), (count, other.trajectory)):
        assert episode is not None
        for i in range(count):
            now = min(episode.times[0] + i / FPS, episode.times[-1])  # type: ignore[index]
            assert names[data["subtask_index"][first + i]] == episode.stage_at(now)
    column = motion.joint_names.index(FINGER)
    fingers = np.array(data["action"])[:count, column]
    assert fingers[0] != fingers[-1]  # the gripper's action
    assert fingers[-1] == pytest.approx(0.02, abs=1e-7)
    about = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert about["features"]["subtask_index"] == {"dtype": "int64", "shape": [1], "names": None}
    assert set(about["features"]) == set(data)
    plain = Outcome("p", "certified", "", "", Trajectory(motion.joint_names, motion.positions, {}, motion.times), {})
    with pytest.raises(InputError, match="p: jobs and single motions are exported alone"):
        write_lerobot(tmp_path / "mixed", [(outcome, "one"), (plain, "two")], FPS)
    assert not (tmp_path / "mixed").exists()


def test_places_are_moved_with_all_that_leads_to_them() -> None:
    drawn = sample(Path("panda_pick_place"), 4, seed=3, jitter=0.03)
    assert drawn.rows[:2] == sample(Path("panda_pick_place"), 2, seed=3, jitter=0.03).rows
    before = hdplan.load_scene("panda_pick_place")
    assert before.job is not None
    places = set()
    for row in drawn.rows:
        after = load_variant(Path("panda_pick_place"), {k: v for k, v in row.items() if k != "name"}, "x")
        assert after.job is not None

        def off(stage: int, after: hdplan.Scene = after) -> np.ndarray:
            found = []
            for scene in (after, before):
                each = scene.job.stages[stage]
                goal = getattr(each, "goal", None)
                found.append(np.array(each.to if goal is None else goal.targets[0].pose.position))
            return found[0] - found[1]

        (one,), (other,) = ([x for x in scene.obstacles if x.name == "can"] for scene in (after, before))
        moved = np.array(one.pose.position) - other.pose.position
        np.testing.assert_allclose(off(0), moved, atol=1e-12)
        np.testing.assert_allclose(off(4), off(5), atol=1e-12)
        assert moved[2] == off(4)[2] == 0.0
        assert np.abs([moved, off(4)]).max() <= 0.03
        assert all(x == y for x, y in zip(after.obstacles, before.obstacles, strict=True) if x.name != "can")
        places |= {tuple(moved), tuple(off(4))}
    assert len(places) == 8
    with pytest.raises(InputError, match="give --jitter"):
        sample(Path("panda_pick_place"), 1, jitter=0.01, resize=0.1)


GRASPS = """
hdplan: 1
robot: {name: panda}
start: {state: default}
limits: {acceleration: 4}
obstacles: [{name: can, shape: {type: sphere, radius: 0.03}, pose: {position: [0.5, 0.3, 0.2]}}]
job:
  - {name: above, move: {GOAL}}
  - {name: grip, grip: {object: can}}
  - {name: carry, move: {any: [{pose: {position: [0.4, -0.3, 0.3], rpy: [3, 0, 0]}}]}}
  - {name: leave, release: {object: can}}
"""
POSES = "poses: [{position: [0.5, 0.3, 0.3], rpy: [3, 0, 0]}, {position: [0.6, 0.3, 0.2], rpy: [3, 1, 0]}]"


def test_all_grasps_are_moved_with_what_they_take(tmp_path: Path) -> None:
    file = tmp_path / "grasps.yaml"
    file.write_text(GRASPS.replace("GOAL", POSES), encoding="utf-8")
    (row,) = sample(file, 1, seed=1, jitter=0.05).rows
    before, after = hdplan.load_scene(file), load_variant(file, {k: v for k, v in row.items() if k != "name"}, "x")

    def places(scene: hdplan.Scene, stage: int) -> np.ndarray:
        assert scene.job is not None
        return np.array([target.pose.position for target in scene.job.stages[stage].goal.targets])

    by = np.array(after.obstacles[0].pose.position) - before.obstacles[0].pose.position
    np.testing.assert_allclose(places(after, 0) - places(before, 0), [by, by], atol=1e-12)
    assert by[:2].all()
    assert by[2] == 0.0
    assert np.abs(places(after, 2) - places(before, 2)).max() > 0.0


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ("any: [{joints: [0, 0, 0, -1, 0, 1, 0]}, {pose: {position: [0.5, 0.3, 0.3], rpy: [3, 0, 0]}}]", "only joints"),
        (
            POSES + "}}\n  - {repeat: {over: [{x: 0.1}], stages: [{name: $x, wait: $x}, {name: b $x, wait: $x}]",
            "repeat",
        ),
    ],
)
def test_places_that_cannot_be_drawn_are_refused(tmp_path: Path, goal: str, words: str) -> None:
    (tmp_path / "grasps.yaml").write_text(GRASPS.replace("GOAL", goal), encoding="utf-8")
    with pytest.raises(InputError, match=words):
        sample(tmp_path / "grasps.yaml", 1, jitter=0.05)
