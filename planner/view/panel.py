"""The panel beside the scene: Plan and Play, what to do next, a line for each motion, what is closest, and the tabs,
each a part of its own."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

from hdplan.planner.certificate.verdict import Closest
from hdplan.planner.view.drawing.colors import clearance_legend, color_legend
from hdplan.planner.view.drawing.ground import ground_of
from hdplan.planner.view.drawing.plots import joint_table
from hdplan.planner.view.edit_steps import Editing
from hdplan.planner.view.end_fields import EndFields
from hdplan.planner.view.exports import Exports
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.in_view import InView
from hdplan.planner.view.jogging import Jogging
from hdplan.planner.view.keys import Keys, keys_of
from hdplan.planner.view.layers import Layers
from hdplan.planner.view.live import Live
from hdplan.planner.view.looking import Looking
from hdplan.planner.view.measuring import Measuring
from hdplan.planner.view.obstacle_fields import ObstacleFields
from hdplan.planner.view.opening import Opening
from hdplan.planner.view.page_script import Page
from hdplan.planner.view.planning import Planning
from hdplan.planner.view.player import Player
from hdplan.planner.view.reported import Report
from hdplan.planner.view.rows import Rows
from hdplan.planner.view.saving import Saving
from hdplan.planner.view.settings import Settings
from hdplan.planner.view.things import Thing
from hdplan.planner.view.time_plots import TimePlots
from hdplan.planner.view.tree import Tree
from hdplan.planner.view.uploads import LONGEST_NAME, check_size
from hdplan.planner.view.words import OUTDATED, badge, clearance_words, next_words, small, tip_words, whats_next
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

EXPONENT = "numbers are written without an exponent here, as 0.001 or 1000000"


class Panel:
    """The parts of the panel, and what they say of the scene and its motions."""

    def __init__(self, viewer: Viewer, note: str) -> None:
        """Build it; `note` is shown among the layers. What comes first stays in sight (`page`)."""
        self._viewer = viewer
        gui = viewer.server.gui
        ground = ground_of(viewer.robot, viewer.scene.robot, viewer.edited.read.obstacles)
        self.handles = Handles(viewer)
        self.page = Page(viewer.server, viewer.gate, viewer.scene.name, ground)
        self.planning = Planning(viewer)
        self.player = Player(viewer.server, viewer.worker, viewer.draw)
        self._next, self._badge = gui.add_html(""), gui.add_html("")
        self.rows = Rows(viewer, self.page)
        self.clearance = gui.add_html("")
        self.live = Live(viewer, self.handles)
        self.looking = Looking(viewer.server, viewer.worker, InView(viewer, self.handles))
        self.legend = gui.add_html("")
        self.page.build()
        self.plots = TimePlots(viewer.server, self.page, viewer.worker, self.player, self.plot)
        self.editing = Editing(viewer, self.handles)
        self.tabs = gui.add_tab_group()
        with self.tabs.add_tab("Plots"):
            self.plots.build(viewer.robot)
        with self.tabs.add_tab("Joints"):
            self._table = gui.add_html("")
            self.jogging = Jogging(viewer, self.editing)
        with self.tabs.add_tab("Scene"):
            self.handles.build()
            self.tree = Tree(viewer, self.page, self.editing, self.handles)
            self.obstacles = ObstacleFields(viewer, self.editing, self.handles)
            self.ends = EndFields(viewer, self.editing, self.handles)
            self.measuring = Measuring(viewer)
            self.opening = Opening(viewer, self.editing)
            self.saving = Saving(viewer)
            self.exports = Exports(viewer, self.saving)
        with self.tabs.add_tab("Plan"):
            self.planning.build()
            self.settings = Settings(viewer, self.editing)
        with self.tabs.add_tab("Layers"):
            self.player.build_speed(viewer.server)
            self.layers = Layers(viewer, self.handles)
            gui.add_html(small(html.escape(note)))
        self.keys = Keys(viewer.server, keys_of(self))
        self.page.on(
            "paste", lambda _, message: self.editing.do(lambda: self.obstacles.paste(str(message.get("text"))))
        )
        self.page.on("enter", lambda *_: self.editing.enter())
        self.page.on("exponent", lambda *_: self.editing.refuse(EXPONENT))
        self.page.on("too large", lambda _, message: self._refuse(message.get("name"), message.get("size")))

    @property
    def verdict(self) -> str:
        """The text on the scene and its motions, as HTML."""
        return str(self._next.content) + str(self._badge.content) + str(self.rows.html.content)

    def end(self) -> None:
        """End the threads of its parts."""
        self.editing.end()
        self.live.end()
        self.planning.end()
        self.exports.end()
        self.layers.plane.end()
        self.player.end()

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def update(self) -> None:
        """Show the values of the scene as it is now."""
        self.handles.update()
        self.show_values()

    def show_values(self) -> None:
        """Show the values of the scene in all fields but those in which somebody types."""
        self.tree.update()
        self.obstacles.update()
        self.ends.update()
        self.jogging.update()
        self.settings.update()

    def select(self, thing: Thing | None) -> None:
        """Show the values of what is selected now, and have its text at hand to be copied."""
        self.tree.update()
        self.obstacles.update()
        self.ends.update()
        self.page.copied(self.obstacles.text)
        self.jogging.follow(thing)

    def plot(self) -> None:
        """Draw the curves of the motions that are shown, and those of the active one."""
        viewer, active = self._viewer, self._viewer.motions.active
        if active is None:
            self.plots.clear()
            return
        required, _ = viewer.certifier.required(active.motion.curve)
        seen = [(shown.motion, shown.color) for shown in viewer.motions.shown if shown.visible or shown is active]
        self.plots.set(active.motion, seen, required, viewer.edited.setup)

    def outdate(self) -> None:
        """Withdraw the words about a scene that has changed."""
        self.plots.outdate()
        self.planning.outdate()
        self.editing.say("")

    def follow(
        self, now: float, q: Array, pairs: tuple[Closest | None, Closest | None], report: Report | None = None
    ) -> None:
        """Show the clearances at a moment, or of a `report`, of a robot at `q` (n,)."""
        robot = self._viewer.robot
        whose = "" if report is None else f'<div class="hd">{report.words}:</div>'
        self.clearance.content = whose + clearance_words(self.player.timeline.words(now), pairs)
        tip = tip_words(self._viewer.stage.tip.placement(q))
        self._table.content = joint_table(robot.joint_names, q, robot.lower, robot.upper) + tip
        self.plots.follow(now)

    def say(self) -> None:
        """Show the verdicts on the motions, and what to do next."""
        viewer, active = self._viewer, self._viewer.motions.active
        self.rows.say()
        self._say_colors()
        self._say_badge()
        self.saving.outdate()
        if active is None:
            words = whats_next(viewer.edited, None)
        else:
            stopped = active.result is not None and active.result is self.planning.stopped
            words = whats_next(viewer.edited, active.motion, active.result, stopped)
            if words == OUTDATED and active.misfit:
                words = f"{active.motion.name}: {active.misfit}: press Plan"
        self.say_next(words)

    def _say_colors(self) -> None:
        """Show the legend of the active motion's colours."""
        motions = self._viewer.motions
        content = ""
        if motions.active is not None:
            colors, means, _ = self._viewer.motion_nodes.look_of(motions.active)
            content = color_legend(colors, html.escape(means)) if isinstance(colors, tuple) else clearance_legend()
        self.legend.content = content

    def _say_badge(self) -> None:
        """Show the verdict in the scene."""
        viewer, active = self._viewer, self._viewer.motions.active
        holds = active is not None and viewer.document.holds(active)
        self._badge.content = badge(viewer.edited, None if active is None else active.motion, holds)

    def say_next(self, words: str, bad: bool = False) -> None:
        """Show what to do or know now, in the two lines that are reserved for it."""
        self._next.content = next_words(words, bad)

    def take_back(self) -> None:
        """Withdraw the words about the motions and of a moment: something failed."""
        self.clearance.content = ""
        self.outdate()
        self.rows.say()
        self._say_colors()
        self._say_badge()
        self.say_next(OUTDATED)

    def _refuse(self, name: object, size: object) -> None:
        """Say that a file is too large to be sent."""
        if isinstance(size, int | float):
            self.editing.do(lambda: check_size(str(name)[:LONGEST_NAME], size))
