"""Two people, or two hands, at one scene, without a browser: whatever comes while something is dragged, nothing that is
gone is selected, and every message is true."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.things import START, place_of, things
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene
from tests.planner.view.events import BALL, PRISM, Opener, by_worker, field_of, heard, names

SAYS_CERTIFIED = "certified: at least"


@pytest.fixture
def viewer(opened: Opener, scene: Scene, trajectory: Trajectory) -> Viewer:
    viewer = opened(scene, planned=trajectory)
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    return viewer


def pulled(viewer: Viewer, handle: Any, way: tuple[float, float, float]) -> None:
    """Let a browser say that a handle, which may be gone by now, was moved."""
    x, y, z = np.add(handle.position, way).tolist()
    target = handle if handle is viewer.panel.handles.grip.node else SimpleNamespace(wxyz=handle.wxyz)
    target.position = (x, y, z)
    viewer.panel.handles.grip.moved(SimpleNamespace(target=target, phase="update", client_id=1))
    assert viewer.worker.settle(20)


def assert_true(viewer: Viewer) -> None:
    """The selected thing exists, and the text on the active motion is true."""
    selected, active = viewer.panel.handles.selected, viewer.motions.active
    assert selected is None or selected in things(viewer.edited)
    assert len(viewer.stage.obstacles) == len(viewer.scene.obstacles)
    if active is not None and viewer.document.holds(active):
        assert active.motion.certificate.text == certify(viewer.scene, active.motion.trajectory, viewer.robot).text
    elif active is not None:
        assert SAYS_CERTIFIED not in viewer.panel.verdict


def test_a_deleted_obstacle_is_neither_selected_nor_dragged(viewer: Viewer) -> None:
    handle = viewer.panel.handles.grip.node
    pulled(viewer, handle, (-0.02, 0.0, 0.0))
    assert viewer.panel.handles.dragging
    before = names(viewer)
    by_worker(viewer, lambda: viewer.panel.editing.do(viewer.panel.obstacles.delete))
    assert names(viewer) == [name for name in before if name != "ball"]
    assert viewer.panel.handles.selected is None
    assert not viewer.panel.handles.dragging
    assert viewer.panel.handles.choice.value == "nothing"
    assert_true(viewer)
    without = viewer.edited
    pulled(viewer, handle, (-0.05, 0.0, 0.0))
    by_worker(viewer, viewer.panel.handles.let_go)
    assert viewer.edited is without
    assert_true(viewer)


def test_an_added_obstacle_can_be_undone_during_its_drag(viewer: Viewer) -> None:
    first = viewer.scene
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    handle = viewer.panel.handles.grip.node
    pulled(viewer, handle, (0.01, 0.0, 0.0))
    for _ in range(2):  # of the movement, and of the addition
        by_worker(viewer, lambda: viewer.panel.editing.ask("undo"))
    assert viewer.scene is first
    assert viewer.panel.handles.selected is None
    pulled(viewer, handle, (0.01, 0.0, 0.0))
    assert viewer.scene is first
    assert_true(viewer)


def test_another_browser_that_leaves_takes_nothing_out_of_the_hand(viewer: Viewer) -> None:
    """Its own does."""
    handle = viewer.panel.handles.grip.node
    pulled(viewer, handle, (-0.02, 0.0, 0.0))
    for browser, dragging in ((2, True), (1, False)):
        for left in viewer.server._client_disconnect_cb:
            left(SimpleNamespace(client_id=browser))
        assert viewer.worker.settle(20)
        assert viewer.panel.handles.dragging == dragging
        assert (viewer.panel.handles.grip.node is handle) == dragging


def test_a_handle_that_is_pressed_and_let_go_changes_nothing(viewer: Viewer) -> None:
    """As no motion's verdict falls, and no step is to be undone."""
    before, verdict, handle = viewer.edited, viewer.panel.verdict, viewer.panel.handles.grip.node
    pulled(viewer, handle, (1e-8, 0.0, 0.0))
    by_worker(viewer, viewer.panel.handles.let_go)
    assert viewer.edited is before
    assert viewer.panel.verdict == verdict
    assert not viewer.document.history.can_undo


def test_an_undo_in_the_midst_of_a_drag_loses_nothing(viewer: Viewer) -> None:
    first = viewer.edited
    handle = viewer.panel.handles.grip.node
    pulled(viewer, handle, (-0.01, 0.0, 0.0))
    moved = viewer.edited
    by_worker(viewer, lambda: viewer.panel.editing.ask("undo"))
    assert viewer.edited is first
    pulled(viewer, handle, (-0.02, 0.0, 0.0))  # by the hand that has not let go yet
    assert viewer.edited is first
    by_worker(viewer, viewer.document.redo)
    assert viewer.edited is moved
    by_worker(viewer, viewer.document.undo)
    assert viewer.edited is first


