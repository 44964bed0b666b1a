"""Failures of known cause are named: problems of the planar arm, drawn at random, each with one planted fault."""

from __future__ import annotations

import ast
import copy
import dataclasses
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner import diagnosis
from hdplan.planner.causes import CAUSES
from hdplan.planner.diagnosis import Diagnosis, diagnose
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError, InputError, UnsolvableError, naming
from hdplan.scenes.scene import Scene
from tests.commands import in_process

ARM = hdplan.load_scene("planar_arm")
ROOT = Path(__file__).resolve().parent.parent.parent
TIP, HEIGHT = 0.04, 0.1  # radius of the ball at the arm's tip, and where its centre moves [m]
SECONDS = 1.0


def tip(q: Array) -> Array:
    """The centre of the ball at the arm's tip, two links of 0.5 m."""
    first, second = q[0], q[0] + q[1]
    return np.array([0.5 * (np.cos(first) + np.cos(second)), 0.5 * (np.sin(first) + np.sin(second)), HEIGHT])


def change(scene: Scene, **changes: Any) -> Scene:
    return dataclasses.replace(scene, **changes)


def ball_beyond_the_tip(scene: Scene, goal: Array, gap: float, clearance: float | None = None) -> Scene:
    place, radius = tip(goal), 0.1
    outward = place * [1, 1, 0] / np.hypot(place[0], place[1])
    at = hdplan.Pose(place + outward * (TIP + radius + gap))
    return change(scene, obstacles=(hdplan.Obstacle("ball", hdplan.Sphere(radius), at, clearance=clearance),))


def lintel(gap: float) -> hdplan.Obstacle:
    """A beam over the whole plane of the arm between start and goal; the tip passes under it with a gap."""
    beam = hdplan.Box([2.4, 0.05, 0.1])
    return hdplan.Obstacle("beam", beam, hdplan.Pose([0.0, 0.0, HEIGHT + TIP + gap + 0.05]))


def kept_within(reach: float) -> hdplan.PathConstraints:
    """The elbow, which goes through (0.5, 0), stays where x is at most `reach` [m]."""
    box = hdplan.Within("forearm", [2.0, 4.0, 4.0], hdplan.Pose([reach - 1.0, 0.0, 0.0]))
    return hdplan.PathConstraints(position=box)


def post(across: float) -> hdplan.Obstacle:
    """A post in the way of the outstretched arm, which has to bend its elbow to pass it."""
    return hdplan.Obstacle("post", hdplan.Cylinder(0.05, 0.4), hdplan.Pose([0.85, across, HEIGHT]))


def column() -> hdplan.Obstacle:
    """A column in the way of the upper arm, around whose middle a ball would find a way."""
    return hdplan.Obstacle("column", hdplan.Cylinder(0.05, 0.4), hdplan.Pose([0.4, 0.0, HEIGHT]))


def settings(**values: Any) -> hdplan.PlannerSettings:
    return hdplan.PlannerSettings(polish=0, **values)


def planted(cause: str, seed: int) -> Scene:
    """A problem with one fault."""
    drawn = np.random.default_rng([seed, *cause.encode()])
    start, goal = drawn.uniform([0.6, 0.0], [1.2, 0.5]), drawn.uniform([-1.2, -0.5], [-0.6, 0.0])
    scene = change(ARM, obstacles=(), start=start.tolist(), goal=goal.tolist(), planner=settings())
    size = float(drawn.uniform(0.003, 0.015))
    fixed = hdplan.Timing(duration=float(np.abs(goal - start).max() / 2.0 * drawn.uniform(0.3, 0.8)))
    wanted = hdplan.Timing(duration=float(drawn.uniform(1.5, 2.5)))
    weak = hdplan.Limits(torque=float(drawn.uniform(0.05, 0.3)))
    stiff = hdplan.Limits(position={"elbow": [-0.6, 0.6]})
    far = hdplan.Pose([float(drawn.uniform(1.1, 1.5)), 0.0, HEIGHT])
    makers: dict[str, Callable[[], Scene]] = {
        "end_in_contact": lambda: ball_beyond_the_tip(scene, goal, -0.003),
        "end_too_close": lambda: ball_beyond_the_tip(scene, goal, size, size + 0.002),
        "end_beyond_limits": lambda: change(scene, goal=[goal[0], 2.6 + size]),
        "goal_not_reached": lambda: change(scene, goal=hdplan.PoseTarget(pose=far, free_rotation="all")),
        "too_hurried": lambda: change(scene, timing=fixed),
        "torque": lambda: change(scene, timing=wanted, limits=weak),
        "clearance": lambda: change(scene, obstacles=(lintel(size),), planner=settings(clearance=size + 0.002)),
        "joint_limit": lambda: change(scene, obstacles=(post(2 * size),), limits=stiff),
        "disconnected": lambda: change(scene, obstacles=(lintel(-0.012 - 0.3 * size),)),
        "local_minimum": lambda: change(scene, obstacles=(column(),)),
        "time": lambda: change(scene, obstacles=ARM.obstacles, planner=settings(waypoints=200)),
        "end_off_path": lambda: change(scene, path=kept_within(0.15)),
        "path_constraint": lambda: change(scene, path=kept_within(0.46)),
        "bad_input": lambda: change(scene, goal={"shoulder": 0.1, "elbw": 0.2}),
    }
    return makers[cause]()


