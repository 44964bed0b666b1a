"""A cloud in the viewer: drawn, selected, moved and saved like any obstacle; its own image of the robot on request."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan.planner.view.drawing import clouds
from hdplan.planner.view.layers import BOXES, LEFT_OUT
from hdplan.planner.view.scene_edits import placed
from hdplan.planner.view.things import Thing
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.fixed_array import FixedArray
from hdplan.scenes.scene import Scene
from tests.planner.view.events import Opener, by_worker

PATIENCE = 30.0  # [s]
START = [-0.5, 0.3, 0.0, -1.8, 0.0, 2.1, 0.785]


def seen() -> Scene:
    """A table, and the robot's own hand, as points."""
    rng = np.random.default_rng(0)
    table = rng.uniform([0.3, -0.5, 0.05], [0.9, 0.5, 0.06], size=(3000, 3))
    own = np.array([[0.0, 0.0, 0.3], [0.0, 0.0, 0.31]])
    view = Cloud(np.vstack([table, own]), 0.005, name="view", ignore_robot=0.05)
    return Scene(robot="panda", obstacles=[view], start=START, goal=[0.5, *START[1:]])


def test_points_left_out_are_shown_on_request(opened: Opener) -> None:
    viewer = opened(seen())
    assert viewer.stage.left_out is not None
    assert len(viewer.stage.left_out.points) == 2
    assert not viewer.stage.left_out.visible
    by_worker(viewer, lambda: viewer.panel.layers.set(LEFT_OUT, True))
    assert viewer.stage.left_out.visible
    assert opened(Scene(robot="panda", start=START, goal=START)).stage.left_out is None


def test_it_is_selected_dragged_and_a_dragged_start_carves_nothing_out_of_it(opened: Opener) -> None:
    viewer = opened(seen())
    shape = viewer.scene.obstacles[0].shape
    assert isinstance(shape, Cloud)
    assert isinstance(shape.points, FixedArray)
    assert len(shape.points) == 3000
    viewer.panel.handles.select(Thing("obstacle", "view"))
    viewer.worker.settle(PATIENCE)
    by_worker(viewer, lambda: viewer.document.change(placed(viewer.edited, "view", (0.0, 0.0, -0.02))))
    low = viewer.edited.starting_at(np.array([0.0, 0.9, 0.0, -1.6, 0.0, 2.5, 0.785]))  # its hand is in the table
    kept = low.scene.obstacles[0].shape
    assert isinstance(kept, Cloud)
    assert kept.points == shape.points
    assert low.contacts[0]


def test_points_are_sent_once_and_coloured_by_height_or_by_clearance(opened: Opener) -> None:
    viewer = opened(seen(), planned=hdplan.plan(seen()).trajectory)
    (cloud,) = viewer.stage.clouds
    assert len(cloud.points.points) == 3000
    sent = cloud.points.points
    bright = cloud.points.colors.astype(float).sum(axis=1)
    height = sent[:, 2]
    assert bright[height > 0.059].min() > bright[height < 0.051].max()
    motion = viewer.motions.active.motion
    tips, up = motion.tip, float(motion.tip[:, 2].min()) - 0.12
    viewer.worker.ask("move", lambda: viewer.document.change(placed(viewer.edited, "view", (0.0, 0.0, up))))
    by_worker(viewer, lambda: cloud.color(viewer.robot, motion))
    away = np.linalg.norm(sent[:, None, :2] - tips[None, :, :2], axis=2).min(axis=1)
    red = cloud.points.colors[:, 0].astype(float) - cloud.points.colors[:, 2]
    assert red[away < 0.02].mean() > red[away > 0.2].mean() + 50.0
    by_worker(viewer, lambda: viewer.document.change(placed(viewer.edited, "view", (0.0, 0.0, -0.02))))
    assert viewer.stage.clouds == [cloud]
    assert cloud.points.points is sent
    by_worker(viewer, lambda: cloud.color(viewer.robot, None))
    np.testing.assert_array_equal(cloud.points.colors.astype(float).sum(axis=1), bright)


def test_boxes_of_a_cloud_are_seen_only_where_it_is_selected_or_touched(opened: Opener) -> None:
    viewer = opened(seen())
    (cloud,) = viewer.stage.clouds
    assert cloud.mesh.opacity == 0.0
    size = cloud.points.point_size
    assert size == 0.01
    low, high = cloud.parts.transpose(1, 0, 2)[:, None]
    points = cloud.points.points[:, None]
    assert ((low <= points) & (points <= high)).all(axis=2).any(axis=1).all()
    assert len(cloud.mesh.faces) == 12 * len(cloud.parts) < 6000  # browsers look at all whenever the mouse moves
    for change, opacity, share in (
        (lambda: cloud.select(True), 0.25, 1.0),
        (lambda: cloud.select(False), 0.0, 1.0),
        (lambda: cloud.mark(True), 0.25, 1.0),
        (lambda: cloud.mark(False), 0.0, 1.0),
        (lambda: cloud.fade(True), 0.0, 0.35),
        (lambda: cloud.fade(False), 0.0, 1.0),
    ):
        by_worker(viewer, change)
        assert (cloud.mesh.opacity, cloud.points.point_size) == (opacity, share * size)


def test_of_huge_clouds_some_points_are_drawn(opened: Opener, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clouds, "MOST_POINTS", 1000)
    (cloud,) = opened(seen()).stage.clouds
    assert 700 <= len(cloud.points.points) <= 1000


def test_the_planners_boxes_are_drawn_on_request_and_follow_the_cloud(opened: Opener) -> None:
    viewer = opened(seen())
    assert viewer.panel.layers.boxes.node is None
    by_worker(viewer, lambda: viewer.panel.layers.set(BOXES, True))
    boxes = viewer.panel.layers.boxes
    assert boxes.node.visible
    before = boxes.node.vertices
    assert len(before) % 8 == 0
    assert len(before) > 100
    viewer.worker.ask("move", lambda: viewer.document.change(placed(viewer.edited, "view", (0.0, 0.0, -0.02))))
    by_worker(viewer, viewer.panel.player.draw)
    np.testing.assert_allclose(boxes.node.vertices, before - [0.0, 0.0, 0.02], atol=1e-6)
    by_worker(viewer, lambda: viewer.panel.layers.set(BOXES, False))
    assert not boxes.node.visible


def test_a_scene_with_a_cloud_is_saved_whole(tmp_path: Path) -> None:
    scene = hdplan.build(seen()).scene
    scene.save(tmp_path / "saved.yaml")
    assert hdplan.load_scene(tmp_path / "saved.yaml") == scene
