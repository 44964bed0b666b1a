"""Edits of scenes as values: what each changes and leaves alone, what is refused, and the way back."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.certificate.pose_goals import miss_of
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view import ends, scene_edits
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.history import History
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacle_motion import ObstacleMotion
from hdplan.scenes.obstacles import Obstacle, TimedPoses
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box, Mesh, Sphere
from hdplan.scenes.targets import Goals, PoseTarget
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from hdplan.scenes.yaml_format.shape_fields import CLASSES
from hdplan.scenes.yaml_format.writer import scene_text

ROD = Obstacle("rod", Box((0.02, 0.3, 0.02)), Pose((0.5, 0.2, 0.1), (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))))


@pytest.fixture(scope="module")
def edited(scene: Scene) -> Edited:
    return Edited.of(Setup.of(dataclasses.replace(scene, obstacles=(*scene.obstacles, ROD))))


def obstacles(edited: Edited) -> dict[str, Obstacle]:
    return {obstacle.name: obstacle for obstacle in edited.scene.obstacles}


def saved_and_read(scene: Scene, folder: Path) -> Scene:
    file = folder / "scene.yaml"
    file.write_text(scene_text(scene), encoding="utf-8")
    return load_scene(file)


def test_every_shape_of_the_format_can_be_added() -> None:
    assert {type(shape) for shape in scene_edits.NEW.values()} | {Mesh} == set(CLASSES.values())
    assert all(isinstance(shape, CLASSES[word]) for word, shape in scene_edits.NEW.items())


def test_added_obstacles_are_free_and_saved_with_the_scene(edited: Edited, tmp_path: Path) -> None:
    now = edited
    shapes = [*scene_edits.NEW.items(), ("hook", Mesh(shipped_scenes()["panda_vase"].parent / "hook.obj", 0.2))]
    for word, shape in [*shapes, *shapes]:
        before = now
        now, thing = scene_edits.added(before, shape, word)
        assert now.scene.obstacles[:-1] == before.scene.obstacles
        assert now.scene.obstacles[-1].name == thing.name
        assert now.contacts == ((), ())
    assert saved_and_read(now.scene, tmp_path) == now.scene
    assert {"box", "box2", "hook", "hook2"} <= set(obstacles(now))


def test_a_duplicate_stands_beside_and_keeps_all_but_name_and_place(edited: Edited) -> None:
    now, (thing,) = scene_edits.duplicated(scene_edits.kept_clear(edited, "rod", 0.01), "rod")
    first, second = obstacles(now)["rod"], obstacles(now)[thing.name]
    assert (second.shape, second.clearance) == (first.shape, 0.01)
    away = np.subtract(second.pose.position, first.pose.position)
    np.testing.assert_allclose(away, [-0.36, 0.0, 0.0], atol=1e-12)  # 1.2 of its length, along its own y
    assert scene_edits.duplicated(now, thing.name)[1][0].name == "rod3"


def test_an_edit_changes_its_field_alone(edited: Edited) -> None:
    cases: list[tuple[str, Any, Callable[[], Edited]]] = [
        ("shape", Box((0.1, 0.3, 0.02)), lambda: scene_edits.resized(edited, "rod", size=(0.1, 0.3, 0.02))),
        (
            "pose",
            dataclasses.replace(ROD.pose, position=(1, 2, 3)),
            lambda: scene_edits.placed(edited, "rod", (1, 2, 3)),
        ),
        ("clearance", 0.02, lambda: scene_edits.kept_clear(edited, "rod", 0.02)),
        ("name", "bar", lambda: scene_edits.renamed(edited, "rod", "bar")),
    ]
    for field, value, edit in cases:
        changed = edit()
        assert changed.scene.obstacles == (*edited.scene.obstacles[:-1], dataclasses.replace(ROD, **{field: value}))
        assert dataclasses.replace(changed.scene, obstacles=edited.scene.obstacles) == edited.scene
    assert "rod" not in obstacles(scene_edits.deleted(edited, "rod"))
    assert scene_edits.planned_by(edited, clearance=0.01, waypoints=20, polish=3).scene.planner.waypoints == 20


def test_an_obstacle_gets_a_speed_where_times_are_known(edited: Edited) -> None:
    with pytest.raises(InputError, match=r"timing\.duration is missing"):
        scene_edits.moving(edited, "rod", (0.1, 0.0, 0.0), (0.0, 0.0, 0.0))
    timed = scene_edits.lasting(edited, 2.0)
    now = scene_edits.moving(timed, "rod", (0.1, 0.0, 0.0), (0.0, 0.0, 0.5))
    np.testing.assert_allclose(ObstacleMotion.of(obstacles(now)["rod"]).velocity, [[0.1, 0.0, 0.0]])
    with pytest.raises(InputError, match=r"timing\.duration is missing"):
        scene_edits.lasting(now, None)
    assert scene_edits.moving(now, "rod", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).scene == timed.scene
    assert scene_edits.lasting(timed, None).scene == edited.scene


@pytest.mark.core
def test_timed_poses_are_passed_faster_and_slower(edited: Edited) -> None:
    way = TimedPoses((0.5, 1.0, 2.5), (ROD.pose, Pose((0.6, 0.2, 0.1)), Pose((0.6, 0.4, 0.1))))
    scene = dataclasses.replace(
        edited.scene, obstacles=(dataclasses.replace(ROD, motion=way),), timing=Timing(duration=2.0)
    )
    begin = Edited.of(Setup.of(scene))
    now = scene_edits.passing(begin, "rod", 1.0)
    motion = obstacles(now)["rod"].motion
    assert isinstance(motion, TimedPoses)
    assert motion.times == (0.5, 0.75, 1.5)
    assert motion.poses == way.poses
    with pytest.raises(InputError, match="greater than 0"):
        scene_edits.passing(begin, "rod", 0.0)
    with pytest.raises(InputError, match="timed poses"):
        scene_edits.passing(edited, "rod", 1.0)
    second, _ = scene_edits.duplicated(begin, "rod")
    assert len({tuple(obstacle.pose.position) for obstacle in second.scene.obstacles}) == 2


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (
            lambda e: scene_edits.resized(e, "rod", size=(0.0, 0.3, 0.02)),
            r"obstacle rod: .*size\[0\]: must be .*greater",
        ),
        (lambda e: scene_edits.resized(e, "rod", size=(float("nan"), 0.3, 0.02)), "finite"),
        (
            lambda e: scene_edits.resized(
                scene_edits.added(e, scene_edits.NEW["points"], "p")[0], "p", points=((0, 0, 0),)
            ),
            "volume",
        ),
        (lambda e: scene_edits.renamed(e, "rod", "ball"), "'ball' is taken"),
        (lambda e: scene_edits.renamed(e, "rod", ""), "name"),
        (lambda e: scene_edits.kept_clear(e, "rod", -0.1), "clearance"),
        (lambda e: scene_edits.placed(e, "rod", (0.0, float("inf"), 0.0)), "position"),
        (lambda e: scene_edits.planned_by(e, waypoints=2), "planner: .*waypoints"),
        (lambda e: scene_edits.planned_by(e, distance="l2"), "distance"),
        (lambda e: scene_edits.planned_by(e, objective="time"), "objective"),
        (lambda e: scene_edits.lasting(e, -1.0), "timing: .*duration"),
    ],
)
def test_edits_no_file_could_hold_are_refused(edited: Edited, edit: Callable[[Edited], Edited], words: str) -> None:
    before = scene_text(edited.scene)
    with pytest.raises(InputError, match=words) as refused:
        edit(edited)
    assert "\n" not in str(refused.value)
    assert scene_text(edited.scene) == before


def test_any_edits_can_be_undone_and_redone(edited: Edited) -> None:
    """At random: going back and forth passes through the same scenes, and a new step forgets what was undone."""
    rng = np.random.default_rng(5)
    history: History[Edited] = History()
    line, at, now = [edited], 0, edited
    for _ in range(200):
        turn = rng.random()
        if turn < 0.5:
            names = list(obstacles(now))
            step = [
                lambda now, names: scene_edits.added(now, Sphere(0.01), "s")[0],
                lambda now, names: scene_edits.duplicated(now, names[0])[0] if names else now.changed(),
                lambda now, names: scene_edits.deleted(now, names[-1]) if names else now.changed(),
                lambda now, names: ends.fixed(now, "start", ends.random_free(now, "start", rng)),
            ][rng.integers(4)]
            history.step(now)
            now = step(now, names)
            line, at = [*line[: at + 1], now], at + 1
        elif turn < 0.75:
            at, now = max(at - 1, 0), history.undone(now)
        else:
            at, now = min(at + 1, len(line) - 1), history.redone(now)
        assert now is line[at]
        assert (history.can_undo, history.can_redo) == (at > 0, at < len(line) - 1)


def test_ends_are_jogged_within_limits_and_goal_poses_go_along() -> None:
    """A goal pose is met by what was jogged to, with its tolerance and its free axis."""
    rng = np.random.default_rng(2)
    scene = load_scene("pr2_shelf")
    assert isinstance(scene.goal, Goals)
    now = Edited.of(Setup.of(scene))
    robot, old = now.robot, now.target
    assert isinstance(old, PoseTarget)
    for q in robot.draw(rng, 5):
        jogged = ends.jogged(now, "goal", q)
        target = jogged.target
        assert isinstance(target, PoseTarget)
        miss = miss_of(robot, target, q)
        assert miss.position < 1e-9
        assert miss.angle < 1e-7
        assert dataclasses.replace(target, pose=old.pose) == old
        np.testing.assert_array_equal(jogged.goal, q)
        assert jogged.missed is None
    np.testing.assert_array_equal(ends.jogged(now, "start", q).start, q)
    beyond = np.where(np.isfinite(robot.upper), robot.upper + 0.1, 0.0)
    with pytest.raises(InputError, match="outside its limits"):
        ends.jogged(now, "goal", beyond)


def test_random_configurations_and_states_are_valid_ends(edited: Edited, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        for end in ("start", "goal"):
            q = ends.random_free(edited, end, rng)
            now = ends.fixed(edited, end, q)
            assert now.contacts[end == "goal"] == ()
    assert set(ends.states(edited.robot)) == {"right", "folded"}
    full = scene_edits.added(edited, Sphere(50.0), "everywhere")[0]
    monkeypatch.setattr(ends, "TRIED_CONFIGURATIONS", 100)
    with pytest.raises(InputError, match="none of 100"):
        ends.random_free(full, "goal", rng)


@pytest.mark.parametrize("name", ["ur5_table", "pr2_shelf"])
def test_other_postures_reach_the_same(name: str) -> None:
    now = Edited.of(Setup.of(load_scene(name)))
    found = ends.postures(now, "goal")
    assert len(found) > 1
    np.testing.assert_array_equal(found[0], now.goal)
    for i, q in enumerate(found):
        assert ends.is_free(now, "goal", q)
        assert all(np.abs(q - other).max() > 0.5 for other in found[:i])
        if isinstance(now.scene.goal, Goals):
            assert now.shown_at(q).missed is None
