"""The motions of a scene: each with its verdict, the scene that this is of, and its colour. The active one is where the
robot itself is. Values alone; `motion_nodes` draws them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from hdplan.planner.view.drawing.colors import MOTIONS
from hdplan.planner.view.drawing.mesh_parts import Color
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.result import PlanResult

LONGEST_NAME = 40  # characters of a motion's name


@dataclass(eq=False)
class Shown:
    """A motion, and what is known of it."""

    motion: ShownMotion
    number: int  # its own in this viewer
    color: Color
    origin: Scene  # in which it came
    result: PlanResult | None = None  # its plan
    visible: bool = True
    doubted: bool = False  # whether nothing is known of it, as what measured or drew it failed
    misfit: str = ""  # why nothing can be proven of it in the scene as it was last checked


class Motions:
    """The motions, in the order in which they came."""

    def __init__(self) -> None:
        """Start without any."""
        self._came = 0
        self.shown: list[Shown] = []
        self.active: Shown | None = None  # whose joints and clearance are shown

    def named(self, name: str) -> Shown | None:
        """Return the motion of a name, if there is one."""
        return next((shown for shown in self.shown if shown.motion.name == name), None)

    def free_name(self, name: str) -> str:
        """Return a name that no motion has: this one, or with a number."""
        names = (name, *(f"{name} {number}" for number in range(2, len(self.shown) + 2)))
        return next(free for free in names if self.named(free) is None)

    def free_for(self, shown: Shown, name: str) -> str:
        """Return another name for a motion, as it is written. Raises HdplanError for one that is empty, long or
        taken."""
        name = " ".join(name.split())
        if not 0 < len(name) <= LONGEST_NAME:
            raise HdplanError(f"a motion's name has 1 to {LONGEST_NAME} characters, found {len(name)}")
        if self.named(name) not in (None, shown):
            raise HdplanError(f"another motion has the name '{name}'")
        return name

    def doubt(self) -> None:
        """Take back what is known of all motions, until they are certified again."""
        for shown in self.shown:
            shown.doubted = True

    def add(self, motion: ShownMotion, result: PlanResult | None = None) -> None:
        """Take a motion, or replace the one of its name, and make it the active one."""
        shown = self.named(motion.name)
        if shown is None:
            used = [other.color for other in self.shown]
            self._came += 1
            shown = Shown(motion, self._came, min(MOTIONS, key=used.count), motion.scene, result)
            self.shown.append(shown)
        shown.origin, shown.result = motion.scene, result
        shown.motion, shown.misfit, shown.doubted = motion, "", False
        self.active = shown

    def kept(self) -> tuple[tuple[Shown, ...], int | None]:
        """Return the state that an undo restores: the motions as they are now, and the number of the active one."""
        return tuple(map(replace, self.shown)), None if self.active is None else self.active.number

    def restore(self, motions: Sequence[Shown], active: int | None) -> None:
        """Take what was kept, and nothing else: what is doubted by now stays so."""
        there = {shown.number: shown for shown in self.shown}
        self.shown = []
        for kept in motions:
            shown = there.get(kept.number) or replace(kept, doubted=False)
            shown.doubted = shown.doubted and shown.motion is kept.motion
            shown.motion, shown.origin, shown.result = kept.motion, kept.origin, kept.result
            shown.visible, shown.misfit = kept.visible, ""
            self.shown.append(shown)
        self.active = next((shown for shown in self.shown if shown.number == active), None)

    def remove(self, shown: Shown) -> None:
        """Take a motion away; the one before it becomes the active one, if it was."""
        place = self.shown.index(shown)
        self.shown.remove(shown)
        if self.active is shown:
            self.active = self.shown[max(place - 1, 0)] if self.shown else None

    def make_room(self, keep: int) -> bool:
        """Remove the oldest plans beyond `keep` of them, but not the active one; whether there were any."""
        plans = [shown for shown in self.shown if shown.result is not None and shown is not self.active]
        many = plans[: max(len(plans) + 1 - keep, 0)]
        for shown in many:
            self.remove(shown)
        return bool(many)
