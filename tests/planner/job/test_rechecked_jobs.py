"""Laws of the re-check of random jobs: it finds faults that are planted after planning."""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import hdplan

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

from picks import FINGERS, job, write_bracket
from picks_recheck import Motion, RefutedError, Scene, recheck

Data = dict[str, Any]
NUMBER, CLOSED = 6, 0.03  # a job of the Panda, with a can, and where the fingers hold that [m]


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Data, Data]:
    """Return a folder, a job, and its motion as a file has it."""
    folder = tmp_path_factory.mktemp("picks")
    write_bracket(folder)
    scene: Data = json.loads(json.dumps(job(NUMBER, folder), default=float))
    (folder / "job.yaml").write_text(yaml.safe_dump(scene))
    result = hdplan.plan_job(hdplan.load_scene(folder / "job.yaml"))
    assert result.certified
    result.save(folder / "job.json")
    return folder, scene, json.loads((folder / "job.json").read_text())


def rechecked(folder: Path, scene: Data, motion: Data) -> float:
    (folder / "planted.json").write_text(json.dumps(motion))
    return recheck(scene, folder, folder / "planted.json", step=0.03)


def stage(scene: Data, name: str) -> Data:
    found: Data = next(each for each in scene["job"] if each["name"] == name)
    return found


def rows_of(motion: Data, name: str) -> slice:
    marks = [*(each["row"] for each in motion["stages"]), len(motion["times"]) - 1]
    number = [each["name"] for each in motion["stages"]].index(name)
    return slice(marks[number], marks[number + 1] + 1)


def fingers(motion: Data, rows: slice, about: float, share: float = 0.0) -> None:
    """Let fingers move only by a share of what they move, from where they are `about`."""
    column = motion["joint_names"].index("panda_finger_joint1")
    for what, middle in (("positions", about), ("velocities", 0.0), ("accelerations", 0.0)):
        for row in motion[what][rows]:
            row[column] = middle + share * (row[column] - middle)


def placed(scene: Data, name: str) -> list[float]:
    found: list[float] = next(each for each in scene["obstacles"] if each["name"] == name)["pose"]["position"]
    return found


def can_was_elsewhere(scene: Data, motion: Data) -> None:
    placed(scene, "can")[1] += 0.02


def another_stands_where_it_goes(scene: Data, motion: Data) -> None:
    goal = stage(scene, "carry")["move"]["poses"][0]["position"]
    placed(scene, "ball")[:] = [goal[0], goal[1] + 0.02, goal[2] - 0.06]


def fingers_open_while_it_is_lowered(scene: Data, motion: Data) -> None:
    lowered = rows_of(motion, "lower")
    fingers(motion, slice((lowered.start + lowered.stop) // 2, None), 0.04)


def fingers_open_before_it_is_lowered(scene: Data, motion: Data) -> None:
    fingers(motion, slice(rows_of(motion, "lower").start, None), 0.04)


def fingers_never_close(scene: Data, motion: Data) -> None:
    fingers(motion, slice(None), 0.04)


def fingers_close_beside_it(scene: Data, motion: Data) -> None:
    stage(scene, "take it")["grip"]["joints"] = dict.fromkeys(FINGERS, 0.04 + 0.2 * (CLOSED - 0.04))
    fingers(motion, slice(None), 0.04, 0.2)


def fingers_hardly_open(scene: Data, motion: Data) -> None:
    stage(scene, "let go")["release"]["joints"] = dict.fromkeys(FINGERS, CLOSED)
    fingers(motion, slice(rows_of(motion, "let go").start, None), CLOSED)


def it_is_let_go_in_the_air(scene: Data, motion: Data) -> None:
    for each in scene["obstacles"]:
        if each["name"] == "table":
            each["pose"]["position"][2] -= 0.02


def table_is_higher(scene: Data, motion: Data) -> None:
    for each in scene["obstacles"]:
        if each["name"] == "table":
            each["pose"]["position"][2] += 0.005


def goal_was_elsewhere(scene: Data, motion: Data) -> None:
    stage(scene, "carry")["move"]["poses"][0]["position"][0] += 0.02


def it_starts_elsewhere(scene: Data, motion: Data) -> None:
    scene["start"] = {"joints": [0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.8]}


def it_is_to_stay_upright(scene: Data, motion: Data) -> None:
    stage(scene, "carry")["path"] = {"upright": {"link": "can", "axis": "x", "tolerance": 0.35}}


def a_stage_is_left_out(scene: Data, motion: Data) -> None:
    del motion["stages"][-1]


def it_goes_faster(scene: Data, motion: Data) -> None:
    scene["limits"]["jerk"] = 100


@pytest.mark.parametrize(
    ("plant", "why"),
    [
        (can_was_elsewhere, "(to it|take it): "),
        (another_stands_where_it_goes, "(carry|lower): .* apart"),
        (fingers_open_while_it_is_lowered, "lower: joints move that are to stand still"),
        (fingers_open_before_it_is_lowered, "carry: joints move that are to stand still"),
        (fingers_never_close, "take it: fingers do not end"),
        (fingers_close_beside_it, "take it: panda_.*finger is .* mm from can"),
        (fingers_hardly_open, "back out: .*can.* apart"),
        (it_is_let_go_in_the_air, "let go: can is .* mm above"),
        (table_is_higher, "table"),
        (goal_was_elsewhere, "carry: does not end at one of its poses"),
        (it_starts_elsewhere, "begins elsewhere"),
        (it_is_to_stay_upright, "carry: tilts can"),
        (a_stage_is_left_out, "stages are missing"),
        (it_goes_faster, "jerk beyond its limit"),
    ],
)
def test_planted_faults_are_found(
    planned: tuple[Path, Data, Data], plant: Callable[[Data, Data], None], why: str
) -> None:
    folder, scene, motion = copy.deepcopy(planned)
    plant(scene, motion)
    with pytest.raises(RefutedError, match=why):
        rechecked(folder, scene, motion)


@pytest.mark.parametrize("where", ["lift", "carry", "lower"])
def test_contacts_of_the_held_object_alone_are_found(planned: tuple[Path, Data, Data], where: str) -> None:
    """A pea is at the lower end of the can in the middle of a stage; the hand holds the can farther up."""
    folder, scene, motion = copy.deepcopy(planned)
    bodies = Scene(scene, folder)
    driven = Motion(bodies.model, motion, scene["robot"]["locked"], bodies.mimics)
    rows = rows_of(motion, where)
    bodies.place(driven.whole(driven.q[rows_of(motion, "take it").stop - 1]))
    hand = stage(scene, "take it")["grip"]["link"]
    bodies.held["can"] = hand, np.linalg.inv(bodies.link(hand)) @ bodies.places["can"], set()
    bodies.place(driven.whole(driven.q[(rows.start + rows.stop) // 2]))
    for each in motion["verdict"]["stages"]:
        each["clearance_m"] = 0.0
    place = bodies.link("can") @ [0.0, 0.0, -0.055, 1.0]
    scene["obstacles"].append(
        {"name": "pea", "shape": {"type": "sphere", "radius": 0.003}, "pose": {"position": place[:3].tolist()}}
    )
    with pytest.raises(RefutedError, match=r"(can and pea|pea and can) are"):
        rechecked(folder, scene, motion)


def test_certified_jobs_are_not_refuted(planned: tuple[Path, Data, Data]) -> None:
    assert rechecked(*planned) == pytest.approx(1e-3, abs=1e-4)
