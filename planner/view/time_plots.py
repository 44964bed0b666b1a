"""The plots in the panel of either viewer: a bar in each follows the slider, a click seeks and a drag zooms."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import viser

from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.plots import MotionPlots
from hdplan.planner.view.page_script import Message, Page, is_number
from hdplan.planner.view.player import Player
from hdplan.planner.view.worker import Worker

EVERY = 0.1  # [s] between movements of the bars while the slider moves


class TimePlots:
    """The plots of a robot's motions, once they are built."""

    def __init__(
        self, server: viser.ViserServer, page: Page, worker: Worker, player: Player, show: Callable[[], None]
    ) -> None:
        """Start without any; `show` draws them again, by the worker's thread."""
        self._server, self._worker, self._player, self._show = server, worker, player, show
        self.drawn: MotionPlots | None = None
        self._followed = 0.0
        page.on("zoom", lambda _, message: self._zoom(message))
        page.on("seek", lambda _, message: self._seek(message))

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def build(self, robot: Robot) -> None:
        """Build the plots of a robot's joints in the container at hand."""
        self.drawn = MotionPlots(self._server, robot, lambda: self._worker.ask("plot", self._show))

    def set(
        self, active: ShownMotion, motions: Sequence[tuple[ShownMotion, Color]], required: float, setup: Setup
    ) -> None:
        """Show the active motion among others in their colours, as `MotionPlots.set`."""
        assert self.drawn is not None
        self.drawn.set(active, motions, required, setup, self._player.timeline, self._player.time)

    def clear(self) -> None:
        """Show nothing, as there is no motion."""
        if self.drawn is not None:
            self.drawn.clear()

    def outdate(self) -> None:
        """Say that the clearances are of an earlier scene."""
        if self.drawn is not None:
            self.drawn.outdate()

    def follow(self, now: float) -> None:
        """Move the bars."""
        if self.drawn is not None and (time.perf_counter() - self._followed > EVERY or not self._player.playing):
            self.drawn.follow(now)
            self._followed = time.perf_counter()

    # --- what browsers ask for ------------------------------------------------------------------------------------

    def _zoom(self, message: Message) -> None:
        """Zoom to a part of what is shown, from one share of it to another."""
        first, last, drawn = message.get("from"), message.get("to"), self.drawn
        if drawn is not None and is_number(first) and is_number(last):
            self._worker.ask("zoom", lambda: drawn.zoom(first, last))

    def _seek(self, message: Message) -> None:
        """Show the moment at a share of what is shown."""
        share = message.get("share")
        if self.drawn is not None and is_number(share):
            begin, end = self.drawn.view
            self._player.go_to(begin + min(max(share, 0.0), 1.0) * (end - begin))
