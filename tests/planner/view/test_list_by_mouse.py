"""The list of motions by mouse in a real browser while something is dragged, measures between two points, and a page of
another site."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.things import place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from tests.planner.view.events import BALL, active_of, by_worker, names
from tests.planner.view.in_browser import Tabs, arrow_dragged, calm, let_go, plainly, press, selected, tab_of
from tests.planner.view.in_page import EYE, handled, look, seen
from tests.waiting import until

pytestmark = pytest.mark.slow
COMES_IN = """(address) => new Promise((resolve) => {
  const socket = new WebSocket(address.replace(/^http/, 'ws').replace(/[/]([?]|$)/, '$1'), 'viser-vVERSION');
  socket.onopen = () => resolve(true);
  socket.onerror = socket.onclose = () => resolve(false);
})"""


@pytest.fixture
def viewer(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    found = plainly(scene, (NAME, trajectory), ("other", trajectory))
    yield found
    found.close()


def line(page: Any, text: str) -> Any:
    """A line of a list; it takes no clicks where it lies, as the list is rewritten during the search."""
    return page.locator(".hd-row").filter(has_text=text).first


def test_two_points_are_measured(tab: Tabs, viewer: Viewer) -> None:
    """A click on the ball's side towards the eye, and one on the same spot: no way between them; and nothing is
    selected."""
    page = tab(viewer.address())
    look(page, viewer)
    tab_of(page, "Scene")
    switch, measuring = page.get_by_label("measure", exact=True), viewer.panel.measuring
    switch.dispatch_event("click")
    until(lambda: measuring.on, "it is not switched on")
    middle = place_of(viewer.edited, BALL, viewer.stage.tip).matrix[:3, 3]
    for count, aside in ((1, -0.03), (2, 0.03)):
        page.mouse.click(*seen(page, middle + np.array([aside, 0.0, 0.0])))
        until(lambda count=count: len(measuring.points) == count, "a click sets no point")
    way = measuring.points[1] - measuring.points[0]
    assert 0.05 < way[0] < 0.07
    radius = viewer.scene.obstacles[names(viewer).index("ball")].shape.radius
    np.testing.assert_allclose(np.linalg.norm(np.array(measuring.points) - middle, axis=1), radius, rtol=0.02)
    page.get_by_text(f"{1e3 * np.linalg.norm(way):.1f} mm apart").first.wait_for()
    assert viewer.panel.handles.selected is None


def test_a_handle_behind_another_body_is_gripped(tab: Tabs, viewer: Viewer) -> None:
    """Browsers give a press to the first body that takes clicks."""
    middle = place_of(viewer.edited, BALL, viewer.stage.tip).matrix[:3, 3]
    before = Pose(tuple((0.7 * middle + 0.3 * np.array(EYE)).tolist()))
    wall = Obstacle("wall", Box((0.5, 0.5, 0.02)), before)
    by_worker(viewer, lambda: viewer.document.change(viewer.edited.changed(obstacles=(*viewer.scene.obstacles, wall))))
    page = tab(viewer.address())
    look(page, viewer)
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    handled(page, viewer)
    arrow_dragged(page, viewer, place_of(viewer.edited, BALL, viewer.stage.tip).matrix, np.array([0.05, 0.0, 0.0]), 2)
    page.mouse.up()
    until(lambda: place_of(viewer.edited, BALL, viewer.stage.tip).matrix[0, 3] > middle[0] + 0.02, "it is not moved")
    assert viewer.scene.obstacles[names(viewer).index("wall")].pose == before


@pytest.mark.parametrize("by", ["mouse", "keyboard"])
def test_obstacles_are_hidden_locked_duplicated_and_deleted(tab: Tabs, viewer: Viewer, by: str) -> None:
    page = tab(viewer.address())
    tab_of(page, "Scene")

    def use(word: str) -> None:
        """A click, or the tab key's focus and enter; each rewrites the list."""
        link = line(page, "ball").get_by_role("button", name=word, exact=True).first
        if by == "mouse":
            link.dispatch_event("click")
        else:
            link.press("Enter")

    for word, back, names_of in (
        ("hide", "show", viewer.panel.tree.hidden),
        ("lock", "unlock", viewer.document.locked),
    ):
        use(word)
        until(lambda names_of=names_of: "ball" in names_of, f"it does not {word}")
        use(back)
        until(lambda names_of=names_of: "ball" not in names_of, f"it does not {back}")
    line(page, "ball").dispatch_event("click")
    until(lambda: viewer.panel.handles.selected == BALL, "a click does not select")
    page.keyboard.press("Control+d")
    until(lambda: "ball2" in names(viewer), "it is not duplicated")
    if by == "keyboard":
        page.keyboard.press("Delete")
    else:
        line(page, "ball2").get_by_text("✕").dispatch_event("click")
    until(lambda: "ball2" not in names(viewer), "it is not deleted")
    assert "ball" in names(viewer)


def test_a_chosen_motion_stays_while_another_is_planned_live(tab: Tabs, viewer: Viewer) -> None:
    """The one that is chosen while the mouse is down is neither replaced nor lost; undo brings all back."""
    page = tab(viewer.address())
    look(page, viewer)
    before = [shown.motion.trajectory for shown in viewer.motions.shown]
    place = selected(page, viewer, BALL)
    arrow_dragged(page, viewer, place, np.array([-0.1, 0.0, 0.0]), steps=4)
    until(lambda: viewer.panel.live.count > 0, "no motion is planned while it is dragged")
    line(page, "other").dispatch_event("click")
    until(lambda: viewer.motions.active is viewer.motions.shown[1], "it is not chosen")
    page.mouse.move(*seen(page, place[:3, 3] + np.array([-0.2, 0.0, 0.0])))
    let_go(page, viewer)
    calm(viewer)
    other = next(shown for shown in viewer.motions.shown if shown.motion.name == "other")
    assert np.array_equal(other.motion.trajectory.positions, before[1].positions)
    while viewer.document.history.can_undo:
        press(page, "undo")
        calm(viewer)
    assert [shown.motion.trajectory for shown in viewer.motions.shown] == before
    active = active_of(viewer)
    page.get_by_text(certify(viewer.scene, active.motion.trajectory, viewer.robot).text).first.wait_for()


def test_a_page_of_another_site_does_not_come_in(tab: Tabs, viewer: Viewer, scene: Scene) -> None:
    """With the secret, too: from another port's page, and from its own."""
    import viser

    script = COMES_IN.replace("VERSION", viser.__version__)
    other = plainly(dataclasses.replace(scene, name="another"))
    with contextlib.closing(other):
        page = tab(other.address())
        assert page.evaluate(script, other.address())
        assert not page.evaluate(script, viewer.address())
        assert not viewer.server.get_clients()
        page.goto("about:blank")
