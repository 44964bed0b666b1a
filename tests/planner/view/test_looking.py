"""Views of browsers, by the server: everything is framed, what hides the robot fades, each side has its view."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hdplan.planner.view.drawing.camera import SIDES
from hdplan.planner.view.drawing.nodes import FADED
from hdplan.planner.view.drawing.outline import INSIDE, Outline
from hdplan.planner.view.things import GOAL, Thing
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.obstacles import Obstacle
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from tests.planner.view.events import Opener, by_worker


def test_the_first_view_has_the_robot_in_the_picture(viewer: Viewer) -> None:
    camera = viewer.server.initial_camera
    ahead = (camera.look_at - camera.position) / np.linalg.norm(camera.look_at - camera.position)
    outline = Outline(viewer.robot)
    for q in (viewer.edited.start, viewer.edited.goal):
        for corner in outline.at(q).reshape(-1, 3):
            way = (corner - camera.position) / np.linalg.norm(corner - camera.position)
            assert way @ ahead > np.cos(
                0.5 * camera.fov * 1.6
            )  # within the picture's corners, which is wider than high
    eyes = {viewer.panel.looking.view(name, 1.0).eye.tobytes() for name in SIDES}
    assert len({*eyes, camera.position.tobytes()}) == 1 + len(SIDES)


def test_the_outline_goes_with_the_robot(opened: Opener, scene: Scene) -> None:
    viewer = opened(scene)
    outline = Outline(viewer.robot)
    assert np.abs(outline.at(viewer.edited.start) - outline.at(viewer.edited.goal)).max() > 0.1
    inside, middles = outline.inside(viewer.edited.start), outline.middles(viewer.edited.start)
    whole = outline.at(viewer.edited.start)[-len(middles) :]
    spread = np.ptp(inside.reshape(-1, 4, 3) - middles[:, None], axis=1)  # ends of links count, as their middles do
    np.testing.assert_allclose(spread, INSIDE * np.ptp(whole, axis=1))
    again = outline.at(viewer.edited.start)
    np.testing.assert_array_equal(again, Outline(viewer.robot).at(viewer.edited.start))


def test_an_obstacle_before_the_eye_fades_and_comes_back(viewer: Viewer, scene: Scene) -> None:
    view = viewer.panel.looking.view("best", 1.2)
    wall = Obstacle("wall", Box((0.6, 0.6, 0.6)), Pose(tuple((0.8 * view.eye + 0.2 * view.target).tolist())))
    away = replace(wall, pose=Pose(tuple((view.eye + [0.0, 0.0, 30.0]).tolist())))

    def with_wall(obstacle: Obstacle) -> None:
        others = tuple(each for each in viewer.scene.obstacles if each.name != "wall")
        by_worker(viewer, lambda: viewer.document.change(viewer.edited.changed(obstacles=(*others, obstacle))))

    with_wall(wall)
    faded = {node.obstacle.name: node.mesh.opacity for node in viewer.stage.obstacles}
    assert faded.pop("wall") == FADED
    assert set(faded.values()) == {None}
    with_wall(away)
    assert {node.mesh.opacity for node in viewer.stage.obstacles} == {None}


def test_a_body_before_the_handle_lets_the_mouse_through(viewer: Viewer, scene: Scene) -> None:
    """Browsers give a press to the first body that takes clicks, also where a handle is drawn over it."""
    eye = viewer.panel.looking.eye
    assert eye is not None
    ball = scene.obstacles[0]
    wall = Obstacle("wall", Box((0.3, 0.3, 0.3)), Pose(tuple((0.5 * (eye + ball.pose.position)).tolist())))
    walled = viewer.edited.changed(obstacles=(*scene.obstacles, wall))
    viewer.worker.ask("test", lambda: viewer.document.change(walled))

    def clicked() -> set[str]:
        viewer.worker.settle()
        return {node.obstacle.name for node in viewer.stage.obstacles if node.mesh._impl.click_cb}

    def ghosts() -> list[bool]:
        links = viewer.panel.looking._subject.ghosts
        return [bool(link.mesh._impl.click_cb) for link in links]

    every = clicked()
    assert every == {each.name for each in viewer.scene.obstacles}
    assert all(ghosts())
    for thing, through in ((Thing("obstacle", ball.name), {ball.name, "wall"}), (GOAL, set()), (None, set())):
        viewer.worker.ask("select", lambda thing=thing: viewer.panel.handles.select(thing))
        assert every - clicked() == through
        assert all(ghosts()) == (thing != GOAL)
        assert any(ghosts())


def test_a_window_is_reframed_until_its_camera_is_moved(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where a slow browser comes back to the first view, after it was turned to its own."""
    looking, begin = viewer.panel.looking, np.array(viewer.server.initial_camera.position)
    camera: Any = SimpleNamespace(position=begin, look_at=None, wxyz=np.array([1.0, 0.0, 0.0, 0.0]), fov=1.0)
    client: Any = SimpleNamespace(client_id=7, camera=camera, atomic=contextlib.nullcontext)
    monkeypatch.setattr(viewer.server, "get_clients", lambda: {7: client})

    def seen(width: int, eye: Any = None) -> Any:
        camera.image_width, camera.image_height, camera.aspect = width, 500, width / 500
        camera.position = camera.position if eye is None else eye
        looking._moved(client, camera)
        viewer.worker.settle()
        return camera.position

    seen(850)
    looking._ask(client, "best")
    viewer.worker.settle()
    np.testing.assert_array_equal(camera.position, looking.view("best", 1.7).eye)
    np.testing.assert_array_equal(seen(300, begin), looking.view("best", 0.6).eye)
    np.testing.assert_array_equal(seen(500), looking.view("best", 1.0).eye)
    own = np.array([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(seen(500, own), own)
    np.testing.assert_array_equal(seen(300), own)
