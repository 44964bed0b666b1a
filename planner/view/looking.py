"""Where browsers look from: what is of interest is in the picture when they come and at the press of a button, and
obstacles between the eye and it fade.

Every browser has a camera of its own; obstacles fade for the one that moved last.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
import viser

from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.camera import FOV, SIDES, Boxes, View, best_view, view_from
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

BEST = "best"
ASPECT = 1.2  # of the picture, of a browser of which it is not known yet
POSTURES = 7  # of the robot along a motion
SPARSE = 25  # points of a path, at most, that are looked for behind obstacles
SURROUNDINGS = 3.0  # times its size, of an obstacle that is looked at
STEEPEST = 0.499 * np.pi  # [rad] from the horizon: straight down, up would be any direction
LEAST_EYE_MOTION = 1e-3  # [m] that an eye moves at least
RESIZED = 0.02  # by which a picture's aspect changes at least


class Looking:
    """The cameras, and the buttons that set them."""

    def __init__(self, viewer: Viewer) -> None:
        """Build the buttons in the container at hand."""
        self._viewer = viewer
        self._outline = Outline(viewer.robot)
        self._set: dict[int, tuple[str, float, Array]] = {}  # by browser: its view, for which aspect, and the eye
        self.eye: Array | None = None  # of the browser that moved last
        server = viewer.server
        self.buttons = server.gui.add_button_group("look from", (BEST, *SIDES))
        self.buttons.on_click(self._pressed)
        server.on_client_connect(self._came)
        server.on_client_disconnect(lambda client: self._set.pop(client.client_id, None))

    def begin(self) -> None:
        """Set where browsers look from when they come. By the worker's thread."""
        view, camera = self.view(BEST, ASPECT), self._viewer.server.initial_camera
        camera.fov = FOV
        camera.position, camera.look_at = view.eye, view.target
        self.eye = view.eye
        self.fade()

    def view(self, name: str, aspect: float) -> View:
        """Return the best view, or one of SIDES, for a picture of some width by its height."""
        whole = np.concatenate([self._outline.at(q) for q in self._postures()]).reshape(-1, 3)
        path = self._path()
        if name in SIDES:
            return view_from(*SIDES[name], np.concatenate([whole, path]), aspect)
        return best_view(whole, self._interest(), path, self._boxes(), aspect)

    def frame(self, client: Any) -> None:
        """Have a browser look at what is selected, from the side from which it looks; at everything, if nothing is. By
        any thread."""
        if client is not None:
            aspect = client.camera.aspect
            self._turned(client, lambda: self._look_at_selected(client, aspect))

    def fade(self) -> None:
        """Let obstacles fade that hide what is of interest, and no others. By the worker's thread."""
        if self.eye is None:
            return
        hidden = self._boxes().in_the_way(self.eye, self._interest())
        for node, faded in zip(self._viewer.stage.obstacles, hidden.tolist(), strict=True):
            node.fade(faded)

    def _postures(self) -> Array:
        """Configurations (k, n) of the robot at both ends and along the motions."""
        viewer = self._viewer
        along = [shown.motion.joints for shown in viewer.motions.shown]
        few = [joints[np.linspace(0, len(joints) - 1, POSTURES).astype(int)] for joints in along]
        return np.concatenate([[viewer.edited.start], [viewer.edited.goal], *few])

    def _path(self) -> Array:
        """The paths of the motions, one after the other; without any, the straight motion's (k, 3)."""
        viewer = self._viewer
        found = [shown.motion.tip for shown in viewer.motions.shown]
        if not found:
            steps = np.linspace(0.0, 1.0, SPARSE)[:, None]
            found = [viewer.stage.tip.path((1.0 - steps) * viewer.edited.start + steps * viewer.edited.goal)]
        return np.concatenate(found)

    def _interest(self) -> Array:
        """What obstacles should not hide: the links at both ends and along the motions, and the paths."""
        links = [self._outline.middles(q) for q in self._postures()]
        path = self._path()
        return np.concatenate([*links, path[:: max(1, len(path) // SPARSE)]])

    def _boxes(self) -> Boxes:
        nodes = self._viewer.stage.obstacles
        return Boxes.around([node.parts for node in nodes], [node.place for node in nodes])

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
        """Have the worker turn a browser's camera, if it is still there then."""
        number, clients = client.client_id, self._viewer.server.get_clients
        self._viewer.worker.ask(f"look of {number}", lambda: turn() if number in clients() else None)

    def _look_at_selected(self, client: viser.ClientHandle, aspect: float) -> None:
        viewer, thing = self._viewer, self._viewer.panel.handles.selected
        if thing is None:
            self._look(client, BEST, aspect)
            return
        if thing.kind == "obstacle":
            node = next(node for node in viewer.stage.obstacles if node.obstacle.name == thing.name)
            low, high = node.bounds
            corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
            points = SURROUNDINGS * (corners - corners.mean(axis=0)) + corners.mean(axis=0)
            points = points @ node.place[:3, :3].T + node.place[:3, 3]
        else:
            points = self._outline.at(viewer.edited.start if thing.kind == "start" else viewer.edited.goal)
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
        if abs(camera.aspect - aspect) > RESIZED * aspect and np.abs(eye - set_to).max() < LEAST_EYE_MOTION:
            self._ask(client, name)  # as it stands where it was set to: frame it anew
        if self.eye is None or np.abs(eye - self.eye).max() > LEAST_EYE_MOTION:
            self.eye = eye
            self._viewer.worker.ask("fade", self.fade)


def _turn(client: viser.ClientHandle, view: View) -> None:
    with client.atomic():
        client.camera.position = view.eye  # takes its target along
        client.camera.look_at = view.target


class Outline:
    """The boxes around a robot's bodies."""

    def __init__(self, robot: Robot) -> None:
        """Bound its collision geometry."""
        self._robot, self._data = robot, robot.model.createData()
        signs = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
        self._boxes = []
        for item in robot.collision.geometryObjects:
            item.geometry.computeLocalAABB()
            box, place = item.geometry.aabb_local, item.placement
            corners = np.where(signs, box.max_, box.min_) @ place.rotation.T + place.translation
            self._boxes.append((int(item.parentJoint), corners))

    def at(self, q: Array) -> Array:
        """Return their corners (g, 8, 3) in the world at configuration `q` (n,)."""
        pin.forwardKinematics(self._robot.model, self._data, self._robot.pin_q(q))
        places = self._data.oMi
        return np.array(
            [corners @ places[joint].rotation.T + places[joint].translation for joint, corners in self._boxes]
        )

    def middles(self, q: Array) -> Array:
        """Return the middles (m, 3) of those that move."""
        moving = [joint > 0 for joint, _ in self._boxes]
        return np.asarray(self.at(q)[moving].mean(axis=1))