KINDS = (
    *("end_in_contact", "end_too_close", "end_beyond_limits", "goal_not_reached", "too_hurried", "torque"),
    *("clearance", "joint_limit", "local_minimum", "bad_input", "time", "end_off_path"),
    *("path_constraint", "disconnected"),
)


def diagnosed(cause: str, seed: int) -> Diagnosis:
    scene, seconds = planted(cause, seed), 1e-3 if cause == "time" else SECONDS
    failure: Any
    try:
        failure = hdplan.plan(scene, time_limit=seconds)
    except HdplanError as error:
        failure = error
    else:
        assert not failure.certified
    return diagnose(scene, failure, time_limit=seconds)


@pytest.fixture(autouse=True)
def short_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "MOST_SECONDS", 2.0)


LONG = ("joint_limit", "local_minimum", "torque", "too_hurried")  # these take seconds: only among the two hundred


@pytest.mark.parametrize("cause", [cause for cause in KINDS if cause not in LONG])
def test_a_planted_cause_is_named(cause: str) -> None:
    found = diagnosed(cause, 0)
    assert found.cause == cause, found
    assert found.text.startswith(CAUSES[cause])
    assert "\n" not in found.text + found.advice
    if cause == "disconnected":
        assert found.advice.startswith("without obstacle beam: certified")
    if cause == "clearance":
        assert "of the clearance (planner.clearance: 0.0" in found.advice


@pytest.mark.slow
def test_two_hundred_planted_causes_are_named() -> None:
    wrong = [(cause, seed) for cause in KINDS for seed in range(1, 19) if diagnosed(cause, seed).cause != cause]
    assert len(wrong) <= 0.05 * 18 * len(KINDS), wrong


def test_a_configuration_that_helps_is_free() -> None:
    scene = planted("end_in_contact", 3)
    advice = diagnosed("end_in_contact", 3).advice
    values = dict(each.split() for each in advice.partition(" is free: ")[2].split(", "))
    free = [float(values[name]) for name in ("shoulder", "elbow")]
    assert hdplan.plan(scene.with_goal(free), time_limit=10.0).certified


def test_causes_are_listed_and_survive() -> None:
    """Every cause that an error is raised with is one of CAUSES; naming a file, pickling and copying keep it."""
    raised = set()
    for folder in ("planner", "scenes"):
        for file in (ROOT / folder).rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            for node in ast.walk(ast.parse(text)) if "UnsolvableError(" in text else ():
                if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "UnsolvableError":
                    raised |= {each.value for each in node.args[1:] if isinstance(each, ast.Constant)}
    assert {"end_in_contact", "too_hurried"} <= raised <= set(CAUSES)
    error = UnsolvableError("no way", "torque", ("post",))
    for again in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert (str(again), again.cause, again.by) == ("no way", "torque", ("post",))
    with pytest.raises(UnsolvableError, match=r"^a\.yaml: no way$") as caught, naming("a.yaml"):
        raise error
    assert (caught.value.cause, caught.value.by) == ("torque", ("post",))
    assert issubclass(UnsolvableError, InputError)


def test_the_command_says_what_helps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    command = in_process(monkeypatch, capsys)

    planted("end_in_contact", 0).save("end_in_contact.yaml")
    code, out, err = command("plan", "end_in_contact.yaml", "--diagnose")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "overlap by 3 mm; what helps: within " in err
    planted("path_constraint", 0).save("path.yaml")
    code, out, err = command("plan", "path.yaml", "--diagnose", "--json", "--time-limit", "1")
    assert (code, err) == (1, "")
    assert json.loads(out)["diagnosis"]["cause"] == "path_constraint"
    assert json.loads(out)["diagnosis"]["advice"].startswith("without path: certified")
