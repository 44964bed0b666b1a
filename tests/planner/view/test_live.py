"""Live planning, without a browser: what is dragged takes a certified motion along, and nothing stale is shown."""

from __future__ import annotations

import dataclasses
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan as plan_scene
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view import live as module
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.history import History
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.things import GOAL, START, dragged, place_of, things
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.view.events import BALL, Opener, active_of, by_worker, settled


@pytest.fixture
def viewer(opened: Opener, scene: Scene, trajectory: Trajectory) -> Viewer:
    viewer = opened(scene, live=True, planned=trajectory)
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    return viewer


def in_the_way(viewer: Viewer) -> Pose:
    """Place of the ball in the way of the active motion."""
    tip = active_of(viewer).motion.tip
    return dataclasses.replace(place_of(viewer.edited, BALL, viewer.stage.tip), position=tuple(tip[len(tip) // 2]))


def test_a_motion_follows_what_is_dragged(viewer: Viewer) -> None:
    """At every step what is shown is certified in the scene that is shown, or marked as not certified."""
    begin = np.array(place_of(viewer.edited, BALL, viewer.stage.tip).position)
    way = np.array(in_the_way(viewer).position) - begin
    for share in np.linspace(0.1, 0.8, 8):
        pose = Pose(tuple((begin + share * way).tolist()))
        by_worker(viewer, lambda pose=pose: viewer.panel.handles.drag(pose))
        settled(viewer)
        active = active_of(viewer)
        certificate = certify(viewer.scene, active.motion.trajectory, viewer.robot)
        assert viewer.document.holds(active)
        assert active.motion.certificate.text == certificate.text
        assert certificate.certified
    assert viewer.panel.live.count == 8
    assert "certified motions a second" in viewer.panel.live.text.content
    assert not active.motion.measured
    by_worker(viewer, viewer.panel.handles.let_go)
    assert active.motion.measured


def test_a_motion_that_no_longer_holds_is_reported_at_once_with_pair_and_depth(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = threading.Event()
    plan = plan_scene

    def late(*given: Any, **named: Any) -> Any:
        gate.wait(20)
        return plan(*given, **named)

    monkeypatch.setattr(module, "plan", late)
    pose = in_the_way(viewer)
    by_worker(viewer, lambda: viewer.panel.handles.drag(pose))
    verdict = viewer.panel.verdict
    assert "and ball overlap by" in verdict
    assert "of an older scene" in verdict
    assert "certified" not in verdict
    gate.set()
    settled(viewer)
    assert active_of(viewer).motion.certificate.certified or "and ball overlap by" in viewer.panel.verdict


def test_the_newest_scene_is_planned_and_those_between_are_dropped(
    viewer: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned: list[Scene] = []
    begun, gate = threading.Event(), threading.Event()
    plan = plan_scene

    def noted(scene: Scene, **named: Any) -> Any:
        planned.append(scene)
        begun.set()
        gate.wait(20)
        return plan(scene, **named)

    monkeypatch.setattr(module, "plan", noted)
    begin = np.array(place_of(viewer.edited, BALL, viewer.stage.tip).position)
    for step in range(10):
        pose = Pose(tuple((begin + [0.002 * step, 0.0, 0.0]).tolist()))
        by_worker(viewer, lambda pose=pose: viewer.panel.handles.drag(pose))
        assert begun.wait(20)
    gate.set()
    settled(viewer)
    assert [scene.obstacles for scene in planned[1:]] == [viewer.scene.obstacles]
    assert active_of(viewer).motion.certificate.certified


@pytest.mark.parametrize("drags", [15, pytest.param(40, marks=pytest.mark.slow)])
def test_verdicts_stay_true_during_live_drags(drags: int, viewer: Viewer) -> None:
    """At random, without waiting: each verdict on a motion is about the scene that it names."""
    rng = np.random.default_rng(3)
    for _ in range(drags):
        thing = things(viewer.edited)[rng.integers(len(things(viewer.edited)))]
        place = place_of(viewer.edited, thing, viewer.stage.tip)
        pose = dataclasses.replace(
            place, position=tuple((place.position + rng.normal(0, 0.04, 3) * [1, 1, 0]).tolist())
        )
        by_worker(viewer, lambda thing=thing: viewer.panel.handles.select(thing))
        viewer.worker.ask("drag", lambda pose=pose: viewer.panel.handles.drag(pose))
        if rng.random() < 0.3:
            viewer.panel.handles.grip.release()
        if rng.random() < 0.3:
            time.sleep(0.05)
        by_worker(viewer, lambda: _assert_true(viewer))
    settled(viewer)
    by_worker(viewer, lambda: _assert_true(viewer))


def _assert_true(viewer: Viewer) -> None:
    for shown in viewer.motions.shown:
        if viewer.document.holds(shown):
            text = certify(viewer.scene, shown.motion.trajectory, viewer.robot).text
            assert shown.motion.certificate.text == text
        else:
            assert "this motion is not checked" in viewer.panel.verdict


def test_switched_off_nothing_is_planned(viewer: Viewer) -> None:
    viewer.panel.live.set(False)
    pose = in_the_way(viewer)
    by_worker(viewer, lambda: viewer.panel.handles.drag(pose))
    settled(viewer)
    assert viewer.panel.live.count == 0
    viewer.panel.live.set(True)
    viewer.panel.live.learn(0.01)
    assert viewer.panel.live.on


def test_it_switches_itself_off_where_plans_take_long_unless_somebody_chose(opened: Opener, scene: Scene) -> None:
    viewer = opened(scene, live=None)
    assert viewer.panel.live.on
    viewer.panel.live.learn(2.0)
    assert not viewer.panel.live.on
    assert "takes more than" in viewer.panel.live.text.content
    viewer.panel.live.learn(0.2)
    assert viewer.panel.live.on
    viewer.panel.live.set(True)
    viewer.panel.live.learn(2.0)
    assert viewer.panel.live.on


def test_without_a_motion_yet_the_first_drag_plans_one(opened: Opener, scene: Scene) -> None:
    viewer = opened(scene, live=True)
    place = place_of(viewer.edited, BALL, viewer.stage.tip)
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    by_worker(viewer, lambda: viewer.panel.handles.drag(place))
    settled(viewer)
    assert [shown.motion.name for shown in viewer.motions.shown] == [NAME]
    assert "certified: at least" in viewer.panel.verdict


def test_closing_while_it_plans_ends_its_thread(opened: Opener, scene: Scene) -> None:
    others = threading.enumerate()
    viewer = opened(scene, live=True)
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    place = place_of(viewer.edited, BALL, viewer.stage.tip)
    viewer.worker.ask("drag", lambda: viewer.panel.handles.drag(place))
    viewer.close()
    assert not [each for each in threading.enumerate() if each.name == "hdplan-live" and each not in others]


# --- ends -------------------------------------------------------------------------------------------------------------


def test_the_start_is_dragged_and_the_motion_begins_there(viewer: Viewer) -> None:
    by_worker(viewer, lambda: viewer.panel.handles.select(START))
    tip = viewer.stage.tip
    near = tip.placement(viewer.edited.start + 0.1).translation
    pose = dataclasses.replace(place_of(viewer.edited, START, tip), position=tuple(near.tolist()))
    by_worker(viewer, lambda: viewer.panel.handles.drag(pose))
    settled(viewer)
    motion = active_of(viewer).motion
    assert motion.certificate.certified
    np.testing.assert_allclose(motion.joints[0], viewer.edited.start, rtol=0, atol=1e-9)


@pytest.fixture(scope="module")
def grasp() -> Edited:
    return Edited.of(Setup.of(load_scene("panda_grasp")))


def test_a_goal_pose_keeps_its_tolerance_and_free_axis(grasp: Edited) -> None:
    """Its configuration follows, and its free turn about the can is the arm's to choose."""
    from hdplan.planner.view.drawing.motion import Tip

    tip = Tip.of(grasp.robot)
    before = grasp.target
    place = place_of(grasp, GOAL, tip)
    assert place == before.poses[0].pose
    moved = dataclasses.replace(place, position=(0.52, 0.12, 0.4))
    after, words = dragged(grasp, GOAL, moved, tip)
    assert words == ""
    assert after.missed is None
    assert after.target == dataclasses.replace(before, pose=moved)
    assert grasp.missed is None
    far = dataclasses.replace(place, position=(3.0, 0.0, 0.4))
    lost, words = dragged(after, GOAL, far, tip)
    assert "out of reach: panda_hand_tcp is" in words
    assert lost.missed is not None
    back, words = dragged(lost, GOAL, moved, tip, begin=after)
    assert words == ""
    assert back.target == after.target


def test_a_scene_with_a_goal_pose_is_saved_with_it(opened: Opener, grasp: Edited, tmp_path: Path) -> None:
    viewer = opened(grasp.scene, live=True)
    by_worker(viewer, lambda: viewer.panel.handles.select(GOAL))
    place = place_of(viewer.edited, GOAL, viewer.stage.tip)
    pose = dataclasses.replace(place, position=tuple(np.add(place.position, (0.0, -0.01, 0.01)).tolist()))
    by_worker(viewer, lambda: viewer.panel.handles.drag(pose))
    settled(viewer)
    by_worker(viewer, viewer.panel.handles.let_go)
    assert active_of(viewer).motion.certificate.certified
    (tmp_path / "scene.yaml").write_bytes(viewer.panel.saving.scene_file())
    (tmp_path / "motion.json").write_bytes(viewer.panel.saving.motion_file())
    saved = load_scene(tmp_path / "scene.yaml")
    assert saved.goal == viewer.scene.goal
    assert certify(saved, Trajectory.load(tmp_path / "motion.json")).certified


# --- undo -------------------------------------------------------------------------------------------------------------


def test_a_drag_is_one_step_that_is_undone_and_done_again(viewer: Viewer) -> None:
    first = viewer.edited
    begin = np.array(place_of(first, BALL, viewer.stage.tip).position)
    for step in range(1, 4):
        pose = Pose(tuple((begin + [0.01 * step, 0.0, 0.0]).tolist()))
        by_worker(viewer, lambda pose=pose: viewer.panel.handles.drag(pose))
    by_worker(viewer, viewer.panel.handles.let_go)
    settled(viewer)
    last = viewer.edited
    by_worker(viewer, viewer.document.undo)
    assert viewer.edited is first
    assert viewer.stage.obstacles[
        [o.name for o in first.scene.obstacles].index("ball")
    ].obstacle.pose.position == tuple(begin.tolist())
    _assert_true(viewer)
    by_worker(viewer, viewer.document.redo)
    assert viewer.edited is last


def test_history_forgets_what_was_undone_at_the_next_step() -> None:
    history: History[str] = History()
    assert (history.can_undo, history.can_redo) == (False, False)
    assert history.undone("first") == "first"
    history.step("first")
    assert history.undone("second, changed") == "first"
    assert history.redone("first") == "second, changed"
    assert history.undone("second, changed") == "first"
    history.step("first")
    assert not history.can_redo
    assert history.redone("third") == "third"
    assert history.undone("third") == "first"
    history.part()
    assert not history.can_redo
