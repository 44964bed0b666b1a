"""The panel by mouse and keyboard in a real browser, as somebody edits a scene: each press reaches the scene, or is
refused in a line, and nothing complains."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan as plan_scene
from hdplan.planner.view import live
from hdplan.planner.view.drawing.colors import CONTACT, intensities
from hdplan.planner.view.layers import LAYERS
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.things import GOAL, place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from tests.planner.view.events import BALL, active_of, by_worker, names
from tests.planner.view.in_browser import (
    Tabs,
    arrow_dragged,
    calm,
    let_go,
    plainly,
    press,
    selected,
    slow_line,
    tab_of,
    typed,
)
from tests.planner.view.in_page import EYE, TARGET, look
from tests.waiting import until

pytestmark = pytest.mark.slow
HOOK = shipped_scenes()["panda_vase"].parent / "hook.obj"
Served = Callable[..., tuple[Any, Viewer]]


@pytest.fixture
def served(tab: Tabs) -> Iterator[Served]:
    """Serves scenes, opens a page of each, and looks at it."""
    viewers: list[Viewer] = []

    def served(scene: Scene, *motions: tuple[str, Trajectory], eye: Any = EYE, target: Any = TARGET) -> Any:
        viewer = plainly(scene, *motions)
        viewers.append(viewer)
        page = tab(viewer.address())
        look(page, viewer, eye, target)
        return page, viewer

    yield served
    for viewer in viewers:
        viewer.close()


def certified_at(viewer: Viewer, goal: np.ndarray) -> bool:
    """True if the active motion is certified and ends at a goal (n,)."""
    active = viewer.motions.active
    return active is not None and active.motion.certificate.certified and np.array_equal(active.motion.joints[-1], goal)


def test_the_joints_are_jogged_and_go_to_states_and_back(served: Served, scene: Scene, trajectory: Trajectory) -> None:
    page, viewer = served(scene, (NAME, trajectory))
    first = viewer.edited
    tab_of(page, "Joints")
    thumb = page.locator("[role=slider]:visible").nth(1)
    thumb.scroll_into_view_if_needed()
    box = thumb.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 14, box["y"] + box["height"] / 2, steps=5)
    until(lambda: viewer.edited.goal[0] > first.goal[0] + 0.05, "the goal stays where it was")
    page.mouse.up()
    until(lambda: certified_at(viewer, viewer.edited.goal), "no motion follows")
    assert viewer.edited.goal[1] == first.goal[1]
    while (edited := viewer.edited) is not first:  # more than one step, where the mouse rested
        press(page, "undo")
        until(lambda edited=edited: viewer.edited is not edited, "it is not undone")
        calm(viewer)
    press(page, "random")
    until(lambda: viewer.edited.goal.tolist() != first.goal.tolist(), "the goal stays where it was")
    assert not viewer.edited.contacts[1]
    press(page, "right")
    until(lambda: bool(np.allclose(viewer.edited.goal, viewer.edited.start)), "the goal is not where the state is")
    press(page, "reset")
    until(lambda: viewer.edited is first, "it is not reset")


def test_obstacles_are_added_named_resized_and_deleted(served: Served, scene: Scene, trajectory: Trajectory) -> None:
    page, viewer = served(scene, (NAME, trajectory))
    first = names(viewer)
    tab_of(page, "Scene")
    press(page, "box")
    until(lambda: names(viewer) == [*first, "box"], "no box is added")
    calm(viewer)
    typed(page, viewer, "name", "crate")
    until(lambda: names(viewer) == [*first, "crate"], "it keeps its name")
    press(page, "capsule")
    until(lambda: names(viewer)[-1] == "capsule", "no capsule is added")
    calm(viewer)
    typed(page, viewer, "length [m]", "0.31")
    until(lambda: getattr(viewer.scene.obstacles[-1].shape, "length", 0.0) == 0.31, "it keeps its length")
    typed(page, viewer, "clearance [m]", "0.005")
    until(lambda: viewer.scene.obstacles[-1].clearance == 0.005, "it keeps its clearance")
    typed(page, viewer, "clearance [m]", "a lot")
    page.get_by_text("not done: ").wait_for()
    page.get_by_text("must be a number, or empty, found 'a lot'").wait_for()
    assert viewer.scene.obstacles[-1].clearance == 0.005
    typed(page, viewer, "name", "ball")
    page.get_by_text("not done: ").filter(has_text="ball").wait_for()
    assert names(viewer) == [*first, "crate", "capsule"]
    press(page, "duplicate")
    until(lambda: names(viewer) == [*first, "crate", "capsule", "capsule2"], "it is not duplicated")
    press(page, "delete")
    until(lambda: names(viewer) == [*first, "crate", "capsule"], "it is not deleted")
    tab_of(page, "Plan")
    typed(page, viewer, "waypoints", "17")
    until(lambda: viewer.scene.planner.waypoints == 17, "the setting does not reach the server")
    press(page, "reset")
    until(lambda: names(viewer) == first, "it is not reset")


def test_files_are_sent_whole_or_refused_and_saved(
    served: Served, scene: Scene, trajectory: Trajectory, tmp_path: Path
) -> None:
    page, viewer = served(scene, (NAME, trajectory))
    first = names(viewer)
    tab_of(page, "Scene")
    mesh, other = page.locator("input[type=file]").all()
    half = tmp_path / "half.obj"
    text = HOOK.read_bytes()
    half.write_bytes(text[: len(text) // 3])
    mesh.set_input_files(half)
    page.get_by_text("not done: obstacles.half: mesh half.obj: line 28").wait_for()
    assert names(viewer) == first
    mesh.set_input_files(HOOK)
    until(lambda: names(viewer) == [*first, "hook"], "no mesh is added")
    calm(viewer)
    for button, files in (("Save scene", ["planar_arm.yaml", "hook.obj"]), ("Save motion", ["motion.json"])):
        with contextlib.ExitStack() as waiting:
            downloads = [
                waiting.enter_context(page.expect_download(lambda found, name=name: found.suggested_filename == name))
                for name in files
            ]
            press(page, button)
        for name, download in zip(files, downloads, strict=True):
            download.value.save_as(tmp_path / name)
    saved = load_scene(tmp_path / "planar_arm.yaml")
    assert [each.name for each in saved.obstacles] == [*first, "hook"]
    motion = Trajectory.load(tmp_path / "motion.json")
    assert certify(saved, motion).text == viewer.certifier.certify(active_of(viewer).motion.trajectory).text
    press(page, "reset")
    until(lambda: names(viewer) == first, "it is not reset")
    other.set_input_files(tmp_path / "planar_arm.yaml")
    page.get_by_text("opened: the scene planar_arm").wait_for()
    assert names(viewer) == [*first, "hook"]
    cut = tmp_path / "cut.json"
    cut.write_bytes((tmp_path / "motion.json").read_bytes()[:200])
    other.set_input_files(cut)
    page.get_by_text("not done: cut.json: ").wait_for()
    (tmp_path / "again.json").write_bytes((tmp_path / "motion.json").read_bytes())
    other.set_input_files(tmp_path / "again.json")
    page.get_by_text("opened: again.json").wait_for()
    assert active_of(viewer).motion.name == "again"


def test_the_keys_do_what_the_list_says(served: Served, scene: Scene, trajectory: Trajectory) -> None:
    page, viewer = served(scene, (NAME, trajectory))
    player = viewer.panel.player
    page.mouse.click(20, 330)
    page.keyboard.press("End")
    until(lambda: player.time == 1.0, "end")
    page.keyboard.press("ArrowLeft")
    until(lambda: abs(player.time - 0.98) < 1e-9, "left")
    page.keyboard.press("Home")
    until(lambda: player.time == 0.0, "home")
    page.keyboard.press("ArrowRight")
    until(lambda: abs(player.time - 0.02) < 1e-9, "right")
    page.keyboard.press("Space")
    until(lambda: player.time > 0.1, "space")
    page.keyboard.press("Space")
    until(lambda: not player.playing, "space again")
    shown = viewer.motions.shown[0]
    page.keyboard.press("1")
    until(lambda: not viewer.panel.layers.on(next(iter(LAYERS))), "1")
    page.keyboard.press("1")
    by_worker(viewer, lambda: viewer.panel.obstacles.add("sphere"))
    page.keyboard.press("f")
    page.keyboard.press("z")
    until(lambda: viewer.scene is scene or "sphere" not in names(viewer), "Z")
    page.keyboard.press("Shift+Z")
    until(lambda: "sphere" in names(viewer), "shift Z")
    page.keyboard.press("p")
    until(lambda: viewer.motions.active is not None and active_of(viewer).result is not None, "P")
    assert shown in viewer.motions.shown or len(viewer.motions.shown) == 1
    page.keyboard.press("Shift+?")
    page.get_by_text("List the keys").wait_for()
    page.keyboard.press("Shift+?")
    page.get_by_text("List the keys").wait_for(state="hidden")


def test_a_motion_that_no_longer_holds_is_red_until_another_is_found(
    served: Served, scene: Scene, trajectory: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Plans take as long as the mouse is pressed: until then pair and depth are shown, and nothing is certified."""
    page, viewer = served(scene, (NAME, trajectory))
    planned, released = plan_scene, threading.Event()

    def slowly(*given: Any, **named: Any) -> Any:
        released.wait()
        return planned(*given, **named)

    monkeypatch.setattr(live, "plan", slowly)
    active = active_of(viewer)
    before = active.motion.scene
    place = selected(page, viewer, BALL)
    tips = active.motion.tip
    way = tips[np.linalg.norm(tips - place[:3, 3], axis=1).argmin()] - place[:3, 3]
    axis = np.eye(3)[np.abs(way).argmax()]
    arrow_dragged(page, viewer, place, (way @ axis) * axis)
    page.get_by_text("in contact in this scene: ").filter(has_text="ball").wait_for()
    assert page.get_by_text("certified: at least").count() == 0
    assert page.get_by_text("of an older scene").count()
    assert active.motion.scene is not before
    drawn = np.unique(viewer.motion_nodes.of(active).path.node.colors.reshape(-1, 3), axis=0)
    np.testing.assert_array_equal(drawn, [intensities(np.uint8(CONTACT))])
    released.set()
    page.get_by_text("certified: at least").first.wait_for()
    calm(viewer)
    let_go(page, viewer)


