"""Selecting and dragging: a click or the list selects, the selected thing gets a handle in the scene.

Dragging a moving obstacle changes where it is at time 0; its motion from there stays the same. While something is
dragged, bodies, the current clearance and the contacts of start and goal are updated, and motions as `live` says;
everything is measured again when it is let go.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hdplan.planner.view.drawing.nodes import pose_of
from hdplan.planner.view.edited import Edited
from hdplan.planner.view.things import Thing, dragged, obstacle_of, place_of, things, turns
from hdplan.planner.view.words import small
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.poses import Pose

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

NOTHING = "nothing"
SIZE = 90.0  # [px] of the handle, however far away it is


class Handles:
    """What is selected, and its handle."""

    def __init__(self, viewer: Viewer) -> None:
        """Build the list in the container at hand."""
        self._viewer = viewer
        self.selected: Thing | None = None
        self._begin: Edited | None = None  # what it was when dragging began
        self.choice = viewer.server.gui.add_dropdown(
            "selected", (NOTHING, *map(str, things(viewer.edited))), hint="what gets a handle in the scene"
        )
        self._said = viewer.server.gui.add_html("")
        self._handle: Any = None
        self._handles = 0  # so far
        self.choice.on_update(lambda _: viewer.worker.ask("select", self._chosen))
        viewer.stage.on_click(lambda thing: viewer.worker.ask("select", lambda: self.select(thing)))

    @property
    def dragging(self) -> bool:
        """Whether something is being dragged."""
        return self._begin is not None

    def release(self) -> None:
        """Let go of what is dragged, if anything is: its browser may be gone. By any thread."""
        self._viewer.worker.ask("let go", self.let_go)

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def select(self, thing: Thing | None) -> None:
        """Select a thing, or nothing; of a goal with poses of several links, the first."""
        if thing is not None:
            every = things(self._viewer.edited)
            thing = thing if thing in every else next((each for each in every if each.kind == thing.kind), None)
        self.selected = thing
        name = NOTHING if thing is None else str(thing)
        if self.choice.value != name:
            self.choice.value = name
        self._viewer.stage.highlight(thing)
        self._viewer.panel.select(thing)
        self.place()
        self._viewer.panel.player.draw()

    def drag(self, pose: Pose) -> None:
        """Move what is selected to `pose`, as dragging does."""
        viewer = self._viewer
        if self.selected is None:
            return
        before, begin = viewer.edited, self._begin
        edited, words = dragged(before, self.selected, pose, viewer.stage.tip, begin)
        self._begin = begin or before  # what changes now leaves the handle to the hand
        try:
            viewer.change(edited, step=begin is None, check=viewer.panel.live.on)
        except HdplanError:
            self._begin = begin
            raise
        self._say(words)
        viewer.panel.live.follow()

    def let_go(self) -> None:
        """Update everything after dragging."""
        self._begin = None
        self._viewer.measure()
        self.place()

    def update(self) -> None:
        """List what there is to select now, after a change of the scene other than by dragging."""
        names = (NOTHING, *map(str, things(self._viewer.edited)))
        if self.choice.options != names:
            self.choice.options = names
            self.select(self.selected if self.selected in things(self._viewer.edited) else None)
        else:
            self.place()

    def place(self) -> None:
        """Put a handle where the selected thing is. Each is a node of another name: a browser goes on turning one of
        the same name as it turned the last."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        viewer, thing = self._viewer, self.selected
        if thing is None:
            self._say("")
            return
        if thing.kind == "obstacle" and obstacle_of(viewer.edited, thing).motion is not None:
            viewer.panel.player.go_to(viewer.panel.player.timeline.begin)
            self._say("its handle is where it is at 0 s; it moves on as before")
        pose = place_of(viewer.edited, thing, viewer.stage.tip)
        x, y, z, w = pose.quaternion_xyzw
        self._handles += 1
        self._handle = viewer.server.scene.add_transform_controls(
            f"/handle/{self._handles}",
            scale=SIZE,
            fixed=True,
            line_width=4.0,
            position=pose.position,
            wxyz=(w, x, y, z),
            depth_test=False,
            disable_rotations=not turns(viewer.edited, thing),
        )
        self._handle.on_update(self._dragged)

    def _chosen(self) -> None:
        """Select what the list says."""
        chosen = next((thing for thing in things(self._viewer.edited) if str(thing) == self.choice.value), None)
        if chosen != self.selected or self._handle is None:
            self.select(chosen)

    def _dragged(self, event: Any) -> None:
        """Handle a browser's event."""
        self._viewer.worker.ask("drag", lambda: self.drag(pose_of(event.target)))
        if event.phase == "end":
            self.release()

    def _say(self, text: str) -> None:
        self._said.content = small(text)
