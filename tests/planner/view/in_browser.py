"""A real browser for tests, Debian's chromium without a screen: pages, pictures of them, and hands at mouse and
keyboard."""

from __future__ import annotations

import contextlib
import io
import queue
import shutil
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.server import open_viewer
from hdplan.planner.view.things import Thing, place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene
from tests.planner.view.events import by_worker, verdict_on
from tests.planner.view.in_page import drawn, grip, gripped, handled, seen
from tests.waiting import until

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))
from chromium import SELDOM, SOFTWARE

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

SIZE = {"width": 760, "height": 360}  # small: every pixel is drawn by the processor
SCENE = 340  # [px] of its width, where the panel is not
LOST = ("ERR_CONNECTION", "WebSocket")  # words of a page whose server has ended, perhaps before it: no fault of its own
PATIENCE = 180_000  # [ms] for what comes in seconds where the processor has nothing else to do


def opened_browser() -> Iterator[Any]:
    """One whose pages share what was loaded once."""
    playwright = pytest.importorskip("playwright.sync_api", reason="not installed: pip install playwright")
    if CHROMIUM is None:
        pytest.skip("no chromium found: apt-get install chromium")
    with playwright.sync_playwright() as running:
        found = running.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield screen(found, viewport=SIZE)
        found.close()


def screen(browser: Any, **its: Any) -> Any:
    """A screen of a browser, on which a few pictures a second are drawn."""
    pages = browser.new_context(**its)
    pages.add_init_script(SELDOM)
    return pages


def plainly(scene: Scene, *motions: tuple[str, Trajectory]) -> Viewer:
    """A viewer without reflections, shadows and a pulse, which cost the processor seconds a page."""
    viewer = open_viewer(scene, motions, port=8280, share=True)
    viewer.pulse.end()
    viewer.server.scene.configure_environment_map(None)
    viewer.server.scene.configure_default_lights(cast_shadow=False)
    return viewer


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
        page.on("console", lambda message: self._heard(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: self._heard(str(error)))
        page.goto(address)
        page.wait_for_selector("canvas")
        page.get_by_text("Software WebGL").wait_for()
        page.locator(".mantine-Notification-closeButton").dispatch_event("click")  # it lies over the scene
        return page

    def _heard(self, text: str) -> None:
        if not any(each in text for each in LOST):
            self.complaints.append(text)

    def close(self) -> None:
        for page in self.pages:
            page.close()
        assert not self.complaints, self.complaints


def picture(page: Any) -> NDArray[np.int64]:
    """Picture of the scene in the page (h, w, 3)."""
    from PIL import Image

    shot = page.screenshot(clip={"x": 0, "y": 0, "width": SCENE, "height": SIZE["height"]})
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), dtype=np.int64)


@contextlib.contextmanager
def slow_line(port: int, delay: float, rate: float) -> Iterator[int]:
    """A port that leads to another one over a line with a delay [s] each way and a rate [bytes/s]: chromium's own
    throttling leaves web sockets as they are."""
    listening = socket.create_server(("127.0.0.1", 0))
    every = [listening]

    def carry(here: socket.socket, there: socket.socket) -> None:
        sent: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()

        def deliver() -> None:
            with contextlib.suppress(OSError):
                while True:
                    due, data = sent.get()
                    time.sleep(max(0.0, due - time.monotonic()) + len(data) / rate)
                    if not data:
                        there.shutdown(socket.SHUT_WR)
                        return
                    there.sendall(data)

        threading.Thread(target=deliver, daemon=True).start()
        with contextlib.suppress(OSError):
            data = b"begun"
            while data:
                data = here.recv(1 << 14)
                sent.put((time.monotonic() + delay, data))

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                every.append(near := listening.accept()[0])
                every.append(far := socket.create_connection(("127.0.0.1", port)))
                for ends in ((near, far), (far, near)):
                    threading.Thread(target=carry, args=ends, daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    yield int(listening.getsockname()[1])
    for each in every:
        with contextlib.suppress(OSError):
            each.shutdown(socket.SHUT_RDWR)
        each.close()


def coloured(image: NDArray[np.int64]) -> int:
    """How many pixels are neither white nor grey."""
    return int((np.ptp(image, axis=2) > 24).sum())


def changed(image: NDArray[np.int64], before: NDArray[np.int64]) -> int:
    """How many pixels are others than before."""
    return int((np.abs(image - before).max(axis=2) > 24).sum())


def press(page: Any, name: str) -> None:
    """Click a button, without the wait for pictures in which it stands still: a full processor draws few."""
    page.get_by_role("button", name=name, exact=True).dispatch_event("click")


def calm(viewer: Viewer) -> None:
    """Wait until nothing is planned or drawn any more."""
    until(lambda: viewer.panel.live.settle(0.1) and viewer.worker.settle(0.1), "it plans on for ever")


def selected(page: Any, viewer: Viewer, thing: Thing) -> NDArray[np.float64]:
    """Select a thing, wait until its handle is drawn, and return where that stands (4, 4)."""
    by_worker(viewer, lambda: viewer.panel.handles.select(thing))
    handled(page, viewer)
    return place_of(viewer.edited, thing, viewer.stage.tip).matrix


def let_go(page: Any, viewer: Viewer) -> None:
    """Release the mouse's button, and wait until nothing is dragged any more."""
    page.mouse.up()
    until(lambda: not viewer.panel.handles.dragging, "it is not let go")


def says_the_truth(page: Any, viewer: Viewer) -> None:
    """Wait until the page says of the active motion what holds in the scene as it is now."""
    page.get_by_text(verdict_on(viewer)).first.wait_for()


def tab_of(page: Any, name: str) -> None:
    page.get_by_role("tab", name=name).click()


def entry(page: Any, viewer: Viewer, label: str) -> Any:
    """The input that stands in the panel with a label."""
    inputs = viewer.server.gui._gui_input_handle_from_uuid.values()
    uuid = [each._impl.uuid for each in inputs if getattr(each, "label", "") == label][-1]
    beside = f'//label[@for="{uuid}"]/ancestor::*[following-sibling::*//input][1]/following-sibling::*//input'
    return page.locator(f"xpath={beside}").first


def typed(page: Any, viewer: Viewer, label: str, text: str) -> None:
    """Type into a field, and leave it."""
    field = entry(page, viewer, label)
    field.fill(text)
    field.blur()


def arrow_dragged(
    page: Any, viewer: Viewer, place: NDArray[np.float64], way: NDArray[np.float64], steps: int = 10
) -> None:
    """Grip the arrow along which most of a way (3,) leads from a handle at `place` (4, 4), and drag it so far (world
    frame); the button stays down."""
    along = place[:3, :3].T @ way
    held = grip(page, place, int(np.abs(along).argmax()))
    gripped(page, seen(page, held))
    for share in np.linspace(1 / steps, 1.0, steps):
        page.mouse.move(*seen(page, held + share * way))
        drawn(page)
