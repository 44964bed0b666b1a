"""Two hands at one scene, and what was typed wrongly, by mouse and keyboard in a real browser."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.gate import ALIVE, WATCH
from hdplan.planner.view.page_script import ENDED, WATCHING
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.viewer import Viewer
from hdplan.planner.view.watch import seen
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from tests.planner.view.events import BALL, by_worker
from tests.planner.view.in_browser import (
    Tabs,
    arrow_dragged,
    calm,
    entry,
    plainly,
    press,
    says_the_truth,
    selected,
    tab_of,
)
from tests.planner.view.in_page import heard, look
from tests.waiting import until

pytestmark = pytest.mark.slow


@pytest.fixture
def viewer(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    found = plainly(scene, (NAME, trajectory))
    yield found
    found.close()


def dragging(page: Any, viewer: Viewer) -> None:
    """Select the ball and drag it a little; the button stays down."""
    look(page, viewer)
    place = selected(page, viewer, BALL)
    arrow_dragged(page, viewer, place, np.array([-0.1, 0.0, 0.0]), steps=4)
    until(lambda: viewer.panel.handles.dragging, "it is not dragged")


def is_there(viewer: Viewer) -> bool:
    return BALL.name in [each.name for each in viewer.scene.obstacles]


@pytest.mark.parametrize("by", ["delete", "z", "file"])
def test_an_obstacle_is_removed_during_its_drag(tab: Tabs, viewer: Viewer, tmp_path: Path, by: str) -> None:
    """By another tab, by the other hand at the keyboard, or from the file; the first keeps pulling, and lets go
    late."""
    page, first = tab(viewer.address()), viewer.edited
    dragging(page, viewer)
    if by == "z":
        page.keyboard.press("z")
        until(lambda: viewer.edited is first, "it is not undone")
    elif by == "file":
        file, shipped = tmp_path / "scene.yaml", shipped_scenes()["planar_arm"]
        text = shipped.read_text().replace(" planar_arm.", f" {shipped.parent}/planar_arm.")
        file.write_text(text)
        with contextlib.closing(viewer.panel.opening.follow(lambda: load_scene(file), seen([file]), {}, {})):
            file.write_text(re.sub(r".*name: ball.*\n", "", text))
            until(lambda: not is_there(viewer), "it is not opened")
    else:
        other = tab(viewer.address())
        other.bring_to_front()
        tab_of(other, "Scene")
        press(other, "delete")
        until(lambda: not is_there(viewer), "it is not deleted")
        page.bring_to_front()
    without = viewer.edited
    for x in (280, 240, 200):
        page.mouse.move(x, 200)
        heard(page, viewer)
    page.mouse.up()
    heard(page, viewer)
    calm(viewer)
    assert viewer.edited is without
    assert not viewer.panel.handles.dragging
    assert viewer.panel.handles.selected == (BALL if by == "z" else None)
    calm(viewer)
    by_worker(viewer, viewer.document.measure)
    says_the_truth(page, viewer)


def test_a_watching_browser_cannot_press_buttons(tab: Tabs, viewer: Viewer) -> None:
    page, before = tab(viewer.address(watch=True)), viewer.edited
    assert f"/{WATCH}/" in page.url
    page.get_by_text(WATCHING).wait_for()
    page.get_by_text("certified: at least").first.wait_for()
    press(page, "Plan")
    press(page, "undo")
    page.keyboard.press("End")
    page.keyboard.press("p")
    heard(page, viewer)
    assert viewer.edited is before
    assert viewer.panel.player.time == 0.0
    assert not viewer.panel.planning.running
    assert [shown.motion.name for shown in viewer.motions.shown] == [NAME]
    tab_of(page, "Scene")  # which is the page's own affair
    page.get_by_text("Save scene").wait_for()


def test_a_server_that_has_ended_is_reported(tab: Tabs, viewer: Viewer) -> None:
    page = tab(viewer.address())
    color: Callable[[], Any] = lambda: page.evaluate("getComputedStyle(document.documentElement, '::after').content")  # noqa: E731
    for _ in range(2):  # the page has found that it is there
        with page.expect_response(lambda answer: answer.url.endswith(ALIVE)):
            pass
    assert ENDED not in color()
    viewer.close()
    until(lambda: ENDED in color(), "it looks alive")


def test_an_exponent_makes_no_other_number(tab: Tabs, viewer: Viewer) -> None:
    page = tab(viewer.address())
    tab_of(page, "Plan")
    field = entry(page, viewer, "waypoints")
    field.click()
    field.press("Control+a")
    page.keyboard.type("1e9", delay=100)
    page.get_by_text("without an exponent").wait_for()
    calm(viewer)
    assert viewer.scene.planner.waypoints != 19


def test_a_refused_value_leaves_its_field(tab: Tabs, viewer: Viewer) -> None:
    page = tab(viewer.address())
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    tab_of(page, "Scene")
    field = entry(page, viewer, "clearance [m]")
    field.fill("a lot")
    page.get_by_text("must be a number, or empty, found 'a lot'").wait_for()
    until(lambda: field.input_value() == "", "it stays")
    page.get_by_text("not done: ").wait_for()
