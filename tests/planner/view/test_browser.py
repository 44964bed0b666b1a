"""The viewer in a real browser, Debian's chromium without a screen: it draws, follows the slider, plans, and two tabs
see the same; by mouse and by finger, a drag takes a certified motion along."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.page_script import LOW, SHEET, WIDTH
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.things import GOAL, START, Thing, place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.planner.view.words import OUTDATED
from hdplan.scenes.scene import Scene
from tests.planner.view.events import BALL, active_of
from tests.planner.view.in_browser import (
    SIZE,
    Tabs,
    arrow_dragged,
    calm,
    changed,
    coloured,
    let_go,
    picture,
    plainly,
    press,
    says_the_truth,
    selected,
)
from tests.planner.view.in_page import HOLDS, drawn, grip, gripped, handled, heard, look, seen, wait_for
from tests.waiting import until

SPENT = re.compile(r"– \d+ attempt")  # ends what Plan says


@pytest.fixture(scope="module")
def viewer(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    found = plainly(scene, ("found", trajectory))
    yield found
    found.close()


@pytest.fixture(scope="module")
def kept(browser: Any, viewer: Viewer) -> Iterator[Tabs]:
    """The page that tests share: the first pictures of each cost the processor seconds."""
    tabs = Tabs(browser)
    tabs(viewer.address())
    yield tabs
    tabs.close()


@pytest.fixture
def page(kept: Tabs, viewer: Viewer) -> Iterator[Any]:
    """The page, with the scene as it was at first."""
    kept.pages[0].bring_to_front()  # a page behind another one's tab draws no pictures, and waits for them for ever
    viewer.panel.editing.ask("reset")
    calm(viewer)
    yield kept.pages[0]
    assert not kept.complaints


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


# --- dragging by the mouse: a certified motion goes along -------------------------------------------------------------


def in_sight(page: Any, viewer: Viewer) -> Any:
    """The page, with the whole scene in the picture."""
    page.get_by_text("certified: at least").first.wait_for()
    look(page, viewer)
    return page


def test_the_certified_motion_follows_the_mouse(page: Any, viewer: Viewer) -> None:
    """While the button is still down: what the panel calls certified is so, in the scene as it is then."""
    place = selected(in_sight(page, viewer), viewer, BALL)
    first = active_of(viewer).motion.trajectory
    tips = active_of(viewer).motion.tip
    way = tips[np.linalg.norm(tips - place[:3, 3], axis=1).argmin()] - place[:3, 3]
    along = np.zeros(3)
    along[np.abs(way).argmax()] = way[np.abs(way).argmax()]
    arrow_dragged(page, viewer, place, along)
    until(lambda: viewer.panel.live.count > 0, "no motion is planned while it is dragged")
    page.get_by_text("certified motions a second").wait_for()
    calm(viewer)
    assert viewer.panel.handles.dragging
    moved = place_of(viewer.edited, BALL, viewer.stage.tip).matrix
    assert np.linalg.norm(moved[:3, 3] - place[:3, 3]) > 0.02
    assert not np.array_equal(active_of(viewer).motion.trajectory.positions, first.positions)
    says_the_truth(page, viewer)
    let_go(page, viewer)


@pytest.mark.slow  # `test_handling` holds the law without a page
def test_a_click_selects_and_the_handle_stands_upright(page: Any, viewer: Viewer) -> None:
    """Also after the goal was selected, whose handle is turned: an obstacle that is dragged 16 pixels stays upright."""
    selected(in_sight(page, viewer), viewer, GOAL)
    prism = next(node for node in viewer.stage.obstacles if node.obstacle.name == "prism")
    middle = np.asarray(prism.mesh.vertices).mean(axis=0) + prism.obstacle.pose.position
    page.mouse.click(*seen(page, middle))
    until(lambda: viewer.panel.handles.selected == Thing("obstacle", "prism"), "the click selects nothing")
    viewer.worker.settle(20)
    handled(page, viewer)
    place = place_of(viewer.edited, Thing("obstacle", "prism"), viewer.stage.tip)
    x, y = seen(page, grip(page, place.matrix, 2))
    gripped(page, (x, y))
    page.mouse.move(x, y - 16, steps=4)
    moved: Callable[[], Any] = lambda: place_of(viewer.edited, Thing("obstacle", "prism"), viewer.stage.tip)  # noqa: E731
    until(lambda: moved().position != place.position, "nothing moves")
    let_go(page, viewer)
    np.testing.assert_allclose(moved().matrix[:3, :3], place.matrix[:3, :3], rtol=0, atol=1e-9)
    assert moved().position[:2] == pytest.approx(place.position[:2], abs=1e-9)


@pytest.mark.slow
def test_the_start_is_dragged_by_the_mouse(page: Any, viewer: Viewer) -> None:
    place = selected(in_sight(page, viewer), viewer, START)
    before = viewer.edited.start
    arrow_dragged(page, viewer, place, -0.15 * place[:3, 0])
    until(lambda: bool(np.abs(viewer.edited.start - before).max() > 0.02), "the start stays where it was")
    let_go(page, viewer)
    calm(viewer)
    motion = active_of(viewer).motion
    assert motion.certificate.certified
    np.testing.assert_allclose(motion.joints[0], viewer.edited.start, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_tab_that_is_closed_while_it_drags_lets_go(tab: Tabs, served: Viewer) -> None:
    """And another one says what holds."""
    page, viewer = in_sight(tab(served.address()), served), served
    place = selected(page, viewer, BALL)
    arrow_dragged(page, viewer, place, np.array([-0.1, 0.0, 0.0]), steps=4)
    until(lambda: viewer.panel.handles.dragging, "it is not dragged")
    page.close()
    until(lambda: not viewer.panel.handles.dragging, "it is still dragged by a page that is gone")
    calm(viewer)
    other = tab(viewer.address())
    says_the_truth(other, viewer)
    assert active_of(viewer).motion.measured


@pytest.mark.slow  # without a page `test_live` closes it
def test_the_server_ends_while_it_plans(tab: Tabs, served: Viewer) -> None:
    page, viewer = in_sight(tab(served.address()), served), served
    place = selected(page, viewer, BALL)
    arrow_dragged(page, viewer, place, np.array([-0.1, 0.0, 0.0]), steps=4)
    viewer.close()
    assert page.get_by_text("planar_arm").count()  # as it was seen last
    page.close()  # which looks for the server until then


# --- by a finger, on a narrow screen: the panel is a sheet from below -------------------------------------------------


NARROW = {"width": 420, "height": 640}


@pytest.fixture
def touched(page: Any, viewer: Viewer) -> Iterator[Any]:
    """The page that tests share, on a screen that is touched."""
    touch = page.context.new_cdp_session(page)
    touch.send("Emulation.setTouchEmulationEnabled", {"enabled": True})
    viewer.panel.live.set(False)  # the mouse's test holds what follows a drag
    yield page
    viewer.panel.live.set(True)
    touch.send("Emulation.setTouchEmulationEnabled", {"enabled": False})
    page.set_viewport_size(SIZE)


def dragged(page: Any, begin: tuple[float, float], end: tuple[float, float], last: str) -> None:
    """Drag a handle by a finger, which is lifted last, or taken by the browser: playwright taps alone."""
    touch = page.context.new_cdp_session(page)

    def send(kind: str, *points: tuple[float, float]) -> None:
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y} for x, y in points]})

    assert page.evaluate("(at) => document.elementFromPoint(...at).tagName", begin) == "CANVAS"
    send("touchStart", begin)
    wait_for(page, HOLDS)
    for share in np.linspace(0.1, 1.0, 8):
        x, y = (1 - share) * np.array(begin) + share * np.array(end)
        send("touchMove", (float(x), float(y)))
    send(last)


def test_a_finger_drags_above_the_sheet(touched: Any, viewer: Viewer) -> None:
    page = touched
    for width in (NARROW["width"], SHEET - 20):  # viser's own sheet, and the panel that it docks beside the scene
        page.set_viewport_size({**NARROW, "width": width})
        sheet, canvas = page.locator("div:has(> div > .hdplan-page)"), page.locator("canvas").first
        until(lambda width=width, canvas=canvas: canvas.bounding_box()["width"] == width, "the scene is not as wide")

        boxes: list[Any] = []

        def stands(sheet: Any = sheet, width: int = width, boxes: list[Any] = boxes) -> bool:
            """True once the sheet, which the page may be rebuilding, is below the whole scene."""
            of = "e => e.closest('[style*=absolute], [style*=fixed]').getBoundingClientRect().toJSON()"
            boxes.append(sheet.evaluate(of))
            return (boxes[-1]["width"], boxes[-1]["bottom"]) == (width, NARROW["height"])

        until(stands, "the sheet does not stand below the scene")
        box = boxes[-1]
        assert box["height"] <= 0.01 * LOW * NARROW["height"] + 1
        assert canvas.bounding_box()["height"] <= box["top"] + 1
    page.set_viewport_size({**NARROW, "width": 1000})  # the panel grows with the window
    until(lambda: 0 <= 1000 - WIDTH - canvas.bounding_box()["width"] < 10, "the panel is not as wide as it may be")
    page.set_viewport_size(NARROW)
    x, y, z = place_of(viewer.edited, BALL, viewer.stage.tip).position
    look(page, viewer, (x, y - 2.0, z + 1.5), (x, y, z))
    for last in ("touchEnd", "touchCancel"):
        place, before = selected(page, viewer, BALL), viewer.edited
        held = grip(page, place, 0)
        dragged(page, seen(page, held), seen(page, held - [0.2, 0.0, 0.0]), last)
        until(
            lambda before=before: viewer.edited is not before and not viewer.panel.handles.dragging,
            "it is not let go",
        )
        calm(viewer)
        now = place_of(viewer.edited, BALL, viewer.stage.tip).matrix[:3, 3]
        assert now[0] < place[0, 3] - 0.1
        np.testing.assert_allclose(now[1:], (y, z), atol=1e-6)
