"""The motions that are shown: each with its verdict, the scene that this is of, its colour, its robot and its path.

All is called by the viewer's one thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.result import PlanResult
from hdplan.planner.view.drawing.colors import CONTACT, OTHERS, START, clearance_colors
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.nodes import RobotNodes, draw_path
from hdplan.planner.view.drawing.skins import Color, Skin
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

FAINT: Color = (190, 190, 190)


@dataclass(eq=False)
class Shown:
    """A motion with its nodes in the scene."""

    motion: ShownMotion
    color: Color | None  # of its robot; None: the robot's own
    robot: RobotNodes
    path: Any  # viser's node
    origin: Scene  # in which it came
    result: PlanResult | None = None  # the plan that it comes from


class Motions:
    """The motions, in the order in which they came."""

    def __init__(self, viewer: Viewer, skins: Sequence[Skin]) -> None:
        """Start without any; `skins` are what their robots are shown in."""
        self._viewer, self._skins = viewer, skins
        self.shown: list[Shown] = []
        self.active: Shown | None = None  # whose joints and clearance are shown

    def named(self, name: str) -> Shown | None:
        """Return the motion of a name, if there is one."""
        return next((shown for shown in self.shown if shown.motion.name == name), None)

    def holds(self, shown: Shown) -> bool:
        """Whether what is known of a motion is of the scene as it is now."""
        return shown.motion.scene is self._viewer.scene

    def add(self, motion: ShownMotion, result: PlanResult | None = None) -> None:
        """Show a motion, or replace the one of its name, and make it the active one."""
        shown = self.named(motion.name)
        if shown is None:
            number, on = len(self.shown), self._viewer.panel.layers.on("robot")
            color = OTHERS[(number - 1) % len(OTHERS)] if number else None
            skins = [skin for skin in self._skins if skin.joint or not number]  # what stands still is there once
            server, robot = self._viewer.server, self._viewer.robot
            nodes = RobotNodes(server, f"robot{number}", robot, skins, color=color, visible=on)
            shown = Shown(motion, color, nodes, None, motion.scene)
            self.shown.append(shown)
        shown.origin, shown.result = motion.scene, result
        self._take(shown, motion)
        self.active = shown

    def check(self, name: str) -> Certificate | None:
        """Certify a motion in the scene as it is now, without measuring its clearances; None if there is none."""
        shown = self.named(name)
        if shown is None:
            return None
        if not self.holds(shown):
            self._take(shown, _again(shown.motion, self._viewer.edited.certifier, measured=False))
        return shown.motion.certificate

    def measure(self) -> bool:
        """Certify and measure the motions that are not of the scene as it is now; whether there were any."""
        stale = [shown for shown in self.shown if not (self.holds(shown) and shown.motion.measured)]
        for shown in stale:
            self._take(shown, _again(shown.motion, self._viewer.edited.certifier))
        return bool(stale)

    def outdate(self, before: Scene) -> None:
        """Draw the paths of motions that held in an earlier scene as those of which nothing is known in this one."""
        for shown in self.shown:
            if shown.motion.scene is before:
                self._draw(shown, FAINT)

    def show(self, parameter_of: Callable[[Curve], float]) -> None:
        """Show the robots where their motions are: `parameter_of` a curve says where."""
        for shown in self.shown:
            curve = shown.motion.curve
            shown.robot.show(curve.at_parameter(parameter_of(curve)))

    def _take(self, shown: Shown, motion: ShownMotion) -> None:
        shown.motion = motion
        if motion.measured:
            self._draw(shown, clearance_colors(motion.clearance))
        else:
            self._draw(shown, verdict_color(motion.certificate))

    def _draw(self, shown: Shown, colors: NDArray[np.uint8] | Color) -> None:
        name = "path/" + "".join(c if c.isalnum() else "_" for c in shown.motion.name)
        shown.path = draw_path(self._viewer.server, name, shown.motion.tip, colors)
        shown.path.visible = self._viewer.panel.layers.on("path")


def verdict_color(certificate: Certificate) -> Color:
    """Return the colour of a whole motion: certified, in contact or too close, or something else."""
    if certificate.certified:
        return START
    return CONTACT if certificate.status in (Status.IN_CONTACT, Status.TOO_CLOSE, Status.NOT_PROVEN) else FAINT


def _again(motion: ShownMotion, certifier: Certifier, measured: bool = True) -> ShownMotion:
    """Return the same motion in another scene."""
    certificate = motion.certificate if motion.scene is certifier.scene else None
    return ShownMotion.of(motion.name, motion.trajectory, certifier, certificate, measured)