def test_a_goal_pose_keeps_its_tolerance_and_has_other_postures(served: Served) -> None:
    scene = load_scene("panda_grasp")
    page, viewer = served(scene, eye=(1.6, -1.4, 1.2), target=(0.3, 0.0, 0.4))
    place = selected(page, viewer, GOAL)
    arrow_dragged(page, viewer, place, 0.06 * place[:3, 2], steps=5)
    until(lambda: viewer.edited.target != scene.goal.targets[0], "the goal stays where it was")
    let_go(page, viewer)
    calm(viewer)
    tab_of(page, "Joints")
    before = viewer.edited
    assert dataclasses.replace(before.target, pose=scene.goal.targets[0].pose) == scene.goal.targets[0]
    press(page, "another")
    until(lambda: bool(np.abs(viewer.edited.goal - before.goal).max() > 0.1), "there is no other posture")
    assert viewer.edited.target == before.target


def test_a_tab_is_closed_while_plan_runs(served: Served, tab: Tabs, scene: Scene) -> None:
    page, viewer = served(scene)
    press(page, "Plan")
    page.close()
    until(lambda: bool(viewer.motions.shown), "it plans no more")
    tab(viewer.address()).get_by_text("certified: at least").first.wait_for()


def test_many_obstacles_on_a_slow_line(tab: Tabs, scene: Scene, trajectory: Trajectory) -> None:
    """All are there, one of them is dragged, and what the page says in the end is true."""
    rng = np.random.default_rng(0)
    places = rng.uniform([-2.0, 1.6, 0.0], [2.0, 3.0, 0.4], (200, 3)).tolist()
    more = [Obstacle(f"box {i}", Box((0.03, 0.03, 0.03)), Pose(tuple(place))) for i, place in enumerate(places)]
    viewer = plainly(dataclasses.replace(scene, obstacles=(*scene.obstacles, *more)), (NAME, trajectory))
    with contextlib.closing(viewer), slow_line(viewer.port, delay=0.3, rate=2e6) as port:
        page = tab(viewer.address().replace(f":{viewer.port}/", f":{port}/"))
        until(lambda: bool(viewer.server.get_clients()), "the page does not reach the server")
        look(page, viewer)
        place = selected(page, viewer, BALL)
        arrow_dragged(page, viewer, place, np.array([-0.15, 0.0, 0.0]))
        until(lambda: viewer.panel.live.count > 0, "no motion is planned while it is dragged")
        let_go(page, viewer)
        calm(viewer)
        motion = active_of(viewer).motion
        text = certify(viewer.scene, motion.trajectory, viewer.robot).text
        page.get_by_text(text).first.wait_for()
        moved = place_of(viewer.edited, BALL, viewer.stage.tip).position
        assert moved[0] < place[0, 3] - 0.05
        page.goto("about:blank")
