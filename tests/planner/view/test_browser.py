"""The viewer in a real browser, Debian's chromium without a screen: it draws, follows the slider, plans, and two tabs
see the same."""

from __future__ import annotations

import io
import json
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
from hdplan.planner.view.viewer import OUTDATED, Viewer
from hdplan.scenes.scene import Scene

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium found: apt-get install chromium")

SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 760, "height": 360}  # small: every pixel is drawn by the processor
SCENE = 340  # [px] of its width, where the panel is not
PATIENCE = 180_000  # [ms] for what comes in seconds where the processor has nothing else to do


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as running:
        found = running.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield found
        found.close()


@pytest.fixture(scope="module")
def viewer(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    found = open_viewer(scene, [("found", trajectory)], port=8280)
    yield found
    found.close()


@pytest.fixture
def tab(browser: Any) -> Iterator[Callable[[str], Any]]:
    """Opens pages, and fails if one of them has complained in its console."""
    complaints: list[str] = []
    pages: list[Any] = []

    def tab(address: str) -> Any:
        page = browser.new_page(viewport=SIZE)
        pages.append(page)
        page.set_default_timeout(PATIENCE)
        page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(address)
        page.wait_for_selector("canvas")
        return page

    yield tab
    for page in pages:
        page.close()
    assert not complaints


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
    return page.locator("input[type=text]").first


def set_time(page: Any, value: float) -> None:
    time_field(page).fill(str(value))
    time_field(page).press("Enter")


def test_the_page_shows_the_scene_and_the_slider_moves_the_robot(tab: Callable[[str], Any], viewer: Viewer) -> None:
    viewer.show(0.0)
    page = tab(address(viewer))
    page.get_by_text("certified: at least").wait_for()
    until(lambda: coloured(picture(page)) > 500, "the canvas stays empty")
    before = picture(page)
    set_time(page, 0.6)
    until(lambda: viewer.player.time == 0.6, "the slider does not reach the server")
    until(lambda: changed(picture(page), before) > 300, "the robot stays where it was")
    page.get_by_text("clearance at 0.600").wait_for()


def test_a_second_tab_sees_the_same(tab: Callable[[str], Any], viewer: Viewer) -> None:
    first, second = tab(address(viewer)), tab(address(viewer))
    set_time(first, 0.35)
    second.get_by_text("clearance at 0.350").wait_for()
    until(lambda: time_field(second).input_value() == "0.35", "the second slider stays where it was")
    first.close()  # in the middle of things
    viewer.show(0.7)
    second.get_by_text("clearance at 0.700").wait_for()


def test_plan_works(tab: Callable[[str], Any], viewer: Viewer) -> None:
    page = tab(address(viewer))
    page.get_by_role("tab", name="Plan").click()
    page.get_by_role("button", name="Plan", exact=True).click()
    page.get_by_text("iterations,").wait_for()
    assert "certified: at least" in page.get_by_text("iterations,").inner_text()
    assert viewer.active is not None
    assert viewer.active.motion.name == NAME
    with page.expect_download() as download:
        page.get_by_role("button", name="Save motion").click()
    found = Trajectory.load(_named(download.value, "motion.json"))
    np.testing.assert_array_equal(found.positions, viewer.active.motion.trajectory.positions)


def test_what_is_dragged_by_the_mouse_takes_the_verdict_with_it(tab: Callable[[str], Any], scene: Scene) -> None:
    """While the button is still pressed: nothing on the page says certified, and the file says what holds."""
    viewer = open_viewer(scene, port=8280)
    try:
        page = tab(address(viewer))
        page.get_by_role("tab", name="Plan").click()
        page.get_by_role("button", name="Plan", exact=True).click()
        page.get_by_text("iterations,").wait_for()
        assert viewer.active is not None
        index = next(i for i, obstacle in enumerate(scene.obstacles) if obstacle.name == "ball")
        begin = np.array(scene.obstacles[index].pose.position)
        path = viewer.active.motion.tip
        way = path[np.linalg.norm(path - begin, axis=1).argmin()] - begin
        axis = np.eye(3)[np.abs(way).argmax()] * np.sign(way[np.abs(way).argmax()])
        viewer.worker.settle(20)
        before = picture(page)
        viewer.planning.handles.choice.value = "obstacle ball"
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
        until(lambda: viewer.scene.obstacles[index].pose.position != tuple(begin), "the ball stays where it was")
        page.get_by_text(OUTDATED).wait_for()
        assert page.get_by_text("certified: at least").count() == 0
        with page.expect_download() as download:
            page.get_by_role("button", name="Save motion").dispatch_event("click")
        said = json.loads(Path(download.value.path()).read_text(encoding="utf-8"))["verdict"]
        viewer.worker.settle(20)
        certificate = viewer.certifier.certify(viewer.active.motion.trajectory)
        assert not certificate.certified
        assert said["text"] == certificate.text
        page.mouse.up()
        page.get_by_text("in contact:").first.wait_for()
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


def test_a_recorded_page_plays_without_a_server(tab: Callable[[str], Any], viewer: Viewer, tmp_path: Path) -> None:
    viewer.record(tmp_path / "page.html")
    page = tab((tmp_path / "page.html").as_uri())
    until(lambda: coloured(picture(page)) > 500, "the canvas stays empty")
    before = picture(page)
    until(lambda: changed(picture(page), before) > 300, "nothing moves")
