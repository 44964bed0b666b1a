"""The panel beside the scene: the verdict, the player, what is closest, and the tabs, each a part of its own."""

from __future__ import annotations

import html
import time
from typing import TYPE_CHECKING

import viser

from hdplan.planner.certificate.verdict import Closest
from hdplan.planner.view.drawing.colors import CONTACT, START, hex_of, legend
from hdplan.planner.view.drawing.plots import MotionPlots, joint_table
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.planner.view.editing import Editing
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.jogging import Jogging
from hdplan.planner.view.keys import Keys
from hdplan.planner.view.layers import Layers
from hdplan.planner.view.live import Live
from hdplan.planner.view.looking import Looking
from hdplan.planner.view.motions import Shown
from hdplan.planner.view.obstacle_fields import ObstacleFields
from hdplan.planner.view.opening import Opening
from hdplan.planner.view.planning import Planning
from hdplan.planner.view.player import Player
from hdplan.planner.view.saving import Saving
from hdplan.planner.view.settings import Settings
from hdplan.planner.view.things import Thing
from hdplan.planner.view.words import OUTDATED, clearance_words, coloured, contact_words, small
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

PLOT_EVERY = 0.1  # [s] between movements of the plots' bars while the slider moves


class Panel:
    """Its parts, and what they say of the scene and its motions."""

    def __init__(self, viewer: Viewer, note: str) -> None:
        """Build it; `note` is said below the verdict."""
        self._viewer, self._note = viewer, note
        gui = viewer.server.gui
        self._verdict = gui.add_html("")
        self.live = Live(viewer)
        self.player = Player(viewer.server, viewer.worker, viewer.draw)
        self._clearance = gui.add_html("")
        self.looking = Looking(viewer)
        self._legend = gui.add_html(legend())
        self.choice = gui.add_dropdown("motion", ("none",), hint="whose joints, clearance and closest pair")
        self.choice.on_update(lambda event: viewer.worker.ask("choice", self._choose) if event.client else None)
        self.editing = Editing(viewer)
        self.tabs = gui.add_tab_group()
        self._plot_tab = self.tabs.add_tab("Plots", viser.Icon.CHART_LINE)
        with self.tabs.add_tab("Joints", viser.Icon.ROBOT):
            self._table = gui.add_html("")
            self.jogging = Jogging(viewer, self.editing)
        with self.tabs.add_tab("Scene", viser.Icon.CUBE):
            self.handles = Handles(viewer)
            self.obstacles = ObstacleFields(viewer, self.editing)
            self.opening = Opening(viewer, self.editing)
            self.saving = Saving(viewer)
        with self.tabs.add_tab("Plan", viser.Icon.ROUTE):
            self.planning = Planning(viewer)
            self.settings = Settings(viewer, self.editing)
        with self.tabs.add_tab("Layers", viser.Icon.STACK_2):
            self.layers = Layers(viewer)
        self.keys = Keys(viewer)
        self._plots: MotionPlots | None = None
        self._plotted: tuple[str, ...] = ()  # the motions that it has
        self._followed = 0.0

    @property
    def verdict(self) -> str:
        """What is written at the top, as HTML."""
        return str(self._verdict.content)

    @property
    def clearance(self) -> str:
        """What is written of the closest pairs, as HTML."""
        return str(self._clearance.content)

    def end(self) -> None:
        """End the threads of its parts."""
        self.editing.end()
        self.live.end()
        self.planning.end()
        self.layers.plane.end()
        self.player.end()

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def update(self) -> None:
        """Show the values of the scene as it is now."""
        if not self.handles.dragging:
            self.handles.update()
        self.obstacles.update()
        self.jogging.update()
        self.settings.update()

    def select(self, thing: Thing | None) -> None:
        """Show the values of what is selected now."""
        self.obstacles.update()
        self.jogging.follow(thing)

    def list_motions(self) -> None:
        """Offer the motions that there are now."""
        names = tuple(shown.motion.name for shown in self._viewer.motions.shown)
        active = self._viewer.motions.active
        if active is None:
            return
        if self.choice.options != names:
            self.choice.options = names
        if self.choice.value != active.motion.name:
            self.choice.value = active.motion.name
        self.choice.visible = len(names) > 1
        if self._plotted != names:
            if self._plots is not None:
                self._plots.remove()
            with self._plot_tab:
                self._plots = MotionPlots(self._viewer.server, self._viewer.robot.joint_names, names)
            self._plotted = names

    def plot(self, timeline: Timeline) -> None:
        """Draw the curves of the motions."""
        motions = self._viewer.motions
        if motions.active is not None and self._plots is not None:
            all_of_them = [shown.motion for shown in motions.shown]
            self._plots.set(motions.active.motion, all_of_them, timeline, self.player.time)

    def outdate(self) -> None:
        """Withdraw what was said of a scene that has changed."""
        if self._plots is not None:
            self._plots.outdate()
        self.planning.outdate()

    def follow(self, now: float, q: Array, pairs: tuple[Closest | None, Closest | None]) -> None:
        """Say what holds at a moment: of a robot at `q` (n,)."""
        robot = self._viewer.robot
        self._clearance.content = clearance_words(self.player.timeline.words(now), pairs)
        self._table.content = joint_table(robot.joint_names, q, robot.lower, robot.upper)
        if self._plots is not None and (time.perf_counter() - self._followed > PLOT_EVERY or not self.player.playing):
            self._plots.follow(now)
            self._followed = time.perf_counter()

    def say(self) -> None:
        """Say what holds of the ends and the motions."""
        viewer = self._viewer
        lines = [
            coloured(f"{name} is in collision: {contact_words(contacts)}", CONTACT)
            for name, contacts in zip(("start", "goal"), viewer.edited.contacts, strict=True)
            if contacts
        ]
        lines += [self._line(shown) for shown in viewer.motions.shown]
        if not viewer.motions.shown:
            lines.append("no motion yet: press Plan")
        lines += [html.escape(self._note)] if self._note else []
        self._verdict.content = small("<br/>".join(lines), 0.85)

    def complain(self, error: Exception) -> None:
        """Say an error in place of the verdict."""
        self._verdict.content = coloured(str(error), CONTACT)

    def _line(self, shown: Shown) -> str:
        """What is known of one motion."""
        motion, several = shown.motion, len(self._viewer.motions.shown) > 1
        mark = f'<span style="color:{hex_of(shown.color) if shown.color else "#dddddd"}">●</span> ' if several else ""
        extent = "" if motion.curve.times is None else f" ({motion.trajectory.extent})"
        name = f"<b>{html.escape(motion.name)}</b>{extent} " if several else ""
        tint = START if motion.certificate.certified else CONTACT
        said = coloured(motion.certificate.text, tint) if self._viewer.motions.holds(shown) else OUTDATED
        if not motion.certificate.certified and shown.origin is not self._viewer.scene:
            said = f"of an older scene: {said}"
        return f"{mark}{name}{said}"

    def _choose(self) -> None:
        self._viewer.choose(str(self.choice.value))
