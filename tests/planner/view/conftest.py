"""A light scene and viewers of it."""

from __future__ import annotations

import functools
import typing
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("viser", reason="the viewer is optional: pip install viser")

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.server import open_viewer
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.view.events import Opener


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of pages come first: one process has them all, and opens one browser; what is left at its end, others
    take."""
    items.sort(key=lambda item: "browser" not in getattr(item, "fixturenames", ()))


@pytest.fixture(scope="session")
def scene() -> Scene:
    return load_scene("planar_arm")


@pytest.fixture(scope="session")
def trajectory(scene: Scene) -> Trajectory:
    return plan(scene).trajectory


@pytest.fixture(scope="session", autouse=True)
def types_are_read_once() -> Iterator[None]:
    """viser reads the types of attributes anew for every handle."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("viser._assignable_props_api.get_type_hints", functools.cache(typing.get_type_hints))
        yield


@pytest.fixture(autouse=True)
def nobody_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plan draws its iterations without time to be seen."""
    monkeypatch.setattr("hdplan.planner.view.planning.LOOK", 0.0)


@pytest.fixture
def opened() -> Iterator[Opener]:
    """Opens viewers on free ports, which do not plan live by default, and closes them in the end."""
    viewers: list[Viewer] = []
    complaints: list[str] = []

    def opened(scene: Scene, live: bool | None = False, **motions: Trajectory) -> Viewer:
        viewer = open_viewer(scene, list(motions.items()), port=8180, complain=complaints.append)
        if live is not None:
            viewer.panel.live.set(live)
        viewers.append(viewer)
        return viewer

    yield opened
    for viewer in viewers:
        viewer.close()
    assert not complaints


@pytest.fixture
def viewer(opened: Opener, scene: Scene, trajectory: Trajectory) -> Viewer:
    """A viewer of the scene with its motion."""
    return opened(scene, found=trajectory)


@pytest.fixture
def served(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    """A viewer for pages in a real browser; see `in_browser.plainly`."""
    from tests.planner.view.in_browser import plainly

    viewer = plainly(scene, (NAME, trajectory))
    yield viewer
    viewer.close()


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A real one; see `in_browser`."""
    from tests.planner.view.in_browser import opened_browser

    yield from opened_browser()


@pytest.fixture
def tab(browser: Any) -> Iterator[Any]:
    """Opens pages in it, and fails on any message in their consoles."""
    from tests.planner.view.in_browser import Tabs

    tabs = Tabs(browser)
    yield tabs
    tabs.close()
