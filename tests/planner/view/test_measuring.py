"""Measures between two points that are clicked on, the axes of the joints, and limits in the joints' plot."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import trimesh

import hdplan
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.drawing.rays import first_hit
from hdplan.planner.view.layers import FRAMES
from hdplan.planner.view.things import Thing
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene, derived
from tests.planner.view.events import Opener, by_worker


def meets(origin: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> float:
    """How far along a ray it meets a triangle (3, 3), by a system of equations; inf if it does not."""
    edges = corners[1:] - corners[0]
    u, v, far = np.linalg.solve(np.column_stack([*edges, -direction]), origin - corners[0])
    return float(far) if min(u, v, 1.0 - u - v, far) >= 0.0 else np.inf


def test_a_ray_meets_the_nearest_of_all_triangles() -> None:
    """Whatever the mesh, not convex, too, and where it stands; rays beside it and away from it meet nothing."""
    rng = np.random.default_rng(11)
    meshes = [trimesh.creation.icosphere(2, 0.3), trimesh.creation.annulus(0.2, 0.4, 0.1)]
    hits = 0
    for _ in range(60):
        mesh = meshes[rng.integers(2)]
        place = trimesh.transformations.random_rotation_matrix(rng.random(3))
        place[:3, 3] = rng.normal(0.0, 0.2, 3)
        origin, direction = rng.normal(0.0, 1.0, 3), rng.normal(0.0, 1.0, 3)
        if rng.random() < 0.7:
            direction = place[:3, 3] + rng.normal(0.0, 0.2, 3) - origin
        direction /= np.linalg.norm(direction)
        found = first_hit(origin, direction, [(mesh.vertices, mesh.faces, place)])
        moved = mesh.copy().apply_transform(place)
        nearest = min(meets(origin, direction, corners) for corners in moved.triangles)
        assert (found is None) == np.isinf(nearest)
        if found is not None:
            np.testing.assert_allclose(found, origin + nearest * direction, atol=1e-7)
            hits += 1
    assert 15 < hits < 50


def clicked(viewer: Viewer, at: tuple[float, float]) -> None:
    """Let a browser say that somebody who looks straight down clicks there."""
    event = SimpleNamespace(ray_origin=(*at, 5.0), ray_direction=(0.0, 0.0, -1.0))
    viewer.panel.measuring._clicked(event)
    assert viewer.worker.settle(20)


def test_two_clicks_measure_and_a_third_starts_over(opened: Opener, scene: Scene) -> None:
    boxes = [hdplan.Box([0.2, 0.2, height], name=f"at {height}", pose=[x, 3.0, 0.0]) for x, height in ((2, 1), (3, 2))]
    viewer = opened(derived(scene, obstacles=(*scene.obstacles, *boxes)))
    measuring = viewer.panel.measuring
    clicked(viewer, (2.0, 3.0))
    assert measuring.points == []  # nobody measures
    measuring.switch.value = True
    clicked(viewer, (2.0, 3.0))
    assert "second point" in measuring.text.content
    clicked(viewer, (9.0, 9.0))
    assert "nothing is there" in measuring.text.content
    clicked(viewer, (3.0, 3.0))
    np.testing.assert_allclose(measuring.points, [[2.0, 3.0, 0.5], [3.0, 3.0, 1.0]], atol=1e-9)
    assert f"{1e3 * np.hypot(1.0, 0.5):.1f} mm apart: x +1000.0, y +0.0, z +500.0 mm" in measuring.text.content
    assert measuring._label.visible
    viewer.panel.handles._clicked(Thing("obstacle", "at 1"), False)
    assert viewer.panel.handles.selected is None  # a click sets a point, and selects nothing
    clicked(viewer, (3.0, 3.0))
    assert len(measuring.points) == 1
    assert not measuring._label.visible
    measuring.switch.value = False
    by_worker(viewer, measuring.begin)
    assert not measuring._root.visible


def test_axes_are_what_joints_turn_about(opened: Opener, scene: Scene) -> None:
    """A joint that moves alone leaves the points of its own axis where they are."""
    viewer = opened(scene)
    by_worker(viewer, lambda: viewer.panel.layers.set(FRAMES, True))
    robot, lines = viewer.robot, np.asarray(viewer.panel.layers.frames.axes.points)
    data = robot.model.createData()
    for number in range(1, robot.model.njoints):
        q = viewer.edited.start.copy()
        pin.forwardKinematics(robot.model, data, robot.pin_q(q))
        before = data.oMi[number].copy()
        ends = [before.actInv(point.astype(float)) for point in lines[number - 1]]
        assert np.linalg.norm(ends[1] - ends[0]) > 0.3
        q[number - 1] += 0.4
        pin.forwardKinematics(robot.model, data, robot.pin_q(q))
        for own, point in zip(ends, lines[number - 1], strict=True):
            np.testing.assert_allclose(data.oMi[number].act(own), point, atol=1e-5)


def test_limits_near_a_motion_are_drawn_beside_its_joints(opened: Opener, scene: Scene) -> None:
    """And no others, which would leave the curves no room."""
    viewer = opened(scene)
    robot = viewer.robot
    near = np.stack([viewer.edited.start, robot.upper - 0.01])
    by_worker(viewer, lambda: viewer.document.put("near", Trajectory(robot.joint_names, near)))
    handle = viewer.panel.plots.drawn.joints.handle
    assert "limits dotted" in handle.title
    drawn = [handle.data[i] for i, line in enumerate(handle.series) if line["label"] == ""]
    bounds = {float(np.unique(row).item()) for row in drawn}
    assert set(robot.upper.tolist()) <= bounds
    assert bounds <= {*robot.upper.tolist(), *robot.lower.tolist()}
    low, high = handle.scales["y"]["range"]
    assert low <= near.min()
    assert high >= robot.upper.max()
