"""The edited document: a scene with its motions, and undo. It depends on no browser and no drawing.

Who shows it listens (`Audience`); the panel's parts change it by the methods here, and by no other way. All is called
by the viewer's one thread.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from hdplan.planner.certificate.verdict import Certificate
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.history import History
from hdplan.planner.view.motions import Motions, Shown
from hdplan.scenes.errors import InputError
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.result import PlanResult

State = tuple[Edited, tuple[Shown, ...], int | None]
"""The state that an undo brings back: the scene, the motions, and the number of the active one."""
LOCKED = "obstacle {name}: is locked; unlock it in the list first"


class Audience(Protocol):
    """The one that shows a document, and hears what has become another."""

    def scene_changed(self, before: Scene) -> None:
        """Show the scene as it is now in place of an earlier one; the words about motions holds no more."""

    def motions_changed(self) -> None:
        """Show the motions as they are now, and what is known of them."""

    def doubted(self) -> None:
        """Take back the words about the motions."""

    def left(self) -> None:
        """Drop the plan under way: the active motion is another one by now, or an earlier one again."""


class Document:
    """A scene, its motions, and the steps that led here."""

    def __init__(self, edited: Edited, audience: Audience) -> None:
        """Begin with a scene without motions."""
        self.edited = self.first = edited
        self.motions = Motions()
        self.locked: set[str] = set()  # names of obstacles that are kept from changes
        self.history: History[State] = History()
        self._audience = audience

    @property
    def scene(self) -> Scene:
        """The scene as it is now."""
        return self.edited.scene

    def holds(self, shown: Shown) -> bool:
        """True if what is known of a motion is of the scene as it is now."""
        return shown.motion.scene is self.scene and not shown.doubted

    # --- the scene ------------------------------------------------------------------------------------------------

    def change(self, edited: Edited, step: bool = True, check: bool = False) -> None:
        """Take another scene of the same robot: a step that can be undone, or a part of the last one. Motions stay as
        they are, and the words about them fall until they are measured again, except of the active one on request: it
        is certified at once. Raises InputError, and changes nothing, for a scene that does not fit the robot, or that
        changes what is locked."""
        self._refuse_locked(edited)
        _ = edited.contacts  # refused before anything is shown
        if step:
            self.step()
        else:
            self.history.part()
        self._show(edited, check)

    def step(self) -> None:
        """Begin a step, of the scene or of the motions, that can be undone."""
        self.history.step(self._state())

    def undo(self) -> None:
        """Go one step back, and say what holds there."""
        self._restore(self.history.undone(self._state()))

    def forget(self) -> None:
        """Go back to where the last step began, as if there had been none."""
        self._restore(self.history.dropped(self._state()))

    def redo(self) -> None:
        """Go one step forward again, and say what holds there."""
        self._restore(self.history.redone(self._state()))

    def reset(self) -> None:
        """Take the scene as it was at first, a step that can be undone, and say what holds there."""
        self._audience.left()
        self.change(self.first)
        self.measure()

    # --- the motions ----------------------------------------------------------------------------------------------

    def measure(self) -> None:
        """Certify and measure the motions again that are not of the scene as it is now."""
        if self._measured():
            self._audience.motions_changed()

    def put(
        self,
        name: str,
        trajectory: Trajectory,
        certificate: Certificate | None = None,
        *,
        measured: bool = True,
        result: PlanResult | None = None,
        step: bool = True,
    ) -> Certificate:
        """Add a motion, or replace the one of that name, and make it the active one, a step that can be undone or a
        part of the last one; return what holds of it in the scene as it is now: `certificate`, if it is of this scene.
        Its clearances are `measured` at once or later; `result` is its plan."""
        motion = ShownMotion.of(name, trajectory, self.edited.certifier, certificate, measured)
        if step:
            self.step()
            self._audience.left()
        self.motions.add(motion, result)
        self._audience.motions_changed()
        return motion.certificate

    def remove(self, shown: Shown) -> None:
        """Take a motion away, a step that can be undone."""
        self.step()
        self._audience.left()
        self.motions.remove(shown)
        self._audience.motions_changed()

    def choose(self, name: str) -> None:
        """Make a motion the active one: what is being planned from another one would take its place."""
        self._audience.left()
        self.motions.active = self.motions.named(name)
        self._audience.motions_changed()

    def rename(self, shown: Shown, name: str) -> None:
        """Rename a motion, a step that can be undone. Raises HdplanError for a name that is taken."""
        name = self.motions.free_for(shown, name)
        self.step()
        shown.motion = replace(shown.motion, name=name)
        self._audience.motions_changed()

    def hide(self, shown: Shown) -> None:
        """Hide a motion, or show it again."""
        shown.visible = not shown.visible
        self._audience.motions_changed()

    def make_room(self, keep: int) -> None:
        """Remove the oldest plans beyond `keep` of them, but not the active one, as a part of the last step."""
        if self.motions.make_room(keep):
            self._audience.motions_changed()

    def doubt(self) -> None:
        """Take back the words about all motions, until they are certified again: something failed."""
        self.motions.doubt()
        self._audience.doubted()

    # --- within -----------------------------------------------------------------------------------------------------

    def _state(self) -> State:
        return self.edited, *self.motions.kept()

    def _restore(self, state: State) -> None:
        """Take scene and motions as they were; what was planned meanwhile comes too late."""
        self._audience.left()
        edited, motions, active = state
        self.motions.restore(motions, active)
        self._show(edited)
        self._measured()
        self._audience.motions_changed()

    def _show(self, edited: Edited, check: bool = False) -> None:
        """Show another scene; if that fails, nothing is known of its motions."""
        before, self.edited = self.edited, edited
        if before is not edited:
            before.left()
        try:
            active = self.motions.active
            if check and active is not None and not self.holds(active):
                self._renew(active, measured=False)
            self._audience.scene_changed(before.scene)
        except Exception:
            self.doubt()
            raise

    def _measured(self) -> bool:
        """Certify and measure what is not of the scene as it is now; whether there was anything."""
        stale = [shown for shown in self.motions.shown if not (self.holds(shown) and shown.motion.measured)]
        for shown in stale:
            self._renew(shown)
        return bool(stale)

    def _renew(self, shown: Shown, measured: bool = True) -> None:
        """Certify a motion in the scene as it is now; one that does not fit it, as one without times where these
        matter, keeps what is known of it in an older scene."""
        motion = shown.motion
        certificate = motion.certificate if self.holds(shown) else None
        try:
            again = ShownMotion.of(motion.name, motion.trajectory, self.edited.certifier, certificate, measured)
        except InputError as error:
            shown.misfit = str(error)
        else:
            shown.motion, shown.misfit, shown.doubted = again, "", False

    def _refuse_locked(self, after: Edited) -> None:
        """Raise InputError for a change of what is locked."""
        if self.locked:
            now = {each.name: each for each in after.scene.obstacles}
            for each in self.scene.obstacles:
                if each.name in self.locked and now.get(each.name) != each:
                    raise InputError(LOCKED.format(name=each.name))
