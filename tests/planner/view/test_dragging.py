"""Dragging with a real mouse in a real browser: what is dragged takes a certified motion along."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hdplan.planner.view.things import GOAL, START, Thing, place_of
from hdplan.planner.view.viewer import Viewer
from tests.planner.view.events import BALL, active_of
from tests.planner.view.in_browser import Tabs, arrow_dragged, calm, let_go, says_the_truth, selected
from tests.planner.view.in_page import grip, gripped, handled, look, seen
from tests.waiting import until


@pytest.fixture
def viewer(watched: Viewer) -> Viewer:
    return watched


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
