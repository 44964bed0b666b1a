"""The layers of a job that can be switched on and off."""

from __future__ import annotations

from collections.abc import Callable

import viser

from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.colors import COLLISION
from hdplan.planner.view.drawing.nodes import RobotNodes
from hdplan.planner.view.drawing.skins import collision_skins
from hdplan.planner.view.job_stage import JobStage
from hdplan.planner.view.layers import FRAMES, OPACITY
from hdplan.planner.view.marks import Frames, Names
from hdplan.planner.view.worker import Worker
from hdplan.scenes.array_types import Array

COLLISIONS, NAMES = "collision meshes", "names of objects"
LAYERS = {  # name: initially on, description
    "robot": (True, "visual meshes, as the URDF names them"),
    "objects": (True, "in their true shapes"),
    "path": (True, "the tip's path, coloured by clearance"),
    "closest pair": (True, "a segment between the points at which robot and objects, and links, are closest"),
    COLLISIONS: (False, "the links as the certificate sees them"),
    FRAMES: (False, "x red, y green, z blue, and the axis about or along which each joint moves, dark"),
    NAMES: (False, "a label above each object"),
}


class JobLayers:
    """Check boxes, and what is shown only on request."""

    def __init__(self, server: viser.ViserServer, worker: Worker, stage: JobStage, draw: Callable[[], None]) -> None:
        """Build the boxes in the container at hand; `draw` has the moment drawn again."""
        self._server, self._stage = server, stage
        self._boxes = {name: server.gui.add_checkbox(name, on, hint=hint) for name, (on, hint) in LAYERS.items()}
        for box in self._boxes.values():
            box.on_update(lambda _: worker.ask("layers", draw))
        self._frames, self._names = Frames(server), Names(server)
        self._collisions: tuple[Robot, RobotNodes] | None = None

    def on(self, name: str) -> bool:
        """True if a layer is visible."""
        return bool(self._boxes[name].value)

    def set(self, name: str, on: bool) -> None:
        """Switch a layer."""
        self._boxes[name].value = on

    def show(self, q: Array) -> None:
        """Show what is on at configuration `q` (n,), and nothing else. By the worker's thread."""
        stage, robot = self._stage, self._stage.drawn
        stage.robot.visible = self.on("robot")
        stage.standing.root.visible = self.on("objects")
        stage.closest.root.visible = self.on("closest pair")
        stage.show_path(self.on("path"))
        self._frames.show(self.on(FRAMES), robot, q)
        self._names.show(self.on(NAMES) and self.on("objects"), stage.standing.nodes)
        if self._collisions is not None and (self._collisions[0] is not robot or not self.on(COLLISIONS)):
            self._collisions[1].remove()
            self._collisions = None
        if self.on(COLLISIONS):
            if self._collisions is None:
                skins = collision_skins(robot)
                nodes = RobotNodes(self._server, "collisions", robot, skins, color=COLLISION, opacity=OPACITY)
                self._collisions = robot, nodes
            self._collisions[1].show(q)
