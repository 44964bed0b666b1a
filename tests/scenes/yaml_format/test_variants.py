"""A variant of a scene is the scene with some fields replaced, read and checked like any other."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from hdplan.scenes.errors import InputError
from hdplan.scenes.shapes import Sphere
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.scenes.yaml_format.variants import load_variant

ARM = Path("planar_arm")


def test_without_fields_it_is_the_scene() -> None:
    assert load_variant(ARM, {}, "planar_arm") == load_scene(ARM)


def test_fields_are_replaced_and_the_rest_stays() -> None:
    found = load_variant(
        ARM, {"obstacles.ball.pose.position.2": 0.5, "obstacles.1.pose.position.0": 1, "planner.waypoints": 9}, "v"
    )
    ball, prism = found.obstacles
    assert (tuple(ball.pose.position), tuple(prism.pose.position)) == ((0.9, 0.05, 0.5), (1.0, -0.75, 0.0))
    assert isinstance(ball.shape, Sphere)
    assert (found.name, found.planner.waypoints, found.start) == ("v", 9, load_scene(ARM).start)
    assert load_scene(ARM).planner.waypoints != 9
    assert load_variant(ARM, {}, "w").obstacles == load_scene(ARM).obstacles, "the file's own content is left as it is"


def test_ends_are_given_as_a_whole() -> None:
    found = load_variant(
        ARM, {"start.joints.joint1": 0.5, "start.joints.joint2": -1, "goal.joints.1": 2, "goal.joints.0": 1}, "v"
    )
    assert isinstance(found.start, JointTarget)
    assert dict(found.start.by_name or {}) == {"joint1": 0.5, "joint2": -1.0}
    assert isinstance(found.goal, JointTarget)
    assert found.goal.positions == (1.0, 2.0)
    assert load_variant(ARM, {"goal.state": "right"}, "v").goal != load_scene(ARM).goal


def test_names_may_hold_dots(tmp_path: Path) -> None:
    content = yaml.safe_load((Path(load_scene(ARM).source)).read_text())
    folder = Path(load_scene(ARM).source).parent
    content["robot"] = {"urdf": str(folder / "planar_arm.urdf"), "srdf": str(folder / "planar_arm.srdf")}
    content["obstacles"][0]["name"] = "ball.of.wood"
    content["obstacles"][1]["name"] = "ball"
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(content))
    found = load_variant(tmp_path / "s.yaml", {"obstacles.ball.of.wood.shape.radius": 0.3}, "v")
    assert found.obstacles[0].shape == Sphere(0.3)
    start = load_variant(tmp_path / "s.yaml", {"start.joints.a.b": 0.3}, "v").start
    assert isinstance(start, JointTarget)
    assert dict(start.by_name or {}) == {"a.b": 0.3}


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"strat.state": "right"}, ["unknown key 'strat'", "'start'"]),
        ({"planner.wayponts": 3}, ["planner", "'wayponts'", "'waypoints'"]),
        ({"planner.waypoints": "many"}, ["planner.waypoints", "'many'"]),
        ({"obstacles.bal.shape.radius": 1.0}, ["obstacles.bal", "no such entry", "'ball'"]),
        ({"obstacles.2.shape.radius": 1.0}, ["obstacles.2", "no such entry"]),
        ({"obstacles.ball.shape.radius": -1.0}, ["obstacles[0].shape.radius", "greater than 0"]),
        ({"obstacles.ball.shape.radius.x": 1.0}, ["obstacles.ball.shape.radius.x", "nothing there that holds fields"]),
        ({"hdplan.x": 1.0}, ["hdplan.x", "nothing there that holds fields"]),
        ({"goal.joints.1": 1.0}, ["goal.joints.1", "no such entry"]),
        ({"": 1.0}, ["unknown key"]),
        ({"start.": 1.0}, ["start"]),
        ({".": 1.0}, ["unknown key"]),
        ({"goal.joints": 3}, ["goal.joints"]),
    ],
)
def test_problems_that_do_not_fit_are_refused_in_one_line(fields: dict[str, object], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        load_variant(ARM, fields, "v")
    assert "\n" not in str(caught.value)
    assert all(word in str(caught.value) for word in ("planar_arm.yaml", *words)), str(caught.value)


def test_a_scene_of_another_format_is_refused(tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text("world: {}\n")
    with pytest.raises(InputError, match=r"s\.yaml: unknown key 'world'"):
        load_variant(tmp_path / "s.yaml", {"start.state": "right"}, "v")
