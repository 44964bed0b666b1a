"""Start and goal by their joints: a slider for each, buttons for named states and random free configurations, and the
other postures that hold the hand in the same place."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.view import ends
from hdplan.planner.view.edit_steps import Editing
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.things import Thing
from hdplan.planner.view.words import small
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError
from hdplan.scenes.targets import JointTarget

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

SLIDER_STEP = 0.001  # [rad] or [m] of a slider
WAY = 2 * np.pi  # [rad] or [m] to both sides of a joint without limits
JOINTS = "joints"  # the field that they are
RANDOM, OTHER, KEEP = "random", "another", "keep as joint values"


class Jogging:
    """The sliders of one end, and its buttons."""

    def __init__(self, viewer: Viewer, editing: Editing) -> None:
        """Build them in the container at hand."""
        self._viewer, self._editing = viewer, editing
        gui, robot = viewer.server.gui, viewer.robot
        self.end = gui.add_dropdown(
            "jog", ("start", "goal"), initial_value="goal", hint="whose joints the sliders move"
        )
        self._states = ends.states(robot)
        go = gui.add_button_group("go to", (*self._states, RANDOM), hint="named states; a random free configuration")
        posture = gui.add_button_group("posture", (OTHER, KEEP), hint="other joint values with the hand where it is")
        self._text = gui.add_html("")
        low = np.where(np.isfinite(robot.lower), robot.lower, -WAY)
        high = np.where(np.isfinite(robot.upper), robot.upper, WAY)
        self.sliders = [
            gui.add_slider(name, float(least), float(most), SLIDER_STEP, float(np.clip(0.0, least, most)))
            for name, least, most in zip(robot.joint_names, low, high, strict=True)
        ]
        self._rng = np.random.default_rng()
        self._postures: tuple[Edited | None, tuple[Array, ...], int] = None, (), 0  # in which scene, which, and where
        self.end.on_update(lambda event: viewer.worker.ask("jogged end", self.update) if event.client else None)
        go.on_click(lambda event: self._editing.do(partial(self.go, str(event.target.value))))
        posture.on_click(lambda event: self._editing.do(self.keep if event.target.value == KEEP else self.another))
        for slider in self.sliders:
            slider.on_update(self._moved)

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def go(self, to: str) -> None:
        """Put the end to a named state, or to a random free configuration. Raises InputError if none is found."""
        edited, end = self._viewer.edited, str(self.end.value)
        q = ends.random_free(edited, end, self._rng) if to == RANDOM else self._states[to]
        self._editing.apply(to, lambda edited: ends.fixed(edited, end, q))

    def another(self) -> None:
        """Go on to the next posture. Raises InputError if there is no other, or the hand is not one link."""
        edited, end = self._viewer.edited, str(self.end.value)
        scene, found, at = self._postures
        if scene is not edited:
            found, at = ends.postures(edited, end), 0
        if len(found) == 1:
            raise InputError(f"{end}: no other free posture was found")
        at = (at + 1) % len(found)
        chosen = end == "goal" and not isinstance(edited.target, JointTarget)  # which leaves the pose as it is
        q = found[at]
        self._editing.apply(f"posture {at}", lambda now: now.shown_at(q) if chosen else ends.fixed(now, end, q))
        self._postures = self._viewer.edited, found, at
        self._say(f"posture {at + 1} of {len(found)} that were found free")

    def keep(self) -> None:
        """Make the goal the joint values that are shown, in place of a pose."""
        self._editing.apply("keep", lambda edited: edited.ending_at(edited.goal))

    def jogged(self, end: str, found: Array, edited: Edited) -> Edited:
        """Return the scene with its "start" or "goal" where the sliders were found (n,)."""
        robot, shown = self._viewer.robot, edited.start if end == "start" else edited.goal
        moved = np.abs(found - shown) > 0.5 * SLIDER_STEP  # the others stay to the last digit
        return ends.jogged(edited, end, np.where(moved, np.clip(found, robot.lower, robot.upper), shown))

    def follow(self, thing: Thing | None) -> None:
        """Jog the end that is selected."""
        if thing is not None and thing.kind in ("start", "goal") and self.end.value != thing.kind:
            self.end.value = thing.kind
            self.update()

    def update(self) -> None:
        """Show the end as it is now."""
        edited = self._viewer.edited
        if self._postures[0] is not edited:
            self._say("")
        if self._editing.is_edited(JOINTS):
            return
        q = edited.start if self.end.value == "start" else edited.goal
        for slider, value in zip(self.sliders, q.tolist(), strict=True):
            if not slider.min <= value <= slider.max:
                slider.min, slider.max = min(slider.min, value), max(slider.max, value)
            slider.value = value

    async def _moved(self, event: Any) -> None:
        """Handle a browser's event: at once, before the worker shows what is older."""
        if event.client is not None:
            found = np.array([slider.value for slider in self.sliders])
            self._editing.edit(JOINTS, partial(self.jogged, str(self.end.value), found))

    def _say(self, text: str) -> None:
        self._text.content = small(text)
