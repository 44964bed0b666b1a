"""The motions in the scene: a path and a robot for each. The active one's path is coloured by its clearance, the others
are thin and in their own colours, and their robots are seen through.

All is called by the viewer's one thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.document import Document
from hdplan.planner.view.drawing.colors import CONTACT, START, clearance_colors
from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.nodes import PATH_WIDTH, PathNode, RobotNodes
from hdplan.planner.view.drawing.skins import INSET, Skin
from hdplan.planner.view.motions import Shown
from hdplan.planner.view.words import SHORT
from hdplan.scenes.array_types import Array

FAINT: Color = (140, 140, 140)  # of a path of which nothing is known
THIN_PATH = 0.5 * PATH_WIDTH  # [m] of the path of a motion that is not the active one
THROUGH = 0.4  # opacity of the robots of motions that are not the active one
# [rad] or [m] within which two robots stand in each other's place, where their surfaces would flicker
SAME_PLACE = 1e-3


class Look(NamedTuple):
    """Look of a path."""

    colors: NDArray[np.uint8] | Color  # along it (K, 3), or of all of it
    means: str  # what one colour of all of it means; "" for clearances
    wide: bool


@dataclass(eq=False)
class Drawn:
    """The nodes of a motion, and the look in which its path was sent last."""

    robot: RobotNodes
    path: PathNode
    sent: tuple[ShownMotion, str, bool, Color] | None = None


class MotionNodes:
    """The nodes of all motions, by their numbers."""

    def __init__(self, server: viser.ViserServer, robot: Robot, skins: Sequence[Skin], document: Document) -> None:
        """Start without any; `skins` are what robots are shown in that are seen through."""
        self._server, self._robot, self._document = server, robot, document
        self._skins = [skin for skin in skins if skin.joint]
        self._sent = 0  # nodes so far: an undo sends a motion's again
        self._drawn: dict[int, Drawn] = {}

    def of(self, shown: Shown) -> Drawn:
        """Return the nodes of a motion, which are sent if they are not there."""
        if shown.number not in self._drawn:
            self._sent += 1
            name = f"robot{self._sent}"
            robot = RobotNodes(
                self._server,
                name,
                self._robot,
                self._skins,
                color=shown.color,
                opacity=THROUGH,
                visible=False,
                inset=3.0 * INSET,
            )
            path = PathNode(self._server, f"path/{self._sent}", shown.motion.tip, FAINT)
            self._drawn[shown.number] = Drawn(robot, path)
        return self._drawn[shown.number]

    def show(self, parameter_of: Callable[[Curve], float], q: Array, seen: bool = True, reported: bool = False) -> None:
        """Show the other motions' robots where they are, if they are `seen`: `parameter_of` a curve says where. The
        robot itself is at `q` (n,), where the active motion is unless it has `reported` itself: what would stand in its
        place is not drawn."""
        motions = self._document.motions
        for shown in motions.shown:
            curve, robot = shown.motion.curve, self.of(shown).robot
            at = curve.at_parameter(parameter_of(curve))
            apart = (reported or shown is not motions.active) and bool(np.abs(at - q).max() > SAME_PLACE)
            robot.visible = apart and shown.visible and seen
            if robot.visible:
                robot.show(at)

    def paint(self, seen: bool) -> None:
        """Draw the paths, if they are `seen`, as `look_of` says, and the robots of motions that fail; take away what is
        gone."""
        there = self._document.motions.shown
        for number in self._drawn.keys() - {shown.number for shown in there}:
            gone = self._drawn.pop(number)
            gone.robot.remove()
            gone.path.node.remove()
        for shown in there:
            self._paint(shown, self.of(shown), seen)

    def look_of(self, shown: Shown) -> Look:
        """Return the look of a motion's path: the active one by its clearance, the others thin and in their own
        colours; one of which nothing is known grey, and one that fails in the colour of its verdict."""
        motion, active = shown.motion, shown is self._document.motions.active
        if not self._document.holds(shown):
            return Look(FAINT, "not checked in this scene yet", active)
        if not motion.certificate.certified:
            return Look(verdict_color(motion.certificate), SHORT[motion.certificate.status], active)
        if not active:
            return Look(shown.color, "certified", active)
        if motion.measured:
            return Look(clearance_colors(motion.clearance), "", active)
        return Look(START, "certified, measured when you let go", active)

    def _paint(self, shown: Shown, drawn: Drawn, seen: bool) -> None:
        look, motion = self.look_of(shown), shown.motion
        fails = self._document.holds(shown) and not motion.certificate.certified
        color = verdict_color(motion.certificate) if fails else shown.color
        if drawn.sent != (sent := (motion, look.means, look.wide, color)):  # a path is long
            drawn.path.draw(motion.tip, look.colors, PATH_WIDTH if look.wide else THIN_PATH)
            drawn.robot.paint(color)
            drawn.sent = sent
        drawn.path.node.visible = shown.visible and seen


def verdict_color(certificate: Certificate) -> Color:
    """Return the colour of a whole motion: certified, in contact or too close, or something else."""
    if certificate.certified:
        return START
    return CONTACT if certificate.status in (Status.IN_CONTACT, Status.TOO_CLOSE, Status.NOT_PROVEN) else FAINT