def test_an_edit_by_another_hand_leaves_the_thing_in_this_one(viewer: Viewer) -> None:
    """And each has a step of its own."""
    handle = viewer.panel.handles.grip.node
    pulled(viewer, handle, (-0.01, 0.0, 0.0))
    moved = viewer.edited
    by_worker(viewer, lambda: viewer.panel.editing.apply("add", lambda edited: edited.changed(name="other")))
    other = viewer.edited
    pulled(viewer, handle, (-0.01, 0.0, 0.0))
    assert viewer.panel.handles.dragging
    assert viewer.scene.name == "other"
    assert place_of(viewer.edited, BALL, viewer.stage.tip) != place_of(other, BALL, viewer.stage.tip)
    by_worker(viewer, viewer.document.undo)
    assert viewer.edited is other
    by_worker(viewer, viewer.document.undo)
    assert viewer.edited is moved


def test_a_handle_that_another_one_replaced_moves_nothing(viewer: Viewer) -> None:
    """A new selection does not jump to where the first thing was dragged."""
    handle = viewer.panel.handles.grip.node
    pulled(viewer, handle, (-0.01, 0.0, 0.0))
    by_worker(viewer, lambda: viewer.panel.handles.select(PRISM))
    before = viewer.edited
    pulled(viewer, handle, (-0.05, 0.0, 0.0))
    assert viewer.edited is before
    assert viewer.panel.handles.selected == PRISM


def test_a_value_typed_for_one_thing_does_not_change_another(viewer: Viewer) -> None:
    """Though that was selected before the worker came to it."""
    panel, before = viewer.panel, viewer.scene
    handle = field_of(panel.obstacles._fields, "clearance")

    def busy() -> None:
        heard(handle, "0.007")
        panel.handles.select(PRISM)

    by_worker(viewer, busy)
    assert viewer.scene is before
    assert "the selection has changed" in panel.editing.text.content


def test_a_worker_that_fails_says_so_and_shows_no_verdict(opened: Opener, scene: Scene, trajectory: Trajectory) -> None:
    calls: list[str] = []
    viewer = opened(scene, found=trajectory)
    viewer._complain = calls.append
    assert SAYS_CERTIFIED in viewer.panel.verdict

    def fails() -> None:
        raise StopIteration

    by_worker(viewer, fails)
    assert "hdplan failed here (StopIteration" in viewer.panel.verdict
    assert SAYS_CERTIFIED not in viewer.panel.verdict
    assert "hd-good" not in viewer.panel.verdict
    assert viewer.panel.clearance.content == ""
    assert len(calls) == 1
    by_worker(viewer, viewer.document.measure)
    assert SAYS_CERTIFIED in viewer.panel.verdict


def test_a_change_that_fails_half_way_shows_no_verdict(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    viewer._complain = calls.append
    monkeypatch.setattr(viewer.panel.jogging, "update", lambda: 1 / 0)
    pulled(viewer, viewer.panel.handles.grip.node, (-0.01, 0.0, 0.0))
    assert "hdplan failed here (ZeroDivisionError" in viewer.panel.verdict
    assert SAYS_CERTIFIED not in viewer.panel.verdict
    assert calls


def test_random_actions_of_two_users_keep_the_viewer_consistent(
    opened: Opener, scene: Scene, trajectory: Trajectory
) -> None:
    """At random: handles old and new are pulled, things selected, added, deleted, renamed, undone, redone and reset."""
    rng = np.random.default_rng(38)
    viewer = opened(scene, live=True, planned=trajectory)
    panel, handles = viewer.panel, viewer.panel.handles
    held: list[Any] = []

    def some(every: Sequence[Any]) -> Any:
        return every[rng.integers(len(every))]

    def rename() -> None:
        panel.editing.edit("name", lambda edited: panel.obstacles._renamed(edited, f"thing {rng.integers(4)}"))

    hands: list[Callable[[], object]] = [
        lambda: panel.editing.do(panel.obstacles.delete),
        lambda: panel.editing.do(panel.obstacles.duplicate),
        lambda: panel.editing.do(lambda: panel.obstacles.add("sphere")),
        lambda: panel.editing.ask("undo"),
        lambda: panel.editing.ask("redo"),
        lambda: panel.editing.ask("reset"),
        rename,
        handles.grip.release,
        lambda: viewer.worker.ask("select", lambda: handles.select(some(things(viewer.edited)))),
        lambda: viewer.worker.ask("select", lambda: handles.select(START)),
    ]
    for _ in range(40):
        if handles.grip.node is not None:
            held = [*held[-2:], handles.grip.node]
        if held and rng.random() < 0.5:
            handle = some(held)
            x, y, _ = (0.02 * rng.normal(size=3)).tolist()
            pulled(viewer, handle, (x, y, 0.0))
        else:
            some(hands)()
        if rng.random() < 0.6:
            assert viewer.worker.settle(20)
            by_worker(viewer, lambda: assert_true(viewer))
    assert panel.live.settle(20)
    assert viewer.worker.settle(20)
    by_worker(viewer, viewer.document.measure)
    by_worker(viewer, lambda: assert_true(viewer))
    assert viewer.document.holds(viewer.motions.active)
