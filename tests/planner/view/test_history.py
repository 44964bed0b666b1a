"""Undo covers the motions: whatever was planned, replaced, renamed or removed comes back as it was, and what is planned
late takes no other motion's place."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.view import live as module
from hdplan.planner.view.planning import KEPT_PLANS, NAME
from hdplan.planner.view.things import place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from tests.planner.view.events import BALL, Opener, by_worker, settled


@pytest.fixture
def viewer(opened: Opener, scene: Scene, trajectory: Trajectory) -> Viewer:
    """A motion that was loaded, and one that was planned here."""
    viewer = opened(scene, loaded=trajectory)
    by_worker(viewer, lambda: planned(viewer, NAME))
    return viewer


def planned(viewer: Viewer, name: str) -> None:
    result = plan(viewer.scene)
    viewer.document.put(name, result.trajectory, result.certificate, result=result)


def way(viewer: Viewer, which: str) -> None:
    by_worker(viewer, lambda: viewer.panel.editing.ask(which))


def seen(viewer: Viewer) -> list[Any]:
    """The shown motions."""
    active = viewer.motions.active
    return [
        active and active.motion.name,
        *((s.motion.name, s.motion.trajectory, s.color) for s in viewer.motions.shown),
    ]


def dragged(viewer: Viewer, x: float) -> None:
    place = place_of(viewer.edited, BALL, viewer.stage.tip).position
    pose = Pose((place[0] + x, place[1], place[2]))
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    by_worker(viewer, lambda: viewer.panel.handles.drag(pose))


@pytest.mark.parametrize("do", ["rename", "remove", "plan"])
def test_changes_of_motions_are_undone_and_redone(viewer: Viewer, do: str) -> None:
    before, motion = seen(viewer), viewer.motions.shown[1].motion
    shown = viewer.motions.shown[1]
    if do == "plan":
        by_worker(viewer, lambda: planned(viewer, f"{NAME} 2"))
    else:
        message = {"do": do, "motion": shown.number, "answer": "mine"}
        viewer.panel.page._handlers[do](None, message)
        assert viewer.worker.settle(20)
    after = seen(viewer)
    assert after != before
    for _ in range(2):
        way(viewer, "undo")
        assert seen(viewer) == before
        assert viewer.motions.shown[1].motion is motion
        assert viewer.document.holds(viewer.motions.shown[1])
        assert "certified: at least" in viewer.panel.verdict
        way(viewer, "redo")
        assert seen(viewer) == after
    names = {node for node in viewer.server.scene._handle_from_node_name if node.startswith("/path/")}
    assert len(names) == len(viewer.motions.shown)


def test_a_motion_that_live_replaced_comes_back_and_stays(viewer: Viewer) -> None:
    before, motion = seen(viewer), viewer.motions.shown[1].motion
    viewer.panel.live.set(True)
    dragged(viewer, -0.1)
    settled(viewer)
    by_worker(viewer, viewer.panel.handles.let_go)
    assert seen(viewer) != before
    after = seen(viewer)
    way(viewer, "undo")
    settled(viewer)
    assert seen(viewer) == before
    assert viewer.motions.shown[1].motion is motion
    assert motion.certificate.text == certify(viewer.scene, motion.trajectory, viewer.robot).text
    way(viewer, "redo")
    settled(viewer)
    assert seen(viewer) == after
    assert all(viewer.document.holds(shown) for shown in viewer.motions.shown)


@pytest.mark.parametrize("meanwhile", ["choose", "undo", "remove"])
def test_a_late_plan_takes_no_other_motions_place(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch, meanwhile: str
) -> None:
    """Chosen, brought back, or left over after a removal while a plan was under way."""
    by_worker(viewer, lambda: planned(viewer, "other"))
    begun, gate = threading.Event(), threading.Event()
    plain = plan

    def late(*given: Any, **named: Any) -> Any:
        begun.set()
        assert gate.wait(20)
        return plain(*given, **{**named, "stop": None})

    monkeypatch.setattr(module, "plan", late)
    viewer.panel.live.set(True)
    dragged(viewer, -0.1)
    assert begun.wait(20)
    if meanwhile == "choose":
        by_worker(viewer, lambda: viewer.document.choose(NAME))
    elif meanwhile == "undo":
        way(viewer, "undo")
    else:
        by_worker(viewer, lambda: viewer.document.remove(viewer.motions.shown[-1]))
    before = seen(viewer)
    gate.set()
    settled(viewer)
    assert seen(viewer) == before


def test_plans_that_made_room_come_back(viewer: Viewer) -> None:
    for k in range(KEPT_PLANS):
        by_worker(viewer, lambda k=k: planned(viewer, f"more {k}"))
    before = seen(viewer)

    def one_more() -> None:
        planned(viewer, "last")
        viewer.motions.make_room(KEPT_PLANS)

    by_worker(viewer, one_more)
    assert NAME not in [shown.motion.name for shown in viewer.motions.shown]
    way(viewer, "undo")
    assert seen(viewer) == before


def test_at_random_the_way_back_is_the_way_there(viewer: Viewer) -> None:
    rng = np.random.default_rng(7)
    states = [(viewer.edited, seen(viewer))]
    for k in range(8):
        match rng.integers(4):
            case 0:
                by_worker(viewer, lambda k=k: planned(viewer, f"plan {k}"))
            case 1 if viewer.motions.shown:
                one = viewer.motions.shown[rng.integers(len(viewer.motions.shown))]
                by_worker(viewer, lambda one=one: viewer.document.remove(one))
            case _:
                dragged(viewer, 0.01 * rng.normal())
                by_worker(viewer, viewer.panel.handles.let_go)
        states.append((viewer.edited, seen(viewer)))
    for edited, motions in reversed(states[:-1]):
        way(viewer, "undo")
        assert viewer.edited is edited
        assert seen(viewer) == motions
    for edited, motions in states[1:]:
        way(viewer, "redo")
        assert viewer.edited is edited
        assert seen(viewer) == motions
