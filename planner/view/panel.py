"""The panel beside the scene: Plan and Play, what to do next, a line for each motion, what is closest, and the tabs,
each a part of its own."""

from __future__ import annotations

import html
import math
import time
from typing import TYPE_CHECKING

import viser

from hdplan.planner.certificate.verdict import Closest
from hdplan.planner.view.drawing.colors import legend
from hdplan.planner.view.drawing.plots import MotionPlots, joint_table
from hdplan.planner.view.drawing.skins import Color
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.layers import Layers
from hdplan.planner.view.live import Live
from hdplan.planner.view.looking import Looking
from hdplan.planner.view.page import Page
from hdplan.planner.view.planning import Planning
from hdplan.planner.view.player import Player
from hdplan.planner.view.rows import Rows
from hdplan.planner.view.saving import Saving
from hdplan.planner.view.words import clearance_words, small, whats_next
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

PLOT_EVERY = 0.1  # [s] between movements of the plots' bars while the slider moves


class Panel:
    """Its parts, and what they say of the scene and its motions."""

    def __init__(self, viewer: Viewer, note: str) -> None:
        """Build it; `note` is said among the layers. What comes first stays in sight (`page`)."""
        self._viewer = viewer
        gui = viewer.server.gui
        self.page = Page(viewer.server, viewer.scene.name, viewer.scene.robot.base.position)
        self.planning = Planning(viewer)
        self.player = Player(viewer.server, viewer.worker, viewer.draw)
        self._next = gui.add_html("")
        self.rows = Rows(viewer, self.page)
        self._clearance = gui.add_html("")
        self.live = Live(viewer)
        self.looking = Looking(viewer)
        self._legend = gui.add_html(legend())
        self.tabs = gui.add_tab_group()
        self._plot_tab = self.tabs.add_tab("Plots", viser.Icon.CHART_LINE)
        with self.tabs.add_tab("Joints", viser.Icon.ROBOT):
            self._table = gui.add_html("")
        with self.tabs.add_tab("Plan", viser.Icon.ROUTE):
            self.handles = Handles(viewer)
            self.planning.build()
            self.saving = Saving(viewer)
        with self.tabs.add_tab("Layers", viser.Icon.STACK_2):
            self.player.build_speed(viewer.server)
            self.layers = Layers(viewer)
            gui.add_html(small(html.escape(note)))
        self._plots: MotionPlots | None = None
        self._plotted: tuple[tuple[str, Color], ...] = ()  # the motions that it has
        self._followed = 0.0
        self.page.on("seek", lambda _, told: self._seek(told.get("share")))

    @property
    def verdict(self) -> str:
        """What is written of the scene and its motions, as HTML."""
        return str(self._next.content) + self.rows.content

    @property
    def clearance(self) -> str:
        """What is written of the closest pairs, as HTML."""
        return str(self._clearance.content)

    def end(self) -> None:
        """End the threads of its parts."""
        self.live.end()
        self.planning.end()
        self.layers.plane.end()
        self.player.end()

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def plot(self, timeline: Timeline) -> None:
        """Draw the curves of the motions that are shown, and those of the active one."""
        viewer, active = self._viewer, self._viewer.motions.active
        motions = [shown for shown in viewer.motions.shown if shown.visible or shown is active]
        plotted = tuple((shown.motion.name, shown.color) for shown in motions)
        if self._plotted != plotted:
            if self._plots is not None:
                self._plots.remove()
                self._plots = None
            if plotted:
                with self._plot_tab:
                    self._plots = MotionPlots(viewer.server, viewer.robot.joint_names, plotted)
            self._plotted = plotted
        if active is not None and self._plots is not None:
            required, _ = viewer.certifier.asked(active.motion.curve)
            curves = [shown.motion for shown in motions]
            self._plots.set(active.motion, curves, required, timeline, self.player.time)

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
        """Say what holds of the motions, and what to do next."""
        viewer, active = self._viewer, self._viewer.motions.active
        self.rows.say()
        if active is None:
            words = whats_next(viewer.edited, None)
        else:
            stopped = active.result is not None and active.result is self.planning.stopped
            words = whats_next(viewer.edited, active.motion, active.result, stopped)
        self.say_next(words)

    def say_next(self, words: str, bad: bool = False) -> None:
        """Say what is to be done or known now, in the two lines that are reserved for it."""
        said = html.escape(words)
        tint = " hd-bad" if bad else ""
        content = f'<div class="hd hd-two{tint}" title="{said}">{said}</div>'
        if self._next.content != content:
            self._next.content = content

    def complain(self, error: Exception) -> None:
        """Say an error."""
        self.say_next(str(error), bad=True)

    def _seek(self, share: object) -> None:
        """Show the moment at a share of the timeline."""
        if isinstance(share, int | float) and math.isfinite(share):
            timeline = self.player.timeline
            self.player.go_to(timeline.begin + min(max(share, 0.0), 1.0) * (timeline.end - timeline.begin))
