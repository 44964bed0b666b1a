"""Measures between two points of the scene: a click on a surface sets one, the next the other, a third starts over.

viser says along which ray somebody clicked, and the surfaces that are drawn are met here. Robots and obstacles count as
they stand at that moment; the measure stays where it was taken when they move.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import viser

from hdplan.planner.view.drawing.colors import INK
from hdplan.planner.view.drawing.labels import LABELS
from hdplan.planner.view.drawing.nodes import SEGMENT_WIDTH, RobotNodes
from hdplan.planner.view.drawing.rays import Surface, first_hit
from hdplan.planner.view.words import small
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

FIRST, SECOND = "click on a surface: the first point", "click on a surface: the second point"
NOTHING_THERE = "nothing is there: click on a surface"
POINT = 0.006  # [m] radius of a point


class Measuring:
    """The switch, the points, and what is between them."""

    def __init__(self, viewer: Viewer) -> None:
        """Build it in the container at hand."""
        self._viewer = viewer
        gui, scene = viewer.server.gui, viewer.server.scene
        self.switch = gui.add_checkbox("measure", False, hint="the distance between two clicked points")
        self.text = gui.add_html("")
        self._root = scene.add_frame("/measure", show_axes=False, visible=False)
        self._balls = [
            scene.add_icosphere(f"/measure/{name}", POINT, color=INK, visible=False) for name in ("one", "two")
        ]
        none = np.zeros((1, 2, 3), dtype=np.float32)
        self._line = scene.add_line_segments("/measure/line", none, INK, thickness=SEGMENT_WIDTH, visible=False)
        self._label = scene.add_label("/measure/label", "", visible=False, **LABELS)
        self.points: list[Array] = []
        self.switch.on_update(lambda event: viewer.worker.ask("measure points", self.begin) if event.client else None)
        scene.on_click()(self._clicked)

    @property
    def on(self) -> bool:
        """True if clicks set points."""
        return bool(self.switch.value)

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def begin(self) -> None:
        """Start a measurement, or end it."""
        self.points = []
        self._draw(FIRST if self.on else "")

    def take(self, origin: Array, direction: Array) -> None:
        """Set a point where a ray meets what is drawn."""
        if not self.on:
            return
        found = first_hit(origin, direction, self._surfaces())
        if found is None:
            self.text.content = small(NOTHING_THERE)
            return
        self.points = [*self.points, found] if len(self.points) == 1 else [found]
        if len(self.points) == 1:
            self._draw(SECOND)
            return
        x, y, z = (1e3 * (self.points[1] - self.points[0])).tolist()
        self._draw(f"{np.hypot(np.hypot(x, y), z):.1f} mm apart: x {x:+.1f}, y {y:+.1f}, z {z:+.1f} mm")

    def _draw(self, words: str) -> None:
        both = len(self.points) == 2
        with self._viewer.server.atomic():
            self._root.visible = bool(self.points)
            for number, ball in enumerate(self._balls):
                ball.visible = number < len(self.points)
                if ball.visible:
                    ball.position = self.points[number]
            self._line.visible = self._label.visible = both
            if both:
                self._line.points = np.array([self.points], dtype=np.float32)
                self._label.text = words.partition(" apart")[0]
                self._label.position = 0.5 * (self.points[0] + self.points[1])
            self.text.content = small(words)

    def _surfaces(self) -> Iterator[Surface]:
        """Return the visible surfaces: the robot and its ghosts, and the obstacles."""
        stage, panel = self._viewer.stage, self._viewer.panel
        robots: list[RobotNodes] = [stage.robot, stage.start, stage.goal]
        for robot in robots:
            for skin in [link.skin for link in robot.links] if robot.visible else ():
                yield skin.vertices, skin.triangles, robot.data.oMi[skin.joint].homogeneous
        for node in stage.obstacles if panel.layers.on("obstacles") else ():
            if node.frame.visible:
                yield node.mesh.vertices, node.mesh.faces, node.place

    def _clicked(self, event: viser.SceneClickEvent | Any) -> None:
        """Handle a browser's event."""
        if self.on:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            self._viewer.worker.ask("measure point", lambda: self.take(*ray))
