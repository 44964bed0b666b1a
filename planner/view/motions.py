"""The motions: each with its verdict, the scene that this is of, its colour and its path. The active one is where the
robot itself is; the others' robots are seen through.

All is called by the viewer's one thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.certificate.verdict import Certificate, Status
from hdplan.planner.motion.curve import Curve
from hdplan.planner.result import PlanResult
from hdplan.planner.view.drawing.colors import CONTACT, MOTIONS, START, clearance_colors
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.nodes import PATH_WIDTH, PathNode, RobotNodes
from hdplan.planner.view.drawing.skins import Color, Skin
from hdplan.planner.view.words import SHORT
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

FAINT: Color = (160, 160, 160)
THIN_PATH = 0.5 * PATH_WIDTH  # [m] of the path of a motion that is not the active one
THROUGH = 0.4  # opacity of the robots of motions that are not the active one
# [rad] or [m] within which two robots stand in each other's place, where their surfaces would flicker
SAME_PLACE = 1e-3
LONGEST_NAME = 40  # characters of a motion's name


class Look(NamedTuple):
    """How a path is drawn."""

    colors: NDArray[np.uint8] | Color  # along it (K, 3), or of all of it
    means: str  # what one colour of all of it means; "" for clearances
    wide: bool


@dataclass(eq=False)
class Shown:
    """A motion with its nodes in the scene."""

    motion: ShownMotion
    number: int  # its own in this viewer
    color: Color
    robot: RobotNodes  # seen through, where it is not the active one
    path: PathNode
    origin: Scene  # in which it came
    result: PlanResult | None = None  # the plan that it comes from
    visible: bool = True
    doubted: bool = False  # whether nothing is known of it, as what measured or drew it failed
    misfit: str = ""  # why nothing can be proven of it in the scene as it was last checked


@dataclass(frozen=True, eq=False)
class Kept:
    """The part of a motion that an undo brings back."""

    motion: ShownMotion
    number: int
    color: Color
    origin: Scene
    result: PlanResult | None
    visible: bool


class Motions:
    """The motions, in the order in which they came."""

    def __init__(self, viewer: Viewer, skins: Sequence[Skin]) -> None:
        """Start without any; `skins` are what robots are shown in that are seen through."""
        self._viewer, self._skins = viewer, [skin for skin in skins if skin.joint]
        self._came = self._sent = 0  # motions, and their nodes: an undo sends a motion's again
        self.shown: list[Shown] = []
        self.active: Shown | None = None  # whose joints and clearance are shown

    def named(self, name: str) -> Shown | None:
        """Return the motion of a name, if there is one."""
        return next((shown for shown in self.shown if shown.motion.name == name), None)

    def free_name(self, name: str) -> str:
        """Return a name that no motion has: this one, or with a number."""
        names = (name, *(f"{name} {number}" for number in range(2, len(self.shown) + 2)))
        return next(free for free in names if self.named(free) is None)

    def holds(self, shown: Shown) -> bool:
        """True if what is known of a motion is of the scene as it is now."""
        return shown.motion.scene is self._viewer.scene and not shown.doubted

    def doubt(self) -> None:
        """Take back what is known of all motions, until they are certified again."""
        for shown in self.shown:
            shown.doubted = True

    def add(self, motion: ShownMotion, result: PlanResult | None = None) -> None:
        """Show a motion, or replace the one of its name, and make it the active one."""
        shown = self.named(motion.name)
        if shown is None:
            used = [other.color for other in self.shown]
            self._came += 1
            color = min(MOTIONS, key=used.count)
            shown = self._drawn(Kept(motion, self._came, color, motion.scene, result, visible=True))
            self.shown.append(shown)
        shown.origin, shown.result = motion.scene, result
        shown.motion, shown.misfit, shown.doubted = motion, "", False
        self.active = shown
        self.paint()

    def _drawn(self, kept: Kept) -> Shown:
        """Draw a motion that is not shown yet."""
        server, robot = self._viewer.server, self._viewer.robot
        self._sent += 1
        node = f"robot{self._sent}"
        nodes = RobotNodes(server, node, robot, self._skins, color=kept.color, opacity=THROUGH, visible=False)
        path = PathNode(server, f"path/{self._sent}", kept.motion.tip, FAINT)
        return Shown(kept.motion, kept.number, kept.color, nodes, path, kept.origin, kept.result, kept.visible)

    def kept(self) -> tuple[tuple[Kept, ...], int | None]:
        """Return what an undo brings back: the motions, and the number of the active one."""
        motions = [Kept(s.motion, s.number, s.color, s.origin, s.result, s.visible) for s in self.shown]
        return tuple(motions), None if self.active is None else self.active.number

    def restore(self, motions: Sequence[Kept], active: int | None) -> None:
        """Show what was kept, and nothing else."""
        there = {shown.number: shown for shown in self.shown}
        for number in there.keys() - {kept.number for kept in motions}:
            there[number].robot.remove()
            there[number].path.remove()
        self.shown = []
        for kept in motions:
            shown = there.get(kept.number) or self._drawn(kept)
            doubted = shown.doubted and shown.motion is kept.motion
            shown.motion, shown.origin, shown.result, shown.visible = (
                kept.motion,
                kept.origin,
                kept.result,
                kept.visible,
            )
            shown.misfit, shown.doubted = "", doubted
            self.shown.append(shown)
        self.active = next((shown for shown in self.shown if shown.number == active), None)
        self.paint()

    def remove(self, shown: Shown) -> None:
        """Take a motion away; the one before it becomes the active one, if it was."""
        place = self.shown.index(shown)
        self.shown.remove(shown)
        shown.robot.remove()
        shown.path.remove()
        if self.active is shown:
            self.active = self.shown[max(place - 1, 0)] if self.shown else None
        self.paint()

    def make_room(self, keep: int) -> None:
        """Remove the oldest plans beyond `keep` of them, but not the active one."""
        plans = [shown for shown in self.shown if shown.result is not None and shown is not self.active]
        for shown in plans[: max(len(plans) + 1 - keep, 0)]:
            self.remove(shown)

    def free_for(self, shown: Shown, name: str) -> str:
        """Return another name for a motion, as it is written. Raises HdplanError for one that is empty, long or
        taken."""
        name = " ".join(name.split())
        if not 0 < len(name) <= LONGEST_NAME:
            raise HdplanError(f"a motion's name has 1 to {LONGEST_NAME} characters, found {len(name)}")
        if self.named(name) not in (None, shown):
            raise HdplanError(f"another motion is called '{name}'")
        return name

    def check(self) -> None:
        """Certify the active motion in the scene as it is now, without measuring its clearances, which takes longer."""
        if self.active is not None and not self.holds(self.active):
            self._renew(self.active, measured=False)

    def measure(self) -> bool:
        """Certify and measure the motions that are not of the scene as it is now; whether there were any."""
        stale = [shown for shown in self.shown if not (self.holds(shown) and shown.motion.measured)]
        for shown in stale:
            self._renew(shown)
        return bool(stale)

    def _renew(self, shown: Shown, measured: bool = True) -> None:
        """Certify a motion in the scene as it is now; one that does not fit it, as one without times where these
        matter, keeps what is known of it in an older scene."""
        try:
            motion = self._again(shown, measured)
        except InputError as error:
            shown.misfit = str(error)
        else:
            self._take(shown, motion)

    def show(self, parameter_of: Callable[[Curve], float], q: Array, reported: bool = False) -> None:
        """Show the other motions' robots where they are: `parameter_of` a curve says where. The robot itself is at `q`
        (n,), where the active motion is unless it has `reported` itself: what would stand in its place is not drawn."""
        for shown in self.shown:
            curve = shown.motion.curve
            at = curve.at_parameter(parameter_of(curve))
            apart = (reported or shown is not self.active) and bool(np.abs(at - q).max() > SAME_PLACE)
            shown.robot.visible = apart and shown.visible and self._viewer.panel.layers.on("robot")
            if shown.robot.visible:
                shown.robot.show(at)

    def paint(self) -> None:
        """Draw the paths, as `look_of` says, and the robots of motions that fail."""
        for shown in self.shown:
            self._paint(shown)

    def look_of(self, shown: Shown) -> Look:
        """Return how a motion's path is drawn: the active one by its clearance, the others thin and in their own
        colours; one of which nothing is known grey, and one that fails in the colour of its verdict."""
        motion, active = shown.motion, shown is self.active
        if not self.holds(shown):
            return Look(FAINT, "not checked in this scene yet", active)
        if not motion.certificate.certified:
            return Look(verdict_color(motion.certificate), SHORT[motion.certificate.status], active)
        if not active:
            return Look(shown.color, "certified", active)
        if motion.measured:
            return Look(clearance_colors(motion.clearance), "", active)
        return Look(START, "certified, measured when you let go", active)

    def _take(self, shown: Shown, motion: ShownMotion) -> None:
        shown.motion, shown.misfit, shown.doubted = motion, "", False
        self._paint(shown)

    def _again(self, shown: Shown, measured: bool) -> ShownMotion:
        """Return the same motion in the scene as it is now."""
        motion = shown.motion
        certificate = motion.certificate if self.holds(shown) else None
        return ShownMotion.of(motion.name, motion.trajectory, self._viewer.edited.certifier, certificate, measured)

    def _paint(self, shown: Shown) -> None:
        look = self.look_of(shown)
        shown.path.draw(shown.motion.tip, look.colors, PATH_WIDTH if look.wide else THIN_PATH)
        shown.path.visible = shown.visible and self._viewer.panel.layers.on("path")
        fails = self.holds(shown) and not shown.motion.certificate.certified
        shown.robot.paint(verdict_color(shown.motion.certificate) if fails else shown.color)


def verdict_color(certificate: Certificate) -> Color:
    """Return the colour of a whole motion: certified, in contact or too close, or something else."""
    if certificate.certified:
        return START
    return CONTACT if certificate.status in (Status.IN_CONTACT, Status.TOO_CLOSE, Status.NOT_PROVEN) else FAINT
