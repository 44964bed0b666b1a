"""Selecting and dragging in a job: objects, with all stages that lead to them, and places where they are left.

While something is dragged there is no motion, and no verdict; on release, the job is planned again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hdplan.planner.view.drawing.nodes import ObstacleNode
from hdplan.planner.view.edited_job import Movable
from hdplan.planner.view.grip import Grip
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
        self.dragging = False
        self.grip = Grip(viewer.server, viewer.worker, self)
        self.choice = viewer.server.gui.add_dropdown(
            "selected", (NOTHING,), hint="the object with the handle: objects move with the stages that lead there"
        )
        self.choice.on_update(lambda event: viewer.worker.ask("select", self._chosen) if event.client else None)
        viewer.stage.standing.on_click(
            lambda name, more: viewer.worker.ask("select", lambda: self.select_obstacle(name))
        )

    @property
    def thing(self) -> Movable | None:
        """The selected thing, as it is now."""
        return next((each for each in self._viewer.edited.movables if each.label == self._selected), None)

    @property
    def node(self) -> ObstacleNode | None:
        """The obstacle that is selected."""
        name = None if self.thing is None else self.thing.obstacle
        return next((node for node in self._viewer.stage.standing.nodes if node.obstacle.name == name), None)

    def deselect(self) -> None:
        """Select nothing. By any thread."""
        self._viewer.worker.ask("select", lambda: self.select(None))

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def select_obstacle(self, name: str) -> None:
        """Select what moves with an obstacle."""
        self.select(next((each for each in self._viewer.edited.movables if each.obstacle == name), None))

    def select(self, thing: Movable | None) -> None:
        """Select a thing, or nothing. What stands elsewhere later is shown where it is at first."""
        self._selected, self.dragging = None if thing is None else thing.label, False
        if thing is not None and thing.obstacle is not None:
            self._viewer.player.go_to(self._viewer.player.timeline.begin)
        self.update()

    def update(self) -> None:
        """Follow a change of the scene, but leave the handle to the hand that drags it."""
        edited, thing = self._viewer.edited, self.thing
        names = (NOTHING, *(each.label for each in edited.movables))
        if self.choice.options != names:
            self.choice.options = names
        self.choice.value = NOTHING if thing is None else thing.label
        self._viewer.stage.select(None if thing is None else thing.obstacle)
        if not self.dragging:
            if thing is None:
                self.grip.put(None)
            else:
                self.grip.put(edited.place_of(thing), edited.turns(thing))
            self._viewer.looking.fade()

    def let_go(self) -> None:
        """Plan again after a drag."""
        moved, self.dragging = self.dragging, False
        self.update()
        if moved:
            self._viewer.replan()

    def leave(self) -> None:
        """Take what is dragged out of the hand: its next movement is another step."""
        self.dragging = False

    def drag(self, pose: Pose) -> None:
        """Move what is selected to `pose`, as dragging does."""
        thing, first = self.thing, not self.dragging
        if thing is None:
            return
        edited = self._viewer.edited.dragged(thing, pose)
        self.dragging = True
        self._viewer.change(edited, step=first, by_hand=True)

    def _chosen(self) -> None:
        """Select what the list says."""
        self.select(next((each for each in self._viewer.edited.movables if each.label == self.choice.value), None))
