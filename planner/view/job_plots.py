"""The plots of a job: clearances and joints over its stages, which dots mark."""

from __future__ import annotations

import viser

from hdplan.planner.view.drawing.colors import MOTIONS
from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.page_script import Page
from hdplan.planner.view.player import Player
from hdplan.planner.view.time_plots import TimePlots
from hdplan.planner.view.worker import Worker


class JobPlots(TimePlots):
    """The plots, rebuilt where other joints move."""

    def __init__(self, server: viser.ViserServer, page: Page, worker: Worker, player: Player) -> None:
        """Start without any, in the container at hand."""
        super().__init__(server, page, worker, player, lambda: self.take(self._edited))
        self._folder = server.gui.add_folder("plots")
        self._names: tuple[str, ...] = ()
        self._edited: EditedJob | None = None

    def take(self, edited: EditedJob | None) -> None:
        """Show the curves of a job's motion, or none. By the worker's thread."""
        self._edited = edited
        if edited is None or edited.shown is None:
            self.clear()
            return
        robot, motion = edited.setup.robot, edited.shown.motion
        if robot.joint_names != self._names:
            self._names = robot.joint_names
            self._folder.remove()
            self._folder = self._server.gui.add_folder("plots")
            with self._folder:
                self.build(robot)
        self.set(motion, [(motion, MOTIONS[0])], edited.scene.planner.clearance, edited.setup)
