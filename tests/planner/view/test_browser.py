"""The viewer in a real browser, Debian's chromium without a screen: it draws, follows the slider, plans, and two tabs
see the same."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.viewer import Viewer
from hdplan.planner.view.words import OUTDATED
from hdplan.scenes.scene import Scene
from tests.planner.view.events import active_of
from tests.planner.view.in_browser import SIZE, Tabs, changed, coloured, picture, plainly, press
from tests.planner.view.in_page import drawn, grip, gripped, handled, heard, seen
from tests.waiting import until

SPENT = re.compile(r"– \d+ attempt")  # ends what Plan says


@pytest.fixture
def viewer(watched: Viewer) -> Viewer:
    return watched


def time_field(page: Any) -> Any:
    return page.locator("input[type=text]:visible").first


def set_time(page: Any, value: float) -> None:
    time_field(page).fill(str(value))
    time_field(page).press("Enter")


def test_the_page_shows_the_scene_and_the_slider_moves_the_robot(page: Any, viewer: Viewer) -> None:
    viewer.show(0.0)
    page.get_by_text("certified: at least").first.wait_for()
    until(lambda: coloured(picture(page)) > 500, "the canvas stays empty")
    before = picture(page)
    set_time(page, 0.6)
    until(lambda: viewer.panel.player.time == 0.6, "the slider does not reach the server")
    until(lambda: changed(picture(page), before) > 300, "the robot stays where it was")
    page.locator('[data-moment="0.600"]').wait_for()


def test_a_second_tab_sees_the_same(tab: Tabs, page: Any, viewer: Viewer) -> None:
    other = tab(viewer.address())
    set_time(other, 0.35)
    page.locator('[data-moment="0.350"]').wait_for()
    until(lambda: time_field(page).input_value() == "0.35", "the second slider stays where it was")
    heard(other, viewer)  # or the server would look for a page that is gone
    other.close()  # in the middle of things
    viewer.show(0.7)
    page.locator('[data-moment="0.700"]').wait_for()


def test_plan_works(page: Any, viewer: Viewer) -> None:
    page.get_by_role("tab", name="Plan").click()
    press(page, "Plan")
    page.get_by_text(SPENT).wait_for()
    assert "certified: at least" in page.get_by_text(SPENT).inner_text()
    assert active_of(viewer).motion.name == NAME
    page.get_by_role("tab", name="Scene").click()
    with page.expect_download() as download:
        press(page, "Save motion")
    found = Trajectory.load(_named(download.value, "motion.json"))
    np.testing.assert_array_equal(found.positions, active_of(viewer).motion.trajectory.positions)


@pytest.mark.slow  # without a page `test_viewer` drags it
def test_a_drag_by_the_mouse_takes_the_verdict_away(tab: Tabs, scene: Scene) -> None:
    """While the button is still pressed: nothing on the page says certified, and the file says what holds."""
    viewer = plainly(scene)
    viewer.panel.live.set(False)
    try:
        page = tab(viewer.address())
        page.get_by_role("tab", name="Plan").click()
        press(page, "Plan")
        page.get_by_text(SPENT).wait_for()
        page.get_by_role("tab", name="Scene").click()
        index = next(i for i, obstacle in enumerate(scene.obstacles) if obstacle.name == "ball")
        begin = np.array(scene.obstacles[index].pose.position)
        path = active_of(viewer).motion.tip
        way = path[np.linalg.norm(path - begin, axis=1).argmin()] - begin
        axis = np.eye(3)[np.abs(way).argmax()] * np.sign(way[np.abs(way).argmax()])
        viewer.worker.settle(20)
        viewer.panel.handles.choice.value = "obstacle ball"
        viewer.worker.settle(20)
        handled(page, viewer)
        place = np.block([[np.eye(3), begin[:, None]], [np.zeros(3), 1.0]])
        held = grip(page, place, int(np.abs(axis).argmax()))
        gripped(page, seen(page, held))
        for share in np.linspace(0.1, 1.0, 10):
            page.mouse.move(*seen(page, held + share * (np.linalg.norm(way) + 0.05) * axis))
            drawn(page)
        until(
            lambda: np.linalg.norm(viewer.scene.obstacles[index].pose.position - begin) > np.linalg.norm(way),
            "the ball does not come all the way",
        )
        page.get_by_text(OUTDATED).first.wait_for()
        assert page.get_by_text("certified: at least").count() == 0
        with page.expect_download() as download:
            press(page, "Save motion")
        verdict = json.loads(Path(download.value.path()).read_text(encoding="utf-8"))["verdict"]
        viewer.worker.settle(20)
        certificate = viewer.certifier.certify(active_of(viewer).motion.trajectory)
        assert not certificate.certified
        assert verdict["text"] == certificate.text
        page.mouse.up()
        page.get_by_text("in contact in this scene").first.wait_for()
    finally:
        viewer.close()


def _named(download: Any, name: str) -> Path:
    path = Path(download.path())
    return path.rename(path.with_name(name))


def test_the_page_has_the_scenes_name_and_is_dark_where_the_browser_is(page: Any, scene: Scene) -> None:
    until(lambda: page.title() == scene.name, "the page keeps viser's title")
    page.emulate_media(color_scheme="dark")
    page.locator('[data-mantine-color-scheme="dark"]').wait_for(state="attached")
    page.emulate_media(color_scheme="light")
    page.locator('[data-mantine-color-scheme="light"]').wait_for(state="attached")


def test_a_click_in_a_plot_and_on_a_line_does_what_it_says(page: Any, viewer: Viewer) -> None:
    page.get_by_role("tab", name="Plots").click()
    plot = page.locator(".u-over").first
    plot.wait_for()
    box = plot.bounding_box()
    for share in (0.25, 0.75):
        plot.click(position={"x": share * box["width"], "y": 5}, force=True)
        until(lambda share=share: abs(viewer.panel.player.time - share) < 0.02, "the plot does not seek")
    shown = viewer.motions.shown[-1]
    line = page.locator("summary").last
    line.locator('[title="hide or show"]').dispatch_event("click")
    until(lambda: not shown.visible, "the motion stays in sight")
    line.locator('[title="hide or show"]').dispatch_event("click")
    until(lambda: shown.visible, "the motion stays hidden")
    page.once("dialog", lambda dialog: dialog.accept("seen"))
    line.locator('[title="rename"]').dispatch_event("click")
    until(lambda: shown.motion.name == "seen", "the motion keeps its name")
    page.get_by_text("seen").first.wait_for()


def test_plan_and_play_stay_in_sight_when_the_panel_is_scrolled(page: Any) -> None:
    page.get_by_role("tab", name="Plots").click()
    page.locator(".u-over").last.scroll_into_view_if_needed()
    scrolled = "[...document.querySelectorAll('.mantine-ScrollArea-viewport')].some((each) => each.scrollTop > 50)"
    until(lambda: bool(page.evaluate(scrolled)), "nothing is scrolled")
    for name in ("Plan", "Play"):
        box = page.get_by_role("button", name=name, exact=True).bounding_box()
        assert 0 <= box["y"] <= 0.4 * SIZE["height"]
