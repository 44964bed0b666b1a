"""Several things at once: what is selected together is moved, hidden, duplicated, grouped and deleted together, each in
one step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hdplan
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view import groups, scene_edits
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.things import START, Thing
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.yaml_format.writer import scene_text
from tests.planner.view.events import Opener, by_worker, names, tell


@pytest.fixture
def furnished(scene: Scene) -> Scene:
    """With a shelf of two boards, one of which turns as it stands, and a belt that moves."""
    board = hdplan.Box([0.2, 0.3, 0.02], name="shelf/low", pose=[1.5, 1.0, 0.3])
    other = hdplan.Box([0.2, 0.3, 0.02], name="shelf/high", pose=Pose((1.5, 1.0, 0.6), (0.0, 0.0, 0.6, 0.8)))
    ball = hdplan.Sphere(0.1, name="far", pose=[-1.5, -1.0, 0.2])
    return derived(scene, obstacles=(*scene.obstacles, board, ball, other))


@pytest.fixture
def viewer(opened: Opener, furnished: Scene, trajectory: Trajectory) -> Viewer:
    return opened(furnished, planned=trajectory)


def place(edited: Edited, name: str) -> np.ndarray:
    return edited.obstacle(name).pose.matrix


def test_obstacles_selected_together_keep_their_relative_places_in_a_drag(viewer: Viewer) -> None:
    """Through any poses, in one step; what is not selected stays."""
    rng = np.random.default_rng(3)
    every = ("shelf/low", "far", "shelf/high")
    tell(viewer, do="select group", name="shelf")
    tell(viewer, do="select thing", kind="obstacle", name="far", more=True)
    handles = viewer.panel.handles
    assert set(handles.obstacles) == set(every)
    assert handles.selected == Thing("obstacle", "far")  # the last one has the handle
    before = viewer.edited
    for _ in range(5):
        turn = rng.normal(size=4)
        pose = Pose(tuple(rng.normal(size=3).tolist()), tuple((turn / np.linalg.norm(turn)).tolist()))
        by_worker(viewer, lambda pose=pose: handles.drag(pose))
        way = place(viewer.edited, "far") @ np.linalg.inv(place(before, "far"))
        for name in every:
            np.testing.assert_allclose(place(viewer.edited, name), way @ place(before, name), atol=1e-9)
        np.testing.assert_array_equal(place(viewer.edited, "ball"), place(before, "ball"))
    by_worker(viewer, handles.let_go)
    undone_at_once(viewer, before)


def undone_at_once(viewer: Viewer, before: Edited) -> None:
    """One undo leads back."""
    by_worker(viewer, lambda: viewer.panel.editing.ask("undo"))
    assert viewer.edited is before


def test_several_are_duplicated_beside_each_other_and_deleted_in_one_step(viewer: Viewer) -> None:
    before, first = viewer.edited, set(names(viewer))
    tell(viewer, do="select group", name="shelf")
    by_worker(viewer, lambda: viewer.panel.obstacles.ask("duplicate"))
    added = set(names(viewer)) - first
    assert added == {"shelf/low2", "shelf/high2"}
    assert set(viewer.panel.handles.obstacles) == added
    ways = [place(viewer.edited, f"{name}2") - place(viewer.edited, name) for name in ("shelf/low", "shelf/high")]
    np.testing.assert_allclose(ways[0], ways[1], atol=1e-12)
    assert ways[0][1, 3] >= 0.3
    undone_at_once(viewer, before)
    tell(viewer, do="delete group", name="shelf")
    assert set(names(viewer)) == first - {"shelf/low", "shelf/high"}
    assert viewer.panel.handles.selected is None
    undone_at_once(viewer, before)


def test_a_group_is_hidden_and_locked_as_one(viewer: Viewer) -> None:
    tell(viewer, do="eye group", name="shelf")
    seen = {node.obstacle.name: node.frame.visible for node in viewer.stage.obstacles}
    assert [name for name, visible in seen.items() if not visible] == ["shelf/low", "shelf/high"]
    tell(viewer, do="lock group", name="shelf")
    tell(viewer, do="delete group", name="shelf")
    assert "is locked" in viewer.panel.editing.text.content
    assert {"shelf/low", "shelf/high"} <= set(names(viewer))
    tell(viewer, do="fold group", name="shelf")
    assert "<b>shelf</b> (2)" in viewer.panel.tree.html.content
    assert "&emsp;" not in viewer.panel.tree.html.content


def test_hidden_obstacles_stay_hidden_under_a_new_name(viewer: Viewer) -> None:
    """Of a group that is renamed, or left, and back by undo; what others are called then is shown."""

    def hidden() -> list[str]:
        return [node.obstacle.name for node in viewer.stage.obstacles if not node.frame.visible]

    tell(viewer, do="eye group", name="shelf")
    tell(viewer, do="rename group", name="shelf", answer="rack")
    assert hidden() == ["rack/low", "rack/high"]
    tell(viewer, do="rename group", name="rack", answer="")
    assert hidden() == ["low", "high"]
    swapped = {"low": "ball", "ball": "low"}
    after = tuple(replace(each, name=swapped.get(each.name, each.name)) for each in viewer.scene.obstacles)
    by_worker(viewer, lambda: viewer.document.change(viewer.edited.changed(obstacles=after)))
    assert sorted(hidden()) == ["ball", "high"]
    for _ in range(3):
        by_worker(viewer, viewer.document.undo)
    assert hidden() == ["shelf/low", "shelf/high"]
    tell(viewer, do="eye group", name="shelf")
    assert hidden() == []


def test_groups_are_saved_with_the_scene(viewer: Viewer) -> None:
    for name in ("ball", "prism"):
        tell(viewer, do="select thing", kind="obstacle", name=name, more=True)
    before = viewer.edited
    by_worker(viewer, lambda: viewer.panel.obstacles.ask("group"))
    assert groups.members(viewer.edited, "group") == ("group/ball", "group/prism")
    assert set(viewer.panel.handles.obstacles) == {"group/ball", "group/prism"}
    tell(viewer, do="rename group", name="group", answer="fruit")
    assert groups.members(viewer.edited, "fruit") == ("fruit/ball", "fruit/prism")
    assert "fruit/ball" in scene_text(viewer.scene)
    by_worker(viewer, lambda: viewer.panel.editing.ask("undo"))
    undone_at_once(viewer, before)


def test_no_more_is_selected_than_there_is(viewer: Viewer) -> None:
    """Whatever is deleted elsewhere; start and goal are selected alone."""
    tell(viewer, do="select group", name="shelf")
    by_worker(viewer, lambda: viewer.document.change(scene_edits.deleted(viewer.edited, "shelf/high")))
    assert viewer.panel.handles.obstacles == ("shelf/low",)
    tell(viewer, do="select thing", kind="start", name="", more=True)
    assert viewer.panel.handles.selected == START
    assert not viewer.panel.handles.obstacles
    tell(viewer, do="select thing", kind="obstacle", name="ball", more=True)
    assert viewer.panel.handles.obstacles == ("ball",)
    tell(viewer, do="select thing", kind="obstacle", name="ball", more=True)  # a second time: no more
    assert viewer.panel.handles.selected is None


def test_ungrouped_names_that_are_taken_get_numbers(furnished: Scene) -> None:
    edited = Edited.of(Setup.of(furnished))
    edited, _ = groups.grouped(edited, ["far"], "shelf")
    edited, _ = groups.grouped(edited, ["ball"], "")
    edited = scene_edits.renamed(edited, "shelf/low", "shelf/ball")
    edited, found = groups.grouped(edited, groups.members(edited, "shelf"), " / ")
    assert set(found) == {"ball2", "far", "high"}
