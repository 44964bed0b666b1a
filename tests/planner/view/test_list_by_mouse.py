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
from hdplan.planner.view.things import Thing, place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene
from tests.planner.view.in_browser import (
    Tabs,
    address,
    arrow_dragged,
    calm,
    plainly,
    press,
    selected,
    tab_of,
)
from tests.planner.view.in_page import look, seen
from tests.waiting import until

pytestmark = pytest.mark.slow
BALL = Thing("obstacle", "ball")
EYE, TARGET = (0.4, -2.2, 2.6), (0.4, 0.3, 0.0)
COMES_IN = """(address) => new Promise((said) => {
  const socket = new WebSocket(address.replace(/^http/, 'ws').replace(/[/]([?]|$)/, '$1'), 'viser-vVERSION');
  socket.onopen = () => said(true);
  socket.onerror = socket.onclose = () => said(false);
})"""


@pytest.fixture
def viewer(scene: Scene, trajectory: Trajectory) -> Iterator[Viewer]:
    found = plainly(scene, (NAME, trajectory), ("other", trajectory))
    yield found
    found.close()


def line(page: Any, text: str) -> Any:
    """A line of a list; it takes no clicks where it lies, as the list is written anew while it is looked for."""
    return page.locator(".hd-row").filter(has_text=text).first


def names(viewer: Viewer) -> list[str]:
    return [obstacle.name for obstacle in viewer.scene.obstacles]


def test_two_points_are_measured(tab: Tabs, viewer: Viewer) -> None:
    """A click on the ball's side towards the eye, and one on the same spot: no way between them; and nothing is
    selected."""
    page = tab(address(viewer))
    look(page, viewer, EYE, TARGET)
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


def test_a_chosen_motion_stays_while_another_is_planned_live(tab: Tabs, viewer: Viewer) -> None:
    """The one that is chosen while the mouse is down is neither replaced nor lost; undo brings all back."""
    page = tab(address(viewer))
    look(page, viewer, EYE, TARGET)
    before = [shown.motion.trajectory for shown in viewer.motions.shown]
    place = selected(page, viewer, BALL)
    arrow_dragged(page, viewer, place, np.array([-0.1, 0.0, 0.0]), steps=4)
    until(lambda: viewer.panel.live.count > 0, "no motion is planned while it is dragged")
    line(page, "other").dispatch_event("click")
    until(lambda: viewer.motions.active is viewer.motions.shown[1], "it is not chosen")
    page.mouse.move(*seen(page, place[:3, 3] + np.array([-0.2, 0.0, 0.0])))
    page.mouse.up()
    until(lambda: not viewer.panel.handles.dragging, "it is not let go")
    calm(viewer)
    other = next(shown for shown in viewer.motions.shown if shown.motion.name == "other")
    assert np.array_equal(other.motion.trajectory.positions, before[1].positions)
    while viewer.document.history.can_undo:
        press(page, "undo")
        calm(viewer)
    assert [shown.motion.trajectory for shown in viewer.motions.shown] == before
    active = viewer.motions.active
    assert active is not None
    page.get_by_text(certify(viewer.scene, active.motion.trajectory, viewer.robot).text).first.wait_for()


def test_a_page_of_another_site_does_not_come_in(tab: Tabs, viewer: Viewer, scene: Scene) -> None:
    """With the secret, too: from another port's page, and from its own."""
    import viser

    script = COMES_IN.replace("VERSION", viser.__version__)
    other = plainly(dataclasses.replace(scene, name="another"))
    with contextlib.closing(other):
        page = tab(address(other))
        assert page.evaluate(script, address(other))
        assert not page.evaluate(script, address(viewer))
        assert not viewer.server.get_clients()
        page.goto("about:blank")
