"""Live planning: while something is dragged, the motion is planned again and again, each time from the last one.

A thread plans for the newest scene (`plan` with the last motion as its guess, nothing is compiled again); scenes that
came and went meanwhile are dropped. What it finds certified is shown; a motion that no longer holds in the scene as it
is turns red at once, with the pair and the depth, and stays, as one of an older scene, until another is found.
"""

from __future__ import annotations

import html
import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.result import PlanResult
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.handles import Handles
from hdplan.planner.view.newest import Newest
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.words import failure_words
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

LIVE_LIMIT = 1.0  # [s] for a plan; scenes in which it takes longer are not planned live by default
PATIENCE = 0.25  # [s] after which a plan gives way to a newer scene
WINDOW = 2.0  # [s] over which motions are counted
IDLE = "drag something, and the motion follows"
WAIT = 5.0  # [s] for the thread at the end
SLOW_PLANS = 2  # plans in a row that find nothing within LIVE_LIMIT switch it off


class Live:
    """The switch, the count, and the thread that plans."""

    def __init__(self, viewer: Viewer, handles: Handles) -> None:
        """Build the switch in the container at hand, and start the thread."""
        self._viewer, self._handles = viewer, handles
        gui = viewer.server.gui
        self.switch = gui.add_checkbox("live", True, hint="during a drag, keep planning from the last motion")
        self.text = gui.add_html("")
        self._say(IDLE)
        self._switched = False  # whether the user set the switch
        self.switch.on_update(lambda event: self.set(bool(self.switch.value)) if event.client else None)
        self._slow = 0  # plans in a row that found nothing in time
        self._shown: deque[float] = deque()  # when certified motions were shown
        self.count = 0  # certified motions shown since the last one was let go
        self._newest: Newest[tuple[Edited, Trajectory | None]] = Newest("hdplan-live", self._plan, WAIT)

    @property
    def on(self) -> bool:
        """True if motions follow."""
        return bool(self.switch.value)

    def set(self, on: bool) -> None:
        """Switch live planning by the user's choice, however long a plan takes."""
        self._switched, self.switch.value = True, on

    def settle(self, timeout: float) -> bool:
        """Wait until nothing is left to plan; False if that takes longer than `timeout` [s]."""
        return self._newest.settle(timeout)

    def end(self) -> None:
        """Drop what is to be planned, and end the thread."""
        self._newest.end()

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def learn(self, seconds: float) -> None:
        """Switch live planning off after a plan that took too long [s], or on again, unless the user has chosen."""
        if not self._switched and self.on != (seconds < LIVE_LIMIT):
            self.switch.value = seconds < LIVE_LIMIT
            self._say(IDLE if self.on else f"off, as a plan takes more than {LIVE_LIMIT:g} s here")

    def follow(self) -> None:
        """Request a motion in the scene as it is now."""
        viewer = self._viewer
        active = viewer.motions.active
        if not self.on or viewer.edited.missed:
            return
        self._newest.ask((viewer.edited, None if active is None else active.motion.trajectory))

    def forget(self) -> None:
        """Drop the plan under way from the active motion: that is another one by now, or an earlier one again."""
        self._newest.give_up()

    def _take(self, edited: Edited, result: PlanResult, turn: int) -> None:
        """Show a motion that was certified in a scene, if it was not dropped: in the one of now it may not hold any
        more."""
        viewer = self._viewer
        if self._newest.given_up(turn):
            return
        certificate = result.certificate if viewer.scene is edited.scene else None
        active = viewer.motions.active
        planned_here = active is not None and active.result is not None
        name = active.motion.name if active and planned_here else viewer.motions.free_name(NAME)
        viewer.document.put(
            name, result.trajectory, certificate, measured=not self._handles.dragging, result=result, step=False
        )
        active = viewer.motions.active
        if active is not None and active.motion.certificate.certified:
            now = time.monotonic()
            self._shown.append(now)
            self.count += 1
            while self._shown[0] < now - WINDOW:
                self._shown.popleft()
        self._say_rate()

    def _say_rate(self) -> None:
        rate = len(self._shown) / WINDOW
        self._say(f"{rate:.1f} certified motions a second")

    def _say(self, text: str) -> None:
        words = f'<div class="hd hd-under">{html.escape(text)}</div>'
        self.text.content = words

    # --- the thread -----------------------------------------------------------------------------------------------

    def _plan(self, wish: tuple[Edited, Trajectory | None], turn: int) -> None:
        (edited, guess), newest = wish, self._newest
        ask, began = self._viewer.worker.ask, time.monotonic()

        def given_up() -> bool:
            return newest.given_up(turn) or (newest.waits and time.monotonic() > began + PATIENCE)

        try:
            result = plan(_quick(edited.aimed), robot=edited.robot, guess=guess, time_limit=LIVE_LIMIT, stop=given_up)
        except Exception as error:  # an end in collision, no time law, or of a library: the viewer continues
            text = failure_words(edited.scene, error)
            ask("live", lambda: self._say(text))
            return
        if result.certified:
            self._slow = 0
            ask("live", lambda: self._take(edited, result, turn))
            return
        spent = time.monotonic() - began
        self._slow += spent > LIVE_LIMIT
        if self._slow >= SLOW_PLANS:
            ask("learn", lambda: self.learn(spent))
        elif not given_up():
            ask("live", lambda: self._say(f"no certified motion found within {spent:.1f} s: press Plan"))


def _quick(scene: Scene) -> Scene:
    """Return a scene in which the first certified motion counts, and none is polished."""
    return replace(scene, planner=replace(scene.planner, polish=0))
