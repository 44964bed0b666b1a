"""The viewer in a real browser, Debian's chromium without a screen: it draws, follows the slider, plans, and two tabs
see the same."""

from __future__ import annotations

import io
import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.handles import SIZE as SIZE_OF_HANDLE
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.server import open_viewer
from hdplan.planner.view.viewer import Viewer
from hdplan.planner.view.words import OUTDATED
from hdplan.scenes.scene import Scene

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium found: apt-get install chromium")

SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 760, "height": 360}  # small: every pixel is drawn by the processor
SELDOM = "const frame = requestAnimationFrame; requestAnimationFrame = (draw) => setTimeout(frame, 200, draw)"  # 5 Hz
SCENE = 340  # [px] of its width, where the panel is not
SPENT = re.compile(r"– \d+ attempt")  # ends what Plan says
PATIENCE = 180_000  # [ms] for what comes in seconds where the processor has nothing else to do


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """One whose pages share what was loaded once, and draw a few pictures a second: each is the processor's work."""
    with playwright.sync_playwright() as running:
        found = running.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        pages = found.new_context(viewport=SIZE)
        pages.add_init_script(SELDOM)
        yield pages
        found.close()


def plainly(scene: Scene, *motions: tuple[str, Trajectory]) -> Viewer:
    """A viewer without reflections and shadows, which cost the processor seconds a page."""
    viewer = open_viewer(scene, motions, port=8280)
    viewer.server.scene.configure_environment_map(None)
    viewer.server.scene.configure_default_lights(cast_shadow=False)
    return viewer


@pytest.fixture(scope="module")
def viewer(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    found = plainly(scene, ("found", trajectory))
    yield found
    found.close()


class Tabs:
    """Opens pages, and keeps what they complain of in their consoles."""

    def __init__(self, browser: Any) -> None:
        self.browser = browser
        self.complaints: list[str] = []
        self.pages: list[Any] = []

    def __call__(self, address: str) -> Any:
        page = self.browser.new_page()
        self.pages.append(page)
        page.set_default_timeout(PATIENCE)
        page.on("console", lambda message: self.complaints.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.goto(address)
        page.wait_for_selector("canvas")
        return page

    def close(self) -> None:
        for page in self.pages:
            page.close()
        assert not self.complaints


@pytest.fixture
def tab(browser: Any) -> Iterator[Tabs]:
    tabs = Tabs(browser)
    yield tabs
    tabs.close()


@pytest.fixture(scope="module")
def kept(browser: Any, viewer: Viewer) -> Iterator[Tabs]:
    """The page of the viewer that all tests share: the first pictures of each cost the processor seconds."""
    tabs = Tabs(browser)
    tabs(address(viewer))
    yield tabs
    tabs.close()


@pytest.fixture
def page(kept: Tabs) -> Iterator[Any]:
    kept.pages[0].bring_to_front()  # a page behind another one's tab draws no pictures, and waits for them for ever
    yield kept.pages[0]
    assert not kept.complaints


def address(viewer: Viewer) -> str:
    return f"http://127.0.0.1:{viewer.port}"


def picture(page: Any) -> NDArray[np.int64]:
    """What the page shows of the scene (h, w, 3)."""
    from PIL import Image

    shot = page.screenshot(clip={"x": 0, "y": 0, "width": SCENE, "height": SIZE["height"]})
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), dtype=np.int64)


