"""The subject of the cameras in a scene with its motions: the robot at both ends and on its way, and the paths."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.labels import Label
from hdplan.planner.view.drawing.motion import few_of
from hdplan.planner.view.drawing.nodes import LinkNode, ObstacleNode
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.looking import SPARSE
from hdplan.planner.view.things import place_of
from hdplan.scenes.array_types import Array
from hdplan.scenes.poses import Pose

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer


class InView:
    """The scene of a viewer, for its cameras."""

    def __init__(self, viewer: Viewer, handles: Handles) -> None:
        """Take its viewer, and its selection."""
        self._viewer, self._handles = viewer, handles

    @property
    def robot(self) -> Robot:
        """The scene's robot."""
        return self._viewer.robot

    @property
    def obstacles(self) -> list[ObstacleNode]:
        """The scene's obstacles."""
        return self._viewer.stage.obstacles

    @property
    def ghosts(self) -> list[LinkNode]:
        """The links of the robot at start and goal."""
        return [*self._viewer.stage.start.links, *self._viewer.stage.goal.links]

    def postures(self) -> Array:
        """Return configurations (k, n) of the robot at both ends and along the motions."""
        viewer = self._viewer
        along = [few_of(shown.motion.joints) for shown in viewer.motions.shown]
        return np.concatenate([[viewer.edited.start], [viewer.edited.goal], *along])

    def paths(self) -> Array:
        """Return the paths of the motions, one after the other; without any, the straight motion's (k, 3)."""
        viewer = self._viewer
        found = [shown.motion.tip for shown in viewer.motions.shown]
        if not found:
            steps = np.linspace(0.0, 1.0, SPARSE)[:, None]
            found = [viewer.stage.tip.path((1.0 - steps) * viewer.edited.start + steps * viewer.edited.goal)]
        return np.concatenate(found)

    def selected(self) -> ObstacleNode | Array | None:
        """Return the selection: an obstacle, or the robot at its start or goal (n,)."""
        viewer, thing = self._viewer, self._handles.selected
        if thing is None:
            return None
        if thing.kind == "obstacle":
            return next(node for node in self.obstacles if node.obstacle.name == thing.name)
        return viewer.edited.start if thing.kind == "start" else viewer.edited.goal

    def handle(self) -> Pose | None:
        """Return the pose of the handle; None: there is none."""
        viewer, thing = self._viewer, self._handles.selected
        return None if thing is None else place_of(viewer.edited, thing, viewer.stage.tip)

    def words(self) -> tuple[Label, ...]:
        """Return the labels that are not to lie over each other."""
        return self._viewer.stage.words
