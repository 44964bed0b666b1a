"""The fields of every kind of obstacle, and hands that get in each other's way, by mouse and keyboard in a real
browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from typing import Any, get_args

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.scene_edits import NEW
from hdplan.planner.view.things import place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.obstacles import Obstacle, SteadyMotion
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Shape
from hdplan.scenes.timing import Timing
from tests.planner.view.events import BALL, PRISM, active_of, by_worker
from tests.planner.view.in_browser import Tabs, arrow_dragged, calm, let_go, plainly, press, tab_of, typed
from tests.planner.view.in_page import handled, look
from tests.waiting import until

pytestmark = pytest.mark.slow
Opened = Callable[[Scene], tuple[Any, Viewer]]


@pytest.fixture
def opened(tab: Tabs, trajectory: Trajectory) -> Iterator[Opened]:
    """Serves a scene and opens a page of it."""
    viewers: list[Viewer] = []

    def opened(scene: Scene) -> tuple[Any, Viewer]:
        viewers.append(plainly(scene, (NAME, trajectory)) if not scene.timed else plainly(scene))
        page = tab(viewers[-1].address())
        look(page, viewers[-1])
        return page, viewers[-1]

    yield opened
    for viewer in viewers:
        viewer.close()


def last(viewer: Viewer) -> Obstacle:
    return viewer.scene.obstacles[-1]


def first_of(viewer: Viewer, key: str) -> float:
    """The size of the last obstacle, or the first of several."""
    value = getattr(last(viewer).shape, key)
    return float(value[0] if isinstance(value, tuple) else value)


def test_every_size_of_every_shape_is_typed(opened: Opened, scene: Scene) -> None:
    page, viewer = opened(scene)
    tab_of(page, "Scene")
    assert {type(shape) for shape in NEW.values()} | {each for each in get_args(Shape) if each.__name__ == "Mesh"} == {
        *get_args(Shape)
    }
    for word, shape in NEW.items():
        count = len(viewer.scene.obstacles)
        press(page, word)
        until(lambda count=count: len(viewer.scene.obstacles) == count + 1, f"no {word} is added")
        calm(viewer)
        for key in (each.name for each in fields(shape) if not each.kw_only):
            if key == "points":
                rows = "0 0 0\n0.2 0 0\n0 0.2 0\n0 0 0.2"
                box = page.get_by_role("textbox").and_(page.locator("textarea"))
                box.fill(rows)
                box.blur()
                until(lambda key=key: getattr(last(viewer).shape, key)[1] == (0.2, 0.0, 0.0), "the points stay")
                continue
            typed(page, viewer, f"{key} [m]", "0.123")
            until(lambda key=key: first_of(viewer, key) == 0.123, f"{word}: {key} stays as it was")
        before = last(viewer)
        typed(page, viewer, "position [m]", "1.5")
        until(lambda: last(viewer).pose.position[0] == pytest.approx(1.5), f"{word} stays where it was")
        assert last(viewer).shape == before.shape


def test_an_obstacle_gets_a_speed_where_the_scene_has_times(opened: Opened, scene: Scene) -> None:
    page, viewer = opened(replace(scene, timing=Timing(duration=4.0)))
    tab_of(page, "Scene")
    by_worker(viewer, lambda: viewer.panel.handles.select(PRISM))
    page.get_by_text("velocity [m/s]").wait_for()
    typed(page, viewer, "velocity [m/s]", "0.02")

    def moves() -> bool:
        motion = next(each.motion for each in viewer.scene.obstacles if each.name == "prism")
        return isinstance(motion, SteadyMotion) and motion.velocity == (0.02, 0.0, 0.0)

    until(moves, "it does not move")
    press(page, "undo")
    until(lambda: not moves(), "it still moves")


def test_a_speed_without_times_is_refused_in_a_line(opened: Opened, scene: Scene) -> None:
    page, viewer = opened(scene)
    tab_of(page, "Scene")
    by_worker(viewer, lambda: viewer.panel.handles.select(PRISM))
    page.get_by_text("velocity [m/s]").wait_for()
    typed(page, viewer, "velocity [m/s]", "0.02")
    page.get_by_text("timing.duration is missing").first.wait_for()
    assert viewer.scene == scene


def test_an_obstacle_is_renamed_while_it_is_dragged(opened: Opened, tab: Tabs, scene: Scene) -> None:
    """In another tab, as one mouse cannot do both: the drag continues with the renamed obstacle."""
    page, viewer = opened(scene)
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    other = tab(viewer.address())
    other.bring_to_front()  # behind another one, a page draws nothing
    tab_of(other, "Scene")
    other.get_by_text("velocity [m/s]").wait_for()
    page.bring_to_front()
    look(page, viewer)
    handled(page, viewer)
    place = place_of(viewer.edited, BALL, viewer.stage.tip).matrix
    arrow_dragged(page, viewer, place, np.array([-0.1, 0.0, 0.0]), steps=4)
    until(lambda: viewer.panel.handles.dragging, "it is not dragged")
    typed(other, viewer, "name", "globe")
    page.mouse.move(300, 200)
    let_go(page, viewer)
    calm(viewer)
    names = [obstacle.name for obstacle in viewer.scene.obstacles]
    assert ("globe" in names) != ("ball" in names)
    assert len(names) == len(scene.obstacles)
    if (active := viewer.motions.active) is not None and active.motion.certificate.certified:
        assert certify(viewer.scene, active.motion.trajectory, viewer.robot).certified


def test_two_tabs_drag_at_once(opened: Opened, tab: Tabs, scene: Scene) -> None:
    """There is one handle: both hands pull at it, the last wish holds, and every page says the same in the end."""
    page, viewer = opened(scene)
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    other = tab(viewer.address())
    other.bring_to_front()  # behind another one, a page draws nothing
    look(other, viewer)
    page.bring_to_front()
    look(page, viewer)
    handled(page, viewer)
    place = place_of(viewer.edited, BALL, viewer.stage.tip).matrix
    arrow_dragged(page, viewer, place, np.array([-0.1, 0.0, 0.0]), steps=4)
    until(lambda: viewer.panel.handles.dragging, "it is not dragged")
    other.bring_to_front()
    handled(other, viewer)
    place = place_of(viewer.edited, BALL, viewer.stage.tip).matrix
    arrow_dragged(other, viewer, place, np.array([0.1, 0.0, 0.0]), steps=4)
    page.mouse.up()
    other.mouse.up()
    until(lambda: not viewer.panel.handles.dragging, "it is not let go")
    calm(viewer)
    active = active_of(viewer)
    if active.motion.certificate.certified:
        text = certify(viewer.scene, active.motion.trajectory, viewer.robot).text
        for each in (page, other):
            each.get_by_text(text).first.wait_for()
