"""The browsers' cameras: the subject is in the picture when they connect and at the press of a button, and
obstacles between the eye and it fade.

Every browser has a camera of its own; obstacles fade, and words make room for each other, for the one that moved
last.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import viser

from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.camera import FOV, SIDES, Boxes, View, best_view, view_from
from hdplan.planner.view.drawing.handle import handle_points
from hdplan.planner.view.drawing.labels import Label, Picture, arrange
from hdplan.planner.view.drawing.nodes import LinkNode, ObstacleNode
from hdplan.planner.view.drawing.outline import Outline
from hdplan.planner.view.worker import Worker
from hdplan.scenes.array_types import Array
from hdplan.scenes.poses import Pose

BEST = "best"
ASPECT = 1.2  # of the picture, of a browser of which it is not known yet
SPARSE = 25  # points of a path, at most, that are looked for behind obstacles
SURROUNDINGS = 3.0  # times its size: what is shown around a framed obstacle
STEEPEST = 0.499 * np.pi  # [rad] from the horizon: straight down, up would be any direction
LEAST_EYE_MOTION = 1e-3  # [m] that an eye moves at least
RESIZED = 0.02  # by which a picture's aspect changes at least


class Subject(Protocol):
    """The subject of the cameras, as it is now."""

    @property
    def robot(self) -> Robot:
        """The robot."""

    @property
    def obstacles(self) -> Sequence[ObstacleNode]:
        """Obstacles, which may stand between the eye and the robot."""

    @property
    def ghosts(self) -> Sequence[LinkNode]:
        """Links that can be clicked, and may stand between the eye and the handle."""

    def postures(self) -> Array:
        """Return configurations (k, n) of the robot that belong in the picture."""

    def paths(self) -> Array:
        """Return points (k, 3) along which the robot moves."""

    def selected(self) -> ObstacleNode | Array | None:
        """Return the selection: an obstacle, or the robot in a configuration (n,)."""

    def handle(self) -> Pose | None:
        """Return the pose of the handle; None: there is none."""

    def words(self) -> Sequence[Label]:
        """Return the labels that are not to lie over each other."""


class Looking:
    """The cameras, and the buttons that set them."""

    def __init__(self, server: viser.ViserServer, worker: Worker, subject: Subject) -> None:
        """Build the buttons in the container at hand."""
        self._server, self._worker, self._subject = server, worker, subject
        self._outline_of: tuple[Robot, Outline] | None = None
        self._set: dict[int, tuple[str, float, Array]] = {}  # by browser: its view, for which aspect, and the eye
        self.eye: Array | None = None  # of the browser that moved last
        self._picture: Picture | None = None  # its
        self.buttons = server.gui.add_button_group("look from", (BEST, *SIDES))
        self.buttons.on_click(self._pressed)
        server.on_client_connect(self._came)
        server.on_client_disconnect(lambda client: self._set.pop(client.client_id, None))

    def begin(self) -> None:
        """Set where browsers look from when they come. By the worker's thread."""
        view, camera = self.view(BEST, ASPECT), self._server.initial_camera
        camera.fov = FOV
        camera.position, camera.look_at = view.eye, view.target
        self.eye = view.eye
        self.fade()

    def view(self, name: str, aspect: float) -> View:
        """Return the best view, or one of SIDES, for a picture of some width by its height."""
        whole = np.concatenate([self._outline.at(q) for q in self._subject.postures()]).reshape(-1, 3)
        path = self._subject.paths()
        if name in SIDES:
            return view_from(*SIDES[name], np.concatenate([whole, path]), aspect)
        interest = self._interest(self._outline.middles)  # not all over the links: many views are compared
        return best_view(whole, interest, path, boxes_around(self._subject.obstacles), aspect)

    def frame(self, client: Any) -> None:
        """Let a browser look at what is selected, from the side from which it looks; at everything, if nothing is. By
        any thread."""
        if client is not None:
            aspect = client.camera.aspect
            self._turned(client, lambda: self._look_at_selected(client, aspect))

    def fade(self) -> None:
        """Let obstacles fade that hide what is of interest, and no others, and the mouse through bodies that are before
        the handle. By the worker's thread."""
        if self.eye is None:
            return
        obstacles, ghosts = self._subject.obstacles, self._subject.ghosts
        boxes = boxes_around(obstacles)
        hidden = boxes.in_the_way(self.eye, self._interest(self._outline.inside))
        for node, faded in zip(obstacles, hidden.tolist(), strict=True):
            node.fade(faded)
        pose = self._subject.handle()
        handle = np.empty((0, 3)) if pose is None else handle_points(pose, self.eye)
        covers = [*boxes.before(self.eye, handle).tolist(), *boxes_around(ghosts).before(self.eye, handle).tolist()]
        bodies: list[ObstacleNode | LinkNode] = [*obstacles, *ghosts]
        for body, covered in zip(bodies, covers, strict=True):
            body.clicks.let_through(covered)

    def arrange(self) -> None:
        """Let no label lie over another. By the worker's thread."""
        if self._picture is not None:
            arrange(self._subject.words(), self._picture)

    @property
    def _outline(self) -> Outline:
        """The outline of the robot as it is now."""
        robot = self._subject.robot
        if self._outline_of is None or self._outline_of[0] is not robot:
            self._outline_of = robot, Outline(robot)
        return self._outline_of[1]

    def _interest(self, points_of: Callable[[Array], Array]) -> Array:
        """Points that obstacles should not hide: those of the links at both ends and along the motions, and the
        paths."""
        links = [points_of(q) for q in self._subject.postures()]
        path = self._subject.paths()
        return np.concatenate([*links, path[:: max(1, len(path) // SPARSE)]])

    # --- what browsers ask for ------------------------------------------------------------------------------------

    def _came(self, client: viser.ClientHandle) -> None:
        client.camera.on_update(lambda camera: self._moved(client, camera))
        self._ask(client, BEST)

    def _pressed(self, event: Any) -> None:
        if event.client is not None:
            self._ask(event.client, str(event.target.value))

    def _ask(self, client: viser.ClientHandle, name: str) -> None:
        aspect = client.camera.aspect  # now: a later message may be an earlier one's echo
        if name in (BEST, *SIDES):  # a browser may send anything
            self._turned(client, lambda: self._look(client, name, aspect))

    def _turned(self, client: viser.ClientHandle, turn: Callable[[], None]) -> None:
        """Let the worker turn a browser's camera, if it is still there then."""
        number, clients = client.client_id, self._server.get_clients
        self._worker.ask(f"look of {number}", lambda: turn() if number in clients() else None)

    def _look_at_selected(self, client: viser.ClientHandle, aspect: float) -> None:
        thing = self._subject.selected()
        if thing is None:
            self._look(client, BEST, aspect)
            return
        if isinstance(thing, ObstacleNode):
            low, high = thing.bounds
            corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
            points = SURROUNDINGS * (corners - corners.mean(axis=0)) + corners.mean(axis=0)
            points = points @ thing.place[:3, :3].T + thing.place[:3, 3]
        else:
            points = self._outline.at(thing)
        x, y, z = np.array(client.camera.position) - client.camera.look_at
        elevation = float(np.clip(np.arctan2(z, np.hypot(x, y)), -STEEPEST, STEEPEST))
        _turn(client, view_from(float(np.arctan2(y, x)), elevation, points.reshape(-1, 3), aspect))

    def _look(self, client: viser.ClientHandle, name: str, aspect: float) -> None:
        view = self.view(name, aspect)
        self._set[client.client_id] = name, aspect, view.eye
        _turn(client, view)

    def _moved(self, client: viser.ClientHandle, camera: viser.CameraHandle) -> None:
        eye = np.array(camera.position)
        name, aspect, set_to = self._set.get(client.client_id, (BEST, camera.aspect, eye))
        begin = np.array(self._server.initial_camera.position)  # a browser that is slow goes back there once more
        if _same(eye, set_to) and abs(camera.aspect - aspect) > RESIZED * aspect:
            self._ask(client, name)  # the camera stands where it was set: frame it again
        elif _same(eye, begin) and not _same(set_to, begin):
            self._ask(client, name)
        self._picture = Picture.of(camera)
        self._worker.ask("labels", self.arrange)
        if self.eye is None or not _same(eye, self.eye):
            self.eye = eye
            self._worker.ask("fade", self.fade)


def boxes_around(bodies: Sequence[ObstacleNode] | Sequence[LinkNode]) -> Boxes:
    """Return the boxes around bodies, where they are drawn."""
    return Boxes.around([body.parts for body in bodies], [body.place for body in bodies])


def _same(eye: Array, other: Array) -> bool:
    """True if an eye has not moved from one place (3,) to the other."""
    return bool(np.abs(eye - other).max() < LEAST_EYE_MOTION)


def _turn(client: viser.ClientHandle, view: View) -> None:
    with client.atomic():
        client.camera.position = view.eye  # takes its target along
        client.camera.look_at = view.target
