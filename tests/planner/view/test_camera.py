"""The camera, without a browser: everything is in the picture, nothing hides it that need not, and turning the whole
world turns the view."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hdplan.planner.view.drawing.camera import FOV, FRAME_SIZE, SIDES, Boxes, View, best_view, view_from
from hdplan.scenes.array_types import Array

NONE = Boxes.around([], [])


def placed(rotation: Array, translation: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, translation
    return pose


def seen_at(view: View, points: Array, aspect: float) -> Array:
    """Places of points in the picture (k, 2), -1 to 1 from edge to edge."""
    ahead = (view.target - view.eye) / np.linalg.norm(view.target - view.eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    x, y, z = ((points - view.eye) @ np.stack([right, np.cross(right, ahead), ahead], axis=1)).T
    assert (z > 0.0).all()
    return np.stack([x / z / aspect, y / z], axis=1) / np.tan(0.5 * FOV)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("aspect", [0.3, 1.0, 2.2])
def test_everything_is_in_the_picture_and_fills_it(seed: int, aspect: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, 3)) * rng.uniform(0.1, 2.0, 3) + rng.normal(size=3)
    directions = [*SIDES.values(), (rng.uniform(-np.pi, np.pi), rng.uniform(0.1, 1.2))]
    for azimuth, elevation in directions:
        at = np.abs(seen_at(view_from(azimuth, elevation, points, aspect), points, aspect))
        assert at.max() == pytest.approx(1.0 / FRAME_SIZE)


def test_the_sides_look_along_the_axes() -> None:
    points = np.random.default_rng(0).normal(size=(9, 3))
    for name, axis in (("front", [1, 0, 0]), ("side", [0, -1, 0]), ("top", [0, 0, 1])):
        view = view_from(*SIDES[name], points, 1.0)
        towards = (view.eye - view.target) / np.linalg.norm(view.eye - view.target)
        assert towards @ axis > 0.9999, name


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(30))
def test_a_box_hides_what_the_way_to_it_crosses(seed: int) -> None:
    """Against the same way walked in small steps."""
    rng = np.random.default_rng(seed)
    poses = [placed(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)) for _ in range(6)]
    bounds = [np.array([-rng.uniform(0.05, 0.8, 3), rng.uniform(0.05, 0.8, 3)]) for _ in poses]
    boxes, eye, points = (
        Boxes.around([each[None] for each in bounds], poses),
        3.0 * rng.normal(size=3),
        rng.normal(size=(20, 3)),
    )
    walked = eye + np.linspace(0.0, 1.0, 4001)[:, None, None] * (points - eye)
    for index, (pose, (low, high)) in enumerate(zip(poses, bounds, strict=True)):
        local = (walked - pose[:3, 3]) @ pose[:3, :3]
        inside = np.all((local >= low) & (local <= high), axis=2)
        crossed = inside.any(axis=0) & ~inside[-1]
        hidden = boxes.hide(eye, points)[:, index]
        grazes = inside.sum(axis=0) <= 2  # shorter than a step: either is right
        assert np.all((hidden == crossed) | grazes)
        corners = np.array(np.meshgrid(*np.transpose([low, high]))).reshape(3, 8).T @ pose[:3, :3].T + pose[:3, 3]
        np.testing.assert_allclose(boxes.lowest()[index], corners[:, 2].min())


def test_the_camera_looks_past_a_wall() -> None:
    """A wall stands at the usual place of the camera; beside it nothing is hidden, and from behind it is
    transparent."""
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (40, 3)) + [0.0, 0.0, 0.5]
    path = np.linspace([-0.2, 0.0, 0.5], [0.2, 0.1, 0.6], 20)
    interest = np.concatenate([points, path])
    usual = best_view(points, interest, path, NONE, 1.2)
    towards = (usual.eye - usual.target) / np.linalg.norm(usual.eye - usual.target)
    pose = placed(np.eye(3), usual.target + 0.6 * towards)
    turn = Rotation.from_euler("z", np.arctan2(towards[1], towards[0])).as_matrix()
    pose[:3, :3] = turn
    wall = Boxes.around([np.array([[[-0.02, -0.6, -0.6], [0.02, 0.6, 0.6]]])], [pose])
    assert wall.hide(usual.eye, interest).mean() > 0.9
    assert wall.in_the_way(usual.eye, interest).all()
    other = best_view(points, interest, path, wall, 1.2)
    assert wall.hide(other.eye, interest).mean() < 0.05
    assert not wall.in_the_way(other.eye, interest).any()


def test_a_path_is_seen_from_its_side() -> None:
    for angle in np.deg2rad(range(0, 180, 20)):
        path = np.linspace(-1.0, 1.0, 20)[:, None] * [np.cos(angle), np.sin(angle), 0.0]
        view = best_view(path, path, path, NONE, 1.0)
        ahead = (view.target - view.eye)[:2] / np.linalg.norm(view.target - view.eye)
        assert abs(ahead @ [np.cos(angle), np.sin(angle)]) < 0.75


def test_a_box_does_not_hide_its_content() -> None:
    """A bin's box is full of air."""
    box = Boxes.around([np.array([[[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]])], [np.eye(4)])
    assert not box.hide(np.array([5.0, 0.0, 0.0]), np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])).any()
    assert box.hide(np.array([5.0, 0.0, 0.0]), np.array([[-2.0, 0.0, 0.0]])).all()
