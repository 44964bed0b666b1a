"""A job in the browser's scene: the robot with all joints that move, objects that are carried, what is close.

All is called by the viewer's one thread.
"""

from __future__ import annotations

import viser

from hdplan.planner.certificate.verdict import Closest
from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.colors import clearance_colors
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.nodes import ClosestNodes, PathNode, RobotNodes
from hdplan.planner.view.drawing.shading import two_toned
from hdplan.planner.view.drawing.skins import shown_skins
from hdplan.planner.view.drawing.standing import Standing
from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.motion_nodes import verdict_color
from hdplan.scenes.array_types import Array


class JobStage:
    """The nodes of a job."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Start without anything to show."""
        self._server = server
        self._robots: dict[object, RobotNodes] = {}  # sent so far: fingers are planned joints in some scenes
        self.standing = Standing(server)
        self.closest = ClosestNodes(server)
        self._path: PathNode | None = None
        self._moves = False  # whether there is a motion, which has a path
        self.note = ""  # on what could not be drawn

    def take(self, edited: EditedJob) -> None:
        """Show another scene of the same robot, or another motion."""
        robot = edited.setup.robot
        key = robot.joint_names, tuple(sorted(robot.locked.items()))
        for nodes in self._robots.values():
            nodes.visible = False
        if key not in self._robots:
            skins, self.note = shown_skins(robot, edited.scene.robot)
            name = f"robot{len(self._robots)}"
            self._robots[key] = RobotNodes(self._server, name, robot, two_toned(robot, skins))
        self.robot = self._robots[key]
        self.robot.visible = True
        self.standing.take(edited.setup.scene.obstacles)
        self._draw_path(None if edited.shown is None else edited.shown.motion)

    def show(self, q: Array, seconds: float, pairs: tuple[Closest | None, Closest | None]) -> None:
        """Draw a moment: the robot at `q` (n,), what is carried, and the closest pairs."""
        self.robot.show(q)
        for node in self.standing.nodes:
            node.show(seconds)
        self.closest.show(pairs)

    def show_path(self, on: bool) -> None:
        """Show the path of the motion, if there is one, or hide it."""
        if self._path is not None:
            self._path.node.visible = on and self._moves

    def select(self, obstacle: str | None) -> None:
        """Show what is selected."""
        self.closest.labelled = obstacle is None
        for node in self.standing.nodes:
            node.select(node.obstacle.name == obstacle)

    @property
    def drawn(self) -> Robot:
        """The robot that is shown."""
        return self.robot.robot

    def _draw_path(self, motion: ShownMotion | None) -> None:
        self._moves = motion is not None
        if motion is None:
            return
        proven = motion.certificate.certified
        colors = clearance_colors(motion.clearance) if proven else verdict_color(motion.certificate)
        if self._path is None:
            self._path = PathNode(self._server, "path", motion.tip, colors)
        self._path.draw(motion.tip, colors)
