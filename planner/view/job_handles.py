"""Selecting and dragging in a job: objects, with all stages that lead to them, and places where they are left.

While something is dragged there is no motion, and no verdict; on release, the job is planned again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hdplan.planner.view.drawing.handle import add_handle, is_moved, pose_of
from hdplan.planner.view.drawing.nodes import ObstacleNode
from hdplan.planner.view.edited_job import Movable
from hdplan.planner.view.handles import NOTHING
from hdplan.scenes.poses import Pose

if TYPE_CHECKING:
    from hdplan.planner.view.job_viewer import JobViewer


class JobHandles:
    """The selected thing and its handle."""

    def __init__(self, viewer: JobViewer) -> None:
        """Build the list in the container at hand."""
        self._viewer = viewer
        self._selected: str | None = None  # its label: things are others after each change
        self._dragging = False
        self._hand: int | None = None  # the browser that moved the handle last
        self._handle: Any = None
        self._handles = 0  # so far
        self.choice = viewer.server.gui.add_dropdown(
            "selected", (NOTHING,), hint="the object with the handle: objects move with the stages that lead there"
        )
        self.choice.on_update(lambda event: viewer.worker.ask("select", self._chosen) if event.client else None)
        viewer.stage.standing.on_click(
            lambda name, more: viewer.worker.ask("select", lambda: self.select_obstacle(name))
        )
        viewer.server.on_client_disconnect(lambda client: self.left(client.client_id))

    @property
    def thing(self) -> Movable | None:
        """The selected thing, as it is now."""
        return next((each for each in self._viewer.edited.movables if each.label == self._selected), None)

    @property
    def node(self) -> ObstacleNode | None:
        """The obstacle that is selected."""
        name = None if self.thing is None else self.thing.obstacle
        return next((node for node in self._viewer.stage.standing.nodes if node.obstacle.name == name), None)

    def release(self) -> None:
        """Let go of what is dragged, if anything is. By any thread."""
        self._viewer.worker.ask("let go", self.let_go)

    def left(self, browser: int) -> None:
        """Let go of what a browser drags that is gone. By any thread."""
        if browser == self._hand:
            self.release()

    def deselect(self) -> None:
        """Select nothing. By any thread."""
        self._viewer.worker.ask("select", lambda: self.select(None))

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def select_obstacle(self, name: str) -> None:
        """Select what moves with an obstacle."""
        self.select(next((each for each in self._viewer.edited.movables if each.obstacle == name), None))

    def select(self, thing: Movable | None) -> None:
        """Select a thing, or nothing. What stands elsewhere later is shown where it is at first."""
        self._selected, self._dragging = None if thing is None else thing.label, False
        if thing is not None and thing.obstacle is not None:
            self._viewer.player.go_to(self._viewer.player.timeline.begin)
        self.update()

    def update(self) -> None:
        """Follow a change of the scene, but leave the handle to the hand that drags it."""
        things = self._viewer.edited.movables
        names = (NOTHING, *(each.label for each in things))
        if self.choice.options != names:
            self.choice.options = names
        thing = self.thing
        name = NOTHING if thing is None else thing.label
        self.choice.value = name
        self._viewer.stage.select(None if thing is None else thing.obstacle)
        if not self._dragging:
            self._place(thing)

    def let_go(self) -> None:
        """Plan again after a drag."""
        moved, self._dragging = self._dragging, False
        self.update()
        if moved:
            self._viewer.replan()

    def leave(self) -> None:
        """Take what is dragged out of the hand: its next movement is another step."""
        self._dragging = False

    def drag(self, pose: Pose) -> None:
        """Move what is selected to `pose`, as dragging does."""
        thing, first = self.thing, not self._dragging
        if thing is None:
            return
        edited = self._viewer.edited.dragged(thing, pose)
        self._dragging = True
        self._viewer.change(edited, step=first, by_hand=True)

    def _place(self, thing: Movable | None) -> None:
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        if thing is not None:
            edited = self._viewer.edited
            self._handles += 1
            self._handle = add_handle(self._viewer.server, self._handles, edited.place_of(thing), edited.turns(thing))
            self._handle.on_update(self._dragged)
        self._viewer.looking.fade()

    def _chosen(self) -> None:
        """Select what the list says."""
        self.select(next((each for each in self._viewer.edited.movables if each.label == self.choice.value), None))

    def _dragged(self, event: Any) -> None:
        """Handle a browser's event."""
        self._hand = event.client_id
        self._viewer.worker.ask("drag", lambda: self._follow(event.target))
        if event.phase == "end":
            self.release()

    def _follow(self, handle: Any) -> None:
        """Let the selected thing follow its handle; one that was taken away may still be in a hand elsewhere."""
        thing = self.thing
        if handle is self._handle and thing is not None:
            pose = pose_of(handle)
            if self._dragging or is_moved(pose, self._viewer.edited.place_of(thing)):
                self.drag(pose)
