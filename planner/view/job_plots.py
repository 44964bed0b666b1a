"""The plots of a job: clearances and joints over its stages, which dots mark."""

from __future__ import annotations

import time
from collections.abc import Sequence

import viser

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.pictures.quantities import Rate, rates
from hdplan.planner.view.drawing.colors import MOTIONS
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.plots import MotionPlots
from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.page_script import Message, Page, is_number
from hdplan.planner.view.player import Player
from hdplan.planner.view.worker import Worker

EVERY = 0.1  # [s] between movements of the bars while the slider moves


class JobPlots:
    """The plots, rebuilt where other joints move."""

    def __init__(self, server: viser.ViserServer, page: Page, worker: Worker, player: Player) -> None:
        """Start without any, in the container at hand."""
        self._server, self._worker, self._player = server, worker, player
        self._folder = server.gui.add_folder("plots")
        self._names: tuple[str, ...] = ()
        self._plots: MotionPlots | None = None
        self._edited: EditedJob | None = None
        self._followed = 0.0
        page.on("zoom", lambda _, message: self._zoom(message))
        page.on("seek", lambda _, message: self._seek(message))

    def take(self, edited: EditedJob) -> None:
        """Show the curves of a job's motion, or none. By the worker's thread."""
        self._edited = edited
        if edited.shown is None:
            if self._plots is not None:
                self._plots.clear()
            return
        names = edited.setup.robot.joint_names
        if self._plots is None or names != self._names:
            self._folder.remove()
            self._folder = self._server.gui.add_folder("plots")
            with self._folder:
                self._plots = MotionPlots(self._server, edited.setup.robot, self._replot)
            self._names = names
        motion, required = edited.shown.motion, edited.scene.planner.clearance
        seen = [(motion, MOTIONS[0])]
        self._plots.set(motion, seen, required, self._rates, self._player.timeline, self._player.time)

    def follow(self, now: float) -> None:
        """Move the bars. By the worker's thread."""
        if self._plots is not None and (time.perf_counter() - self._followed > EVERY or not self._player.playing):
            self._plots.follow(now)
            self._followed = time.perf_counter()

    def _rates(self, motion: ShownMotion) -> Sequence[Rate]:
        assert self._edited is not None
        setup = self._edited.setup
        robot = setup.robot
        return rates(motion.trajectory.of_joints(robot.joint_names, robot.locked), Certifier(setup).limits)

    def _replot(self) -> None:
        self._worker.ask("plot", lambda: self.take(self._edited) if self._edited is not None else None)

    def _zoom(self, message: Message) -> None:
        first, last, plots = message.get("from"), message.get("to"), self._plots
        if plots is not None and is_number(first) and is_number(last):
            self._worker.ask("zoom", lambda: plots.zoom(first, last))

    def _seek(self, message: Message) -> None:
        share = message.get("share")
        if self._plots is not None and is_number(share):
            begin, end = self._plots.view
            self._player.go_to(begin + min(max(share, 0.0), 1.0) * (end - begin))
