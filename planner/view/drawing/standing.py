"""The nodes of a scene's obstacles: known ones are moved, new ones are sent."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import viser

from hdplan.planner.view.drawing.clouds import CloudNode
from hdplan.planner.view.drawing.nodes import ObstacleNode
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.obstacles import Obstacle


class Standing:
    """All obstacles; called by the viewer's one thread."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Start without any."""
        self._server = server
        self.root = server.scene.add_frame("/obstacles", show_axes=False)
        self._chosen: Callable[[str, bool], object] | None = None
        self._sent = 0  # each has a node's name of its own
        self.nodes: list[ObstacleNode] = []

    def take(self, obstacles: Sequence[Obstacle]) -> None:
        """Show these, and no others."""
        before = {node.obstacle.name: node for node in self.nodes}
        after = [self._node(before, obstacle) for obstacle in obstacles]
        for left in before.values():
            left.frame.remove()
        self.nodes = after

    def on_click(self, chosen: Callable[[str, bool], object]) -> None:
        """Name the listener to clicks: it gets the name of what was clicked, and whether shift or ctrl was held."""
        self._chosen = chosen
        for node in self.nodes:
            node.listen(chosen)

    def _node(self, before: dict[str, ObstacleNode], obstacle: Obstacle) -> ObstacleNode:
        """Take an obstacle's node out of those before, or send another one."""
        node = before.get(obstacle.name)
        if node is not None and node.obstacle.shape == obstacle.shape:
            before.pop(obstacle.name)
            node.take(obstacle)
            return node
        self._sent += 1
        kind = CloudNode if isinstance(obstacle.shape, Cloud) else ObstacleNode
        node = kind(self._server, self._sent, obstacle)
        if self._chosen is not None:
            node.listen(self._chosen)
        return node
