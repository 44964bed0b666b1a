"""Laws of the panel's exports: files of what was shown at the click, certified again, by mouse in a real browser; their
verdicts never belong to another scene."""

from __future__ import annotations

import io
import threading
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.page.archive import archive
from hdplan.planner.view import exports
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene
from hdplan.verify import verify
from tests.planner.view.events import Opener, active_of, by_worker
from tests.planner.view.in_browser import Tabs, press, tab_of
from tests.waiting import until


class Browser:
    """Stands for one, and keeps the files that it is sent."""

    client_id = 1

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}

    def send_file_download(self, name: str, data: bytes, save_immediately: bool) -> None:
        self.files[name] = data


def download(viewer: Viewer, what: str) -> Browser:
    browser = Browser()
    by_worker(viewer, lambda: viewer.panel.exports._begin(what, browser))
    return browser


def status(viewer: Viewer) -> str:
    return str(viewer.panel.saving._text.content)


def test_all_of_it_is_of_the_scene_at_the_request(
    opened: Opener, scene: Scene, trajectory: Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The ball goes into the motion while it is being made: the requested file comes, and no verdict on what is
    shown by then."""
    viewer, go_on, made = opened(scene, found=trajectory), threading.Event(), archive
    monkeypatch.setattr("hdplan.planner.page.archive.archive", lambda *given: (go_on.wait(60), made(*given))[1])
    browser = download(viewer, exports.ARCHIVE)
    assert "being made" in status(viewer)
    download(viewer, "page")
    assert "another file" in status(viewer)
    before = viewer.scene
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    assert viewer.scene is not before
    go_on.set()
    until(lambda: bool(browser.files), "nothing comes")
    until(lambda: "done, from the scene" in status(viewer), "the panel has no message")
    assert "certified" not in status(viewer)
    with zipfile.ZipFile(io.BytesIO(browser.files["planar_arm.zip"])) as read:
        read.extractall(tmp_path)
    files = [tmp_path / "planar_arm" / name for name in ("planar_arm.yaml", "motion.json", "motion.proof")]
    assert verify(*files).whole
    assert [each.name for each in load_scene(files[0]).obstacles] == [each.name for each in before.obstacles]


def test_an_uncertified_motion_is_not_archived(opened: Opener, scene: Scene, trajectory: Trajectory) -> None:
    viewer = opened(scene)
    download(viewer, exports.ARCHIVE)
    assert "not saved: there is no motion yet" in status(viewer)
    by_worker(viewer, lambda: viewer.document.put("half", trajectory.between(0, 5)))
    browser = download(viewer, exports.ARCHIVE)
    until(lambda: "not saved: " in status(viewer) and "being made" not in status(viewer), "the panel has no message")
    assert not browser.files
    page = download(viewer, "page")  # which says so itself
    until(lambda: bool(page.files), "no page comes")
    assert b'"certified":false' in page.files["planar_arm.html"]


def test_a_browser_that_is_gone_ends_nothing(viewer: Viewer) -> None:
    gone: Any = SimpleNamespace(client_id=7, camera=SimpleNamespace(image_width=400, image_height=300))
    by_worker(viewer, lambda: viewer.panel.exports._begin("picture", gone))
    until(lambda: "not saved: AttributeError" in status(viewer), "the panel has no message")
    by_worker(viewer, lambda: viewer.panel.exports._download("no such thing", gone))


@pytest.mark.slow
def test_files_come_by_mouse(tab: Tabs, served: Viewer, tmp_path: Path) -> None:
    """All of it, a page and a picture, each from its button; the archive is accepted by the checker."""
    page = tab(served.address())
    page.get_by_text("certified: at least").first.wait_for()
    tab_of(page, "Scene")
    for button, name in (("Save all", "planar_arm.zip"), ("page", "planar_arm.html"), ("picture", "planar_arm.png")):
        with page.expect_download() as download:
            press(page, button)
        assert download.value.suggested_filename == name
        download.value.save_as(tmp_path / name)
        until(lambda: "saved: " in status(served), "the panel has no message")
    zipfile.ZipFile(tmp_path / "planar_arm.zip").extractall(tmp_path)
    files = [tmp_path / "planar_arm" / name for name in ("planar_arm.yaml", "motion.json", "motion.proof")]
    assert verify(*files).whole
    text = certify(served.scene, active_of(served).motion.trajectory).text
    assert text in (tmp_path / "planar_arm.html").read_text()
    from PIL import Image

    seen = Image.open(tmp_path / "planar_arm.png").convert("RGB")
    assert seen.width > 100
    assert len(seen.getcolors(1 << 24) or []) > 20
