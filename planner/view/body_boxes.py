"""The layer of boxes: a box around each body into which the planner divides static obstacles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.collision.halfspace_bodies import from_obstacle
from hdplan.planner.geometry.drawn_shapes import boxes_mesh
from hdplan.planner.view.drawing.colors import OUTER
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer


class BoxLayer:
    """The boxes of one scene at a time, drawn when they are first shown; used by the viewer's one thread."""

    def __init__(self, viewer: Viewer) -> None:
        """Draw nothing yet."""
        self._viewer = viewer
        self._scene: Scene | None = None  # whose boxes are drawn
        self.node: Any = None

    def show(self, on: bool) -> None:
        """Show the boxes of the scene as it is now, or nothing."""
        scene = self._viewer.edited.read
        if on and scene is not self._scene:
            if self.node is not None:
                self.node.remove()
            self._scene, self.node = scene, self._drawn(scene)
        if self.node is not None:
            self.node.visible = on

    def _drawn(self, scene: Scene) -> Any:
        bodies = [body for each in scene.standing for body in from_obstacle(each, scene.planner.normals)[0]]
        if not bodies:
            return None
        half, frames = np.array([body.half_size for body in bodies]), np.array([body.box for body in bodies])
        corners, triangles = boxes_mesh(-half, half)
        placed = np.einsum("bij,bkj->bki", frames[:, :3, :3], corners.reshape(-1, 8, 3)) + frames[:, None, :3, 3]
        return self._viewer.server.scene.add_mesh_simple(
            "/boxes",
            placed.reshape(-1, 3).astype(np.float32),
            triangles.astype(np.uint32),
            color=OUTER,
            wireframe=True,
            cast_shadow=False,
            receive_shadow=False,
        )
