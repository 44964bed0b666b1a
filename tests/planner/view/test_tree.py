"""Laws of the list of what is in the scene: what is hidden still counts, what is locked stays, what is copied is pasted
as it was; of turns in numbers, of snapping, and of the layers that mark things."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view import scene_edits
from hdplan.planner.view.gate import MOST_MESSAGE
from hdplan.planner.view.layers import FRAMES, NAMES, TRAIL
from hdplan.planner.view.marks import POSTURES
from hdplan.planner.view.page_script import LONGEST_TEXT
from hdplan.planner.view.things import START, Thing
from hdplan.planner.view.uploads import Uploads
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.errors import InputError
from hdplan.scenes.poses import Pose
from hdplan.scenes.yaml_format.reader import load_scene, read_obstacles, shipped_scenes
from hdplan.scenes.yaml_format.writer import obstacle_text
from tests.planner.view.events import BALL, active_of, by_worker, tell
from tests.planner.view.in_browser import Tabs, calm
from tests.waiting import until


def ball_of(viewer: Viewer) -> Any:
    return viewer.edited.obstacle(BALL.name)


def test_hidden_obstacles_still_count(viewer: Viewer) -> None:
    """A hidden obstacle is not drawn, its line says so, and a motion through it fails as before."""
    tell(viewer, do="eye thing", kind="obstacle", name="ball")
    node = next(each for each in viewer.stage.obstacles if each.obstacle.name == "ball")
    assert not node.frame.visible
    assert "hidden, still avoided" in viewer.panel.tree.html.content
    active = active_of(viewer)
    at = active.motion.tip[len(active.motion.tip) // 2]
    middle = tuple(at.tolist())
    by_worker(viewer, lambda: viewer.panel.editing.apply("x", lambda e: scene_edits.placed(e, "ball", middle)))
    by_worker(viewer, viewer.document.measure)
    assert not active.motion.certificate.certified
    assert active.motion.certificate.text == certify(viewer.scene, active.motion.trajectory).text
    assert not next(each for each in viewer.stage.obstacles if each.obstacle.name == "ball").frame.visible
    tell(viewer, do="eye thing", kind="obstacle", name="ball")
    assert node.frame.visible


def test_locked_obstacles_stay(viewer: Viewer) -> None:
    """A locked obstacle is neither dragged, edited, deleted nor renamed; everything else is."""
    first = ball_of(viewer)
    tell(viewer, do="select thing", kind="obstacle", name="ball")
    assert viewer.panel.handles.selected == BALL
    tell(viewer, do="lock thing", kind="obstacle", name="ball")
    editing = viewer.panel.editing
    for edit in (
        lambda e: scene_edits.placed(e, "ball", (0.0, 2.0, 0.0)),
        lambda e: scene_edits.resized(e, "ball", radius=0.01),
        lambda e: scene_edits.renamed(e, "ball", "bowl"),
        lambda e: scene_edits.deleted(e, "ball"),
    ):
        by_worker(viewer, lambda edit=edit: editing.guarded(lambda: editing.apply("x", edit)))
        assert "is locked" in editing.text.content
    by_worker(viewer, lambda: viewer.panel.handles.drag(Pose((0.0, 2.0, 0.0))))
    tell(viewer, do="delete thing", kind="obstacle", name="ball")
    assert ball_of(viewer) is first
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    assert len(viewer.scene.obstacles) == 3
    tell(viewer, do="lock thing", kind="obstacle", name="ball")
    tell(viewer, do="eye thing", kind="obstacle", name="ball")
    tell(viewer, do="delete thing", kind="obstacle", name="ball")
    assert "ball" not in [each.name for each in viewer.scene.obstacles]
    assert not viewer.panel.tree.hidden  # a new one may get its name


def test_pages_may_tell_anything(viewer: Viewer) -> None:
    before = viewer.edited
    for kind, name in (("start", ""), ("obstacle", "none"), (["x"], {"y": 1}), ("goal", "ball")):
        for what in ("delete", "lock", "eye", "select"):
            tell(viewer, do=f"{what} thing", kind=kind, name=name)
    tell(viewer, do="paste", text="hdplan: 1")
    assert "not done: " in viewer.panel.editing.text.content
    assert viewer.edited is before
    assert not viewer.document.locked
    tell(viewer, do="select thing", kind="start", name="")
    assert viewer.panel.handles.selected == START


@pytest.mark.parametrize("name", ["planar_arm", "panda_gate", "panda_vase", "panda_person", "ur5_pallet"])
def test_copied_obstacles_are_pasted_unchanged(name: str) -> None:
    uploads = Uploads()
    obstacles = load_scene(name).obstacles
    text = "\n".join(map(obstacle_text, obstacles))
    assert read_obstacles(uploads.take("pasted.yaml", f"obstacles:\n{text}\n".encode(), (".yaml",))) == obstacles
    uploads.close()
    assert len(shipped_scenes()) > 20


def test_a_paste_is_a_step_and_takes_other_names(viewer: Viewer) -> None:
    first = viewer.edited
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    text = viewer.panel.obstacles.text
    assert "ball" in viewer.panel.page._copied.content
    by_worker(viewer, lambda: viewer.panel.handles.drag(Pose((0.0, 2.125, 0.0))))
    by_worker(viewer, viewer.panel.handles.let_go)
    assert "2.125" in viewer.panel.page._copied.content
    by_worker(viewer, viewer.document.undo)
    tell(viewer, do="paste", text=f"# of a scene\nobstacles:\n  {text}")
    tell(viewer, do="paste", text="name: far\nshape: {type: box, size: [0.1, 0.1, 0.1]}\npose: {position: [0, -3, 0]}")
    names = [each.name for each in viewer.scene.obstacles]
    assert names == ["ball", "prism", "ball2", "far"]
    assert viewer.panel.handles.selected == Thing("obstacle", "far")
    assert 6 * LONGEST_TEXT < MOST_MESSAGE  # or the gate would end the connection without a message
    negative = "- {name: a, shape: {type: box, size: [1, 1, -1]}}"
    for wrong in ("", "- 1", negative, "- {name: x", "- !!python/object:os {}", "x" * (LONGEST_TEXT + 1)):
        tell(viewer, do="paste", text=wrong)
        assert "not done: " in viewer.panel.editing.text.content, wrong[:40]
        assert "hdplan-view-" not in viewer.panel.editing.text.content
        assert [each.name for each in viewer.scene.obstacles] == names
    for _ in range(2):
        by_worker(viewer, lambda: viewer.panel.editing.ask("undo"))
    assert viewer.edited is first


def test_turns_are_numbers_and_snap(viewer: Viewer) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        degrees = tuple(rng.uniform([-179, -89, -179], [179, 89, 179]).tolist())
        edited = scene_edits.turned(viewer.edited, "prism", degrees)
        pose = edited.obstacle("prism").pose
        np.testing.assert_allclose(scene_edits.turn_of(pose), degrees, atol=1e-6)
        x, y, z = np.radians(degrees)
        about = Rotation.from_rotvec
        expected = about([0, 0, z]) * about([0, y, 0]) * about([x, 0, 0])  # URDF's order
        np.testing.assert_allclose(pose.matrix[:3, :3], expected.as_matrix(), atol=1e-12)
        moved = scene_edits.placed(edited, "prism", tuple(rng.normal(size=3).tolist()))
        snapped = scene_edits.snapped(moved, "prism").obstacle("prism").pose
        np.testing.assert_allclose(snapped.position, np.round(snapped.position, 2), atol=1e-12)
        turn = np.array(scene_edits.turn_of(snapped)) / scene_edits.SNAP_TURN
        np.testing.assert_allclose(turn, turn.round(), atol=1e-6)
    twice = scene_edits.oriented(viewer.edited, "prism", [0.0, 0.0, 3.0, 3.0])
    assert scene_edits.turn_of(twice.obstacle("prism").pose) == pytest.approx((0.0, 0.0, 90.0))
    for wrong in ([0.0] * 4, [1.0] * 3, [np.nan, 0, 0, 1], [np.inf, 0, 0, 1]):
        with pytest.raises(InputError, match=r"^obstacle prism: quaternion"):
            scene_edits.oriented(viewer.edited, "prism", wrong)


def test_marks_are_the_motions_and_the_obstacles_own(viewer: Viewer, trajectory: Trajectory) -> None:
    layers = viewer.panel.layers
    for name in (TRAIL, FRAMES, NAMES):
        layers.set(name, True)
    viewer.show(0.5)
    assert layers.trail.nodes
    assert all(len(node.batched_positions) == POSTURES for node in layers.trail.nodes)
    before = layers.frames.node.batched_positions.copy()
    viewer.show(0.9)
    assert np.abs(layers.frames.node.batched_positions - before).max() > 0.01
    assert {label.text for label, _ in layers.names.labels.values()} == {"ball", "prism"}
    old = layers.trail.nodes
    by_worker(viewer, lambda: viewer.document.put("half", trajectory.between(0, 9)))
    viewer.show(0.1)
    assert layers.trail.nodes is not old
    by_worker(viewer, lambda: viewer.panel.editing.apply("x", lambda e: scene_edits.renamed(e, "ball", "<b>bowl</b>")))
    by_worker(viewer, lambda: viewer.panel.editing.apply("y", lambda e: scene_edits.deleted(e, "prism")))
    viewer.show(0.2)
    assert {label.text for label, _ in layers.names.labels.values()} == {"<b>bowl</b>"}
    for name in (TRAIL, FRAMES, NAMES):
        layers.set(name, False)
    viewer.show(0.3)
    assert (layers.trail.nodes, layers.frames.node, layers.names.labels) == ([], None, {})
    assert "tip [m]" in viewer.panel._table.content


@pytest.mark.slow
def test_the_keyboard_copies_pastes_duplicates_and_deletes(tab: Tabs, served: Viewer) -> None:
    page = tab(served.address())

    def names() -> list[str]:
        return [each.name for each in served.scene.obstacles]

    page.get_by_role("tab", name="Scene").click()
    page.locator('[data-do*="select thing"]').filter(has_text="the goal").focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    until(lambda: served.panel.handles.selected == BALL, "it is not selected")
    page.locator('.hdplan-copied[data-yaml*="ball"]').wait_for(state="attached")
    page.locator('.hd-chosen[data-do*="ball"]:focus').wait_for()  # in the list that is rewritten
    assert page.get_by_role("status").inner_text() == page.locator(".hd-badge").inner_text()
    page.get_by_role("button", name="reset").focus()
    page.keyboard.press("Space")
    until(lambda: "nothing to reset" in served.panel.editing.text.content, "the space bar does not press a button")
    assert not served.panel.player.playing
    page.mouse.click(20, 330)
    by_worker(served, lambda: served.panel.handles.select(BALL))
    page.locator('.hdplan-copied[data-yaml*="ball"]').wait_for(state="attached")
    page.keyboard.press("Control+c")
    page.keyboard.press("Control+v")
    until(lambda: names() == ["ball", "prism", "ball2"], "it is not pasted")
    calm(served)
    page.keyboard.press("Control+d")
    until(lambda: names() == ["ball", "prism", "ball2", "ball3"], "it is not duplicated")
    page.keyboard.press("Delete")
    until(lambda: names() == ["ball", "prism", "ball2"], "it is not deleted")
    assert dataclasses.replace(served.scene.obstacles[2], name="ball", pose=ball_of(served).pose) == ball_of(served)
