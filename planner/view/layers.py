"""The layers that can be switched on and off: the scene, and the bodies of planner and certificate.

Outer bodies and collision meshes are made when they are first shown, as fitting takes time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdplan.planner.certificate.verdict import Closest
from hdplan.planner.view.body_boxes import BoxLayer
from hdplan.planner.view.drawing.colors import COLLISION, OUTER
from hdplan.planner.view.drawing.nodes import RobotNodes
from hdplan.planner.view.drawing.skins import collision_skins, outer_skins
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.marks import Frames, Names, Trail
from hdplan.planner.view.planes import PlaneLayer
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.proof.reading import ReadProof
    from hdplan.planner.view.viewer import Viewer


OPACITY = 0.45  # [–] of the robots that are drawn on request
PLANE, LEFT_OUT, BOXES = "separating plane", "points left out", "boxes of obstacles"
TRAIL, FRAMES, NAMES = "trail", "frames of joints", "names of obstacles"
HEIGHT, CLEARANCE = "height", "clearance"
COLORED = "colours of clouds: height, or the approximate distance of the active motion from each point"
LAYERS = {  # name: initially on, description
    "robot": (True, "visual meshes, as the URDF names them"),
    "obstacles": (True, "in their true shapes"),
    "start and goal": (True, "ghosts in their collision meshes; links in contact are dark red"),
    "path": (True, "the tip's path, coloured by clearance"),
    "closest pair": (True, "a segment between the points at which robot and obstacles, and links, are closest"),
    "outer bodies": (False, "the links as the planner sees them (scene: planner.link_bodies)"),
    "collision meshes": (False, "the links as the certificate sees them"),
    PLANE: (False, "proves the closest pair apart on this part of the motion; its thickness is the proven distance"),
    LEFT_OUT: (False, "points of clouds that are the robot's own image, or that of another obstacle (scene: ignore)"),
    BOXES: (False, "the planner's boxes around parts of static obstacles: cells of clouds, pieces of meshes"),
    TRAIL: (False, "the robot, transparent, at equal steps along the active motion"),
    FRAMES: (False, "x red, y green, z blue, and the axis about or along which each joint moves, dark"),
    NAMES: (False, "a label above each obstacle"),
}


class Layers:
    """Check boxes, and the two robots that are shown only on request."""

    def __init__(self, viewer: Viewer, handles: Handles) -> None:
        """Build the boxes in the container at hand."""
        self._viewer, self._handles = viewer, handles
        self._boxes = {name: viewer.server.gui.add_checkbox(name, on, hint=hint) for name, (on, hint) in LAYERS.items()}
        for box in self._boxes.values():
            box.on_update(lambda _: viewer.worker.ask("layers", self._switch))
        self._color = viewer.server.gui.add_dropdown("colour of points", (HEIGHT, CLEARANCE), hint=COLORED)
        self._color.on_update(lambda _: viewer.worker.ask("layers", self._switch))
        self.bodies: dict[str, RobotNodes] = {}  # those that were requested
        self.plane, self.boxes = PlaneLayer(viewer), BoxLayer(viewer)
        self.trail, self.frames, self.names = Trail(viewer), Frames(viewer.server), Names(viewer.server)

    def on(self, name: str) -> bool:
        """True if a layer is visible."""
        return bool(self._boxes[name].value)

    def toggle(self, name: str) -> None:
        """Switch a layer on or off."""
        self.set(name, not self.on(name))

    def set(self, name: str, on: bool) -> None:
        """Switch a layer."""
        self._boxes[name].value = on

    def show_proof(self, proof: ReadProof) -> None:
        """Switch on the planes of a proof, which is about the active motion."""
        self.plane.take(proof)
        self.set(PLANE, True)
        self._switch()

    def show(self, q: Array) -> None:
        """Move the bodies that are on to configuration `q` (n,)."""
        for name, nodes in self.bodies.items():
            if self.on(name):
                nodes.show(q)
        self.boxes.show(self.on(BOXES))
        self.trail.show(self.on(TRAIL))
        viewer = self._viewer
        self.frames.show(self.on(FRAMES), viewer.robot, q)
        self.names.show(self.on(NAMES) and self.on("obstacles"), viewer.stage.obstacles)
        clouds, active = viewer.stage.clouds, viewer.motions.active
        self._color.visible = bool(clouds)
        by_clearance = self._color.value == CLEARANCE and active is not None
        for cloud in () if self._handles.dragging else clouds:
            cloud.color(viewer.robot, active.motion if by_clearance and active is not None else None)

    def show_plane(self, parameter: float, pairs: tuple[Closest | None, Closest | None], reported: bool) -> None:
        """Show the plane between the closest pair at a parameter of the active motion, unless it is where a robot
        reports itself."""
        self.plane.show(self.on(PLANE) and not reported, parameter, pairs)

    def _switch(self) -> None:
        viewer = self._viewer
        stage = viewer.stage
        stage.robot.visible = self.on("robot")
        viewer.paint()
        stage.standing.root.visible = self.on("obstacles")
        stage.closest.root.visible = self.on("closest pair")
        if stage.left_out is not None:
            stage.left_out.visible = self.on(LEFT_OUT)
        for name in ("outer bodies", "collision meshes"):
            if self.on(name) and name not in self.bodies:
                self.bodies[name] = self._made(name)
            if name in self.bodies:
                self.bodies[name].visible = self.on(name)
        viewer.panel.player.draw()  # ghosts, other robots and newly shown layers are placed there

    def _made(self, name: str) -> RobotNodes:
        viewer = self._viewer
        if name == "outer bodies":
            skins, color = outer_skins(viewer.robot, viewer.scene.planner.link_bodies), OUTER
        else:
            skins, color = collision_skins(viewer.robot), COLLISION
        node = name.replace(" ", "_")
        return RobotNodes(viewer.server, node, viewer.robot, skins, color=color, opacity=OPACITY)