def until(true: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE / 1e3
    while not true():
        assert time.monotonic() < deadline, what
        time.sleep(0.1)


def coloured(image: NDArray[np.int64]) -> int:
    """How many pixels are neither white nor grey."""
    return int((np.ptp(image, axis=2) > 24).sum())


def changed(image: NDArray[np.int64], before: NDArray[np.int64]) -> int:
    """How many pixels are others than before."""
    return int((np.abs(image - before).max(axis=2) > 24).sum())


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
    other = tab(address(viewer))
    set_time(other, 0.35)
    page.locator('[data-moment="0.350"]').wait_for()
    until(lambda: time_field(page).input_value() == "0.35", "the second slider stays where it was")
    other.close()  # in the middle of things
    viewer.show(0.7)
    page.locator('[data-moment="0.700"]').wait_for()


def press(page: Any, name: str) -> None:
    """Click a button, without the wait for pictures in which it stands still: a full processor draws few."""
    page.get_by_role("button", name=name, exact=True).dispatch_event("click")


def test_plan_works(page: Any, viewer: Viewer) -> None:
    page.get_by_role("tab", name="Plan").click()
    press(page, "Plan")
    page.get_by_text(SPENT).wait_for()
    assert "certified: at least" in page.get_by_text(SPENT).inner_text()
    assert viewer.motions.active is not None
    assert viewer.motions.active.motion.name == NAME
    page.get_by_role("tab", name="Scene").click()
    with page.expect_download() as download:
        press(page, "Save motion")
    found = Trajectory.load(_named(download.value, "motion.json"))
    np.testing.assert_array_equal(found.positions, viewer.motions.active.motion.trajectory.positions)


def test_what_is_dragged_by_the_mouse_takes_the_verdict_with_it(tab: Tabs, scene: Scene) -> None:
    """While the button is still pressed: nothing on the page says certified, and the file says what holds."""
    viewer = plainly(scene)
    viewer.panel.live.set(False)
    try:
        page = tab(address(viewer))
        page.get_by_role("tab", name="Plan").click()
        press(page, "Plan")
        page.get_by_text(SPENT).wait_for()
        page.get_by_role("tab", name="Scene").click()
        assert viewer.motions.active is not None
        index = next(i for i, obstacle in enumerate(scene.obstacles) if obstacle.name == "ball")
        begin = np.array(scene.obstacles[index].pose.position)
        path = viewer.motions.active.motion.tip
        way = path[np.linalg.norm(path - begin, axis=1).argmin()] - begin
        axis = np.eye(3)[np.abs(way).argmax()] * np.sign(way[np.abs(way).argmax()])
        viewer.worker.settle(20)
        before = picture(page)
        viewer.panel.handles.choice.value = "obstacle ball"
        viewer.worker.settle(20)
        until(lambda: changed(picture(page), before) > 100, "the handle is not drawn")
        page.wait_for_timeout(2000)  # until nothing else is
        grip = begin + 0.7 * SIZE_OF_HANDLE * np.abs(axis)
        page.mouse.move(*_seen(page, viewer, grip))
        page.wait_for_timeout(500)
        page.mouse.down()
        for share in np.linspace(0.1, 1.0, 10):
            page.mouse.move(*_seen(page, viewer, grip + share * (np.linalg.norm(way) + 0.05) * axis))
            page.wait_for_timeout(200)
        until(
            lambda: np.linalg.norm(viewer.scene.obstacles[index].pose.position - begin) > np.linalg.norm(way),
            "the ball does not come all the way",
        )
        page.get_by_text(OUTDATED).first.wait_for()
        assert page.get_by_text("certified: at least").count() == 0
        with page.expect_download() as download:
            press(page, "Save motion")
        said = json.loads(Path(download.value.path()).read_text(encoding="utf-8"))["verdict"]
        viewer.worker.settle(20)
        certificate = viewer.certifier.certify(viewer.motions.active.motion.trajectory)
        assert not certificate.certified
        assert said["text"] == certificate.text
        page.mouse.up()
        page.get_by_text("in contact in this scene").first.wait_for()
    finally:
        viewer.close()


def _seen(page: Any, viewer: Viewer, point: NDArray[np.float64]) -> tuple[float, float]:
    """Where on the page a point of the scene is seen [px]."""
    (client,) = viewer.server.get_clients().values()
    camera, canvas = client.camera, page.locator("canvas").first.bounding_box()
    w, x, y, z = camera.wxyz
    right, down, ahead = Rotation.from_quat([x, y, z, w]).as_matrix().T @ (point - camera.position)
    scale = 0.5 * canvas["height"] / np.tan(0.5 * camera.fov) / ahead
    return canvas["x"] + 0.5 * canvas["width"] + scale * right, canvas["y"] + 0.5 * canvas["height"] + scale * down


def _named(download: Any, name: str) -> Path:
    path = Path(download.path())
    return path.rename(path.with_name(name))


def test_a_recorded_page_plays_without_a_server(tab: Tabs, viewer: Viewer, tmp_path: Path) -> None:
    viewer.record(tmp_path / "page.html")
    page = tab((tmp_path / "page.html").as_uri())
    until(lambda: coloured(picture(page)) > 500, "the canvas stays empty")
    before = picture(page)
    until(lambda: changed(picture(page), before) > 300, "nothing moves")
