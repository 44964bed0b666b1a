"""A user of a scene with sizes knows them, or refuses them by name: nobody leaves one out in silence."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml

import hdplan
from hdplan import Calibration, InputError, Job, Move, Scene, Tracking, Uncertainty, symbolic
from hdplan.control import BarrierSettings, Controller, scene_barriers
from hdplan.planner.batch.sample import sample
from hdplan.planner.build import problem_of
from hdplan.planner.control.follow import follow
from hdplan.planner.control.simulation import replay
from hdplan.planner.diagnosis import diagnose
from hdplan.planner.problem.unknown import kept, spans
from hdplan.planner.robot.setup import Setup
from hdplan.planner.symbolic.pairs import all_movable
from hdplan.planner.terminal.explain import explain
from hdplan.scenes.errors import UnsolvableError
from hdplan.scenes.scene import unknown_in
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.scenes.yaml_format.schema import scene_schema

PERSON = load_scene("panda_person")


def with_one(field: str) -> Scene:
    """The scene with the person in which just one size is not 0."""
    section, name = field.rsplit(".", 1)
    obstacles = [dataclasses.replace(each, uncertainty=None) for each in PERSON.obstacles]
    robot: dict[str, Any] = {"tracking": None, "calibration": None}
    if section == "robot.tracking":
        robot["tracking"] = Tracking(**{name: 0.003})
    elif section == "robot.calibration":
        robot["calibration"] = Calibration(**{name: 0.003})
    else:
        obstacles[2] = dataclasses.replace(obstacles[2], uncertainty=Uncertainty(**{name: 0.003}))
    return dataclasses.replace(PERSON, obstacles=obstacles, robot=dataclasses.replace(PERSON.robot, **robot))


SIZES = [
    *(f"obstacles[2].uncertainty.{each.name}" for each in dataclasses.fields(Uncertainty)),
    *(f"robot.tracking.{each.name}" for each in dataclasses.fields(Tracking)),
    *(f"robot.calibration.{each.name}" for each in dataclasses.fields(Calibration)),
]
REFUSES: dict[str, Callable[[Scene], object]] = {
    "a controller": lambda s: Controller.of(s),
    "barriers": lambda s: scene_barriers(s, Setup.of(s).robot, BarrierSettings()),
    "following": lambda s: follow(Setup.of(s), None),
    "symbols": symbolic.clearance,
    "generated code": lambda s: all_movable(Setup.of(s)),
}


@pytest.mark.parametrize("field", SIZES)
def test_functions_of_the_nominal_world_refuse_sizes(field: str) -> None:
    scene = with_one(field)
    assert [*unknown_in(scene)] == [field]
    for call in REFUSES.values():
        with pytest.raises(InputError, match=re.escape(f"{field}: is not 0, and ")) as error:
            call(scene)
        assert "\n" not in str(error.value)
    job = {"goal": None, "job": Job([Move(scene.goal)]), "timing": None}
    if not re.match(r"obstacles.*(position|orientation)", field):
        words = field if field.endswith("speed") else field.rpartition(".")[0]
        with pytest.raises(InputError, match=re.escape(f"{words}: applies to single motions")):
            dataclasses.replace(scene, **job)
    if field.endswith("speed"):
        with pytest.raises(InputError, match=r"uncertainty.speed: needs known times, but timing.duration is missing"):
            hdplan.plan(dataclasses.replace(scene, timing=None))


@pytest.mark.parametrize("field", SIZES)
def test_every_output_shows_every_size(field: str, tmp_path: Path) -> None:
    """Files, schema, plan, certificate, explanation, replay, samples."""
    scene = with_one(field)
    scene.save(tmp_path / "s.yaml")
    assert load_scene(tmp_path / "s.yaml") == scene
    jsonschema.validate(yaml.safe_load((tmp_path / "s.yaml").read_text()), scene_schema())
    setup = Setup.of(scene)
    problem = problem_of(setup)
    rows = explain(problem)
    assert rows["unknown"]
    assert re.sub(r"\[\d\]", "[]", field) in dict(rows["on"])["unknown"]
    if field != "robot.tracking.velocity":
        farther = kept(setup)["crate"] - scene.planner.clearance + spans(setup.scene.obstacles[2], 2.5)[-1].growth
        assert farther > 0.0
    home = setup.query.start
    motion = hdplan.Trajectory(setup.robot.joint_names, np.array([home, home]), times=[0.0, 2.5])
    found = hdplan.certify(scene, motion, check_ends=False)
    assert found.certified
    if field == "robot.tracking.velocity":
        assert (
            found.uses[0].limit < np.array(Setup.of(dataclasses.replace(scene, robot="panda")).limits["velocity"]).max()
        )
    else:
        assert "in every world within the scene's sizes" in found.text
        field_name = re.sub(r"\[\d\]", "[]", field)
        assert found.worst is not None
        assert found.worst.unknown > 0 or found.worst.other != "crate"
        assert found.worst.unknown == 0 or field_name in found.notes[0]
    assert field in replay(setup, motion).text
    drawn = sample(tmp_path / "s.yaml", 1, jitter=0.01)
    assert len(drawn.rows) == 1


def test_a_plan_that_fails_names_the_size_that_is_too_large() -> None:
    scene = load_scene("panda_cage")
    unsure = scene.with_obstacles(
        [dataclasses.replace(each, uncertainty=Uncertainty(0.016)) for each in scene.obstacles]
    )
    with pytest.raises(UnsolvableError) as error:
        hdplan.plan(unsure)
    found = diagnose(unsure, error.value)
    assert "50% of the uncertainty (obstacles[].uncertainty, robot.tracking, robot.calibration)" in found.advice


def test_the_viewer_keeps_sizes() -> None:
    pytest.importorskip("viser", reason="the viewer is optional")
    from hdplan.planner.view.edited_scene import Edited
    from hdplan.planner.view.scene_edits import kept_clear, placed

    edited = Edited.of(Setup.of(PERSON))
    moved = placed(edited, "crate", (0.6, 0.05, 0.15))
    for scene in (kept_clear(edited, "crate", 0.02).scene, moved.scene):
        assert [*unknown_in(scene)] == [*unknown_in(PERSON)]


WRONG = [
    ("obstacles", {"position": -0.01}, "obstacles[0].uncertainty.position: must be a finite number 0 to 1 [m]"),
    ("obstacles", {"position": 2}, "obstacles[0].uncertainty.position: must be a finite number 0 to 1 [m]"),
    ("obstacles", {"orientation": 4}, "obstacles[0].uncertainty.orientation: must be a finite number 0 to 3.14159"),
    ("obstacles", {"speed": float("nan")}, "obstacles[0].uncertainty.speed: must be a finite number 0 to 100 [m/s]"),
    ("obstacles", {}, "obstacles[0].uncertainty: is empty: leave it out, or give some of"),
    ("obstacles", {"size": 0.1}, "obstacles[0].uncertainty: unknown key 'size'"),
    ("obstacles", 0.01, "obstacles[0].uncertainty: must be a mapping"),
    ("tracking", {"position": [0.1, -0.1]}, "robot.tracking.position[1]: must be a finite number 0 to 1 [rad or m]"),
    ("tracking", {"position": "small"}, "from joint names to numbers, 0 to 1 [rad or m], found the text 'small'"),
    ("tracking", {"position": {"a": -1}}, "robot.tracking.position.a: must be a finite number 0 to 1 [rad or m]"),
    ("tracking", {"velocity": 0.1}, "robot.tracking.velocity: only matters for a motion with times"),
    ("tracking", {"lag": 0.1}, "robot.tracking: unknown key 'lag'"),
    ("calibration", {"position": "x"}, "robot.calibration.position: must be a finite number 0 to 1 [m]"),
    ("calibration", {}, "robot.calibration: is empty"),
]


@pytest.mark.parametrize(("where", "value", "message"), WRONG)
def test_sizes_that_have_no_meaning_are_refused_in_one_line(
    where: str, value: Any, message: str, tmp_path: Path
) -> None:
    content = yaml.safe_load(Path(hdplan.scenes.__path__[0], "shipped", "panda_cage.yaml").read_text())
    (content["obstacles"][0] if where == "obstacles" else content["robot"])[
        "uncertainty" if where == "obstacles" else where
    ] = value
    file = tmp_path / "s.yaml"
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=re.escape(message)) as error:
        load_scene(file)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(str(file))
    if "only" not in message and "speed" not in message:  # what one section needs of another, and what is no number
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(content, scene_schema())


@pytest.mark.parametrize(
    ("tracking", "message"),
    [
        (Tracking([0.1] * 3), "robot.tracking.position: 3 values, but panda plans 7 joints"),
        (Tracking({"panda_joint9": 0.1}), "robot.tracking.position: unknown joint 'panda_joint9'"),
        (Tracking({"panda_finger_joint1": 0.1}), "robot.tracking.position: joint 'panda_finger_joint1' is held"),
    ],
)
def test_lags_of_joints_that_are_none_are_refused(tracking: Tracking, message: str) -> None:
    scene = dataclasses.replace(PERSON, robot=dataclasses.replace(PERSON.robot, tracking=tracking))
    with pytest.raises(InputError, match=re.escape(message)) as error:
        hdplan.plan(scene)
    assert str(error.value).count(message) == 1
