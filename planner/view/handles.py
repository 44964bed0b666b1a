"""Selecting and dragging: a click or the list selects, the selected thing gets a handle in the scene. A click with
shift or ctrl selects more obstacles: they go along with the last one, which has the handle.

Dragging a moving obstacle changes where it is at time 0; its motion from there stays the same. While something is
dragged, bodies, the current clearance and the contacts of start and goal are updated, and motions as `live` says;
everything is measured again when it is let go.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.grip import Grip
from hdplan.planner.view.things import Thing, dragged, place_of, things, turns
from hdplan.planner.view.words import small
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.poses import Pose

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

NOTHING = "nothing"


class Handles:
    """The selected thing and its handle."""

    def __init__(self, viewer: Viewer) -> None:
        """Select nothing; `build` builds the list."""
        self._viewer = viewer
        self.selected: Thing | None = None
        self.others: tuple[Thing, ...] = ()  # obstacles that are selected, too
        self.turn = 0  # how often another thing was selected
        self._begin: Edited | None = None  # what it was when dragging began
        self._moving = False  # whether the change under way is the hand's
        self.grip = Grip(viewer.server, viewer.worker, self)
        viewer.stage.on_click(lambda thing, more: viewer.worker.ask("select", lambda: self._clicked(thing, more)))

    def build(self) -> None:
        """Build the list in the container at hand."""
        viewer, gui = self._viewer, self._viewer.server.gui
        self.choice = gui.add_dropdown(
            "selected", (NOTHING, *map(str, things(viewer.edited))), hint="the object with a handle in the scene"
        )
        self._text = gui.add_html("")
        self.choice.on_update(lambda _: viewer.worker.ask("select", self._chosen))

    @property
    def dragging(self) -> bool:
        """True if something is being dragged."""
        return self._begin is not None

    @property
    def obstacles(self) -> tuple[str, ...]:
        """The names of all obstacles that are selected, the one with the handle last."""
        last = () if self.selected is None else (self.selected,)
        return tuple(each.name for each in (*self.others, *last) if each.kind == "obstacle")

    def deselect(self) -> None:
        """Select nothing. By any thread."""
        self._viewer.worker.ask("select", lambda: self.select(None))

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def select(self, thing: Thing | None, others: Sequence[Thing] = ()) -> None:
        """Select a thing, with other obstacles, or nothing; of a goal with poses of several links, the first."""
        every = things(self._viewer.edited)
        if thing is not None and thing not in every:
            alike = (each for each in every if each.kind == thing.kind and thing.kind != "obstacle")
            thing = next(alike, None)
        alone = thing is None or thing.kind != "obstacle"
        also = () if alone else tuple(each for each in others if each in every and each != thing)
        self.turn += (thing, also) != (self.selected, self.others)
        self.selected, self.others, self._begin = thing, also, None
        self._show()
        self.place()
        self._viewer.panel.player.draw()

    def select_all(self, names: Sequence[str], others: Sequence[str] = ()) -> None:
        """Select these obstacles, the last of which gets the handle, and others."""
        *more, last = (Thing("obstacle", name) for name in (*others, *names))
        self.select(last, more)

    def select_also(self, thing: Thing) -> None:
        """Select an obstacle beside those that are selected, or no more, if it is."""
        if thing.kind != "obstacle" or not self.obstacles:
            self.select(thing)
            return
        chosen = [Thing("obstacle", name) for name in self.obstacles]
        chosen = [each for each in chosen if each != thing] if thing in chosen else [*chosen, thing]
        self.select(chosen[-1] if chosen else None, chosen[:-1])

    def drag(self, pose: Pose) -> None:
        """Move what is selected to `pose`, as dragging does."""
        viewer = self._viewer
        if self.selected is None:
            return
        before, begin = viewer.edited, self._begin
        edited, words = dragged(before, self.selected, pose, viewer.stage.tip, begin, self.obstacles)
        self._begin, self._moving = begin or before, True  # what changes now leaves the handle to the hand
        try:
            viewer.document.change(edited, step=begin is None, check=viewer.panel.live.on)
        except HdplanError:
            self._begin = begin
            raise
        finally:
            self._moving = False
        self.grip.pose = place_of(edited, self.selected, viewer.stage.tip)
        self._say(words)
        viewer.panel.live.follow()

    def let_go(self) -> None:
        """Update everything after dragging."""
        self._begin = None
        self._viewer.document.measure()
        self._show()
        self.place()

    def update(self) -> None:
        """Follow a change of the scene: a removed thing is deselected and released, and so is one that another user
        moved. A thing that stays in its place stays in the hand, whose next movement is another step."""
        if self._moving:
            return
        dragging, self._begin = self.dragging, None
        every = things(self._viewer.edited)
        names = (NOTHING, *map(str, every))
        if self.choice.options != names:
            self.choice.options = names
        if self.selected is None or self.selected not in every:
            left = [each for each in self.others if each in every]
            self.select(left[-1] if left else None, left[:-1])
            return
        self.others = tuple(each for each in self.others if each in every)
        self._show()
        if not dragging or self.grip.pose != place_of(self._viewer.edited, self.selected, self._viewer.stage.tip):
            self.place()

    def _show(self) -> None:
        """Say what is selected, in the list, in the scene and in the fields."""
        self.choice.value = NOTHING if self.selected is None else str(self.selected)
        self._viewer.stage.highlight(self.selected, self.obstacles)
        self._viewer.panel.select(self.selected)

    def place(self) -> None:
        """Put a handle at the selected thing."""
        viewer, thing = self._viewer, self.selected
        if thing is None:
            self.grip.put(None)
            self._say("")
        else:
            if thing.kind == "obstacle" and viewer.edited.obstacle(thing.name).motion is not None:
                viewer.panel.player.go_to(viewer.panel.player.timeline.begin)
                self._say("the handle is at its pose at 0 s; its motion stays")
            self.grip.put(place_of(viewer.edited, thing, viewer.stage.tip), turns(viewer.edited, thing))
        viewer.panel.looking.fade()

    def _clicked(self, thing: Thing, more: bool) -> None:
        """Select what was clicked on in the scene, unless a click means a point to be measured."""
        if self._viewer.panel.measuring.on:
            return
        (self.select_also if more else self.select)(thing)

    def _chosen(self) -> None:
        """Select what the list says."""
        chosen = next((thing for thing in things(self._viewer.edited) if str(thing) == self.choice.value), None)
        if chosen != self.selected or self.grip.node is None:
            self.select(chosen)

    def _say(self, text: str) -> None:
        self._text.content = small(text)
