"""The handle in the browsers' scene, and the hand that pulls at it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import viser

from hdplan.planner.view.drawing.handle import add_handle, is_moved, pose_of
from hdplan.planner.view.worker import Worker
from hdplan.scenes.poses import Pose

if TYPE_CHECKING:
    from hdplan.planner.view.handles import Handles
    from hdplan.planner.view.job_handles import JobHandles


class Grip:
    """One handle at a time, in one browser's hand."""

    def __init__(self, server: viser.ViserServer, worker: Worker, owner: Handles | JobHandles) -> None:
        """Draw nothing yet; `owner` follows the handle, by the worker's thread."""
        self._server, self._worker, self._owner = server, worker, owner
        self.node: Any = None  # viser's, if something is selected
        self.pose: Pose | None = None  # where it was put
        self._count = 0  # nodes so far
        self._hand: int | None = None  # the browser that moved the handle last
        server.on_client_disconnect(lambda client: self.release() if client.client_id == self._hand else None)

    def put(self, pose: Pose | None, turning: bool = True) -> None:
        """Draw the handle at a pose, or none. Each is a node of another name: a browser would continue the last turn on
        a node of the same name. By the worker's thread."""
        if self.node is not None:
            self.node.remove()
            self.node = None
        self.pose = pose
        if pose is not None:
            self._count += 1
            self.node = add_handle(self._server, self._count, pose, turning)
            self.node.on_update(self.moved)

    def release(self) -> None:
        """Let go of what is dragged, if anything is. By any thread."""
        self._worker.ask("let go", self._owner.let_go)

    def moved(self, event: Any) -> None:
        """Handle a browser's event."""
        self._hand = event.client_id
        self._worker.ask("drag", lambda: self._follow(event.target))
        if event.phase == "end":
            self.release()

    def _follow(self, node: Any) -> None:
        """Let the selected thing follow; a handle that was taken away may still be in a hand elsewhere."""
        if node is not self.node or self.pose is None:
            return
        pose = pose_of(node)
        if self._owner.dragging or is_moved(pose, self.pose):
            self._owner.drag(pose)
