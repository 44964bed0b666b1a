"""Planning from the browser: Plan and Stop, the optimizer's motions as they come, and the verdict."""

from __future__ import annotations

import contextlib
import html
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import viser

from hdplan.planner.motion.curve import Curve
from hdplan.planner.plan import plan
from hdplan.planner.result import PlanResult
from hdplan.planner.search.search import Event
from hdplan.planner.timing.time_laws import MinimumJerk
from hdplan.planner.view.drawing.colors import ITERATE
from hdplan.planner.view.drawing.motion import sample_parameters
from hdplan.planner.view.drawing.nodes import PathNode
from hdplan.planner.view.words import failure_words, small
from hdplan.scenes.array_types import Array
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer


Run = Callable[[Callable[[Event], None], Callable[[], bool]], PlanResult]
"""A maker of plans, given what takes its events, and what tells whether to stop."""
NAME = "planned"  # of the first motion that Plan finds; those after it are numbered
KEPT_PLANS = 5  # plans
LOOK, LOOK_IN_ALL = 0.05, 4.0  # [s] for which an iteration is shown, and at most all of them together
SETTLED = 10.0  # [s] that a new run waits at most until the last one's motion is shown


class Planning:
    """The panel, and the run under way."""

    def __init__(self, viewer: Viewer) -> None:
        """Build the button in the container at hand; `build` builds the rest."""
        self._viewer = viewer
        self.button = viewer.server.gui.add_button("Plan")
        self.button.on_click(lambda _: self.toggle())
        self._starting = threading.Lock()  # several browsers may press at once
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._follows = False  # whether a plan is made elsewhere
        self.iterates: list[tuple[str, Array]] = []  # words and waypoints (N, n) of every iteration
        self._shown_for = 0.0  # [s]
        self._path: PathNode | None = None
        self.stopped: PlanResult | None = None  # the last one that was stopped

    def add_icon(self) -> None:
        """Give the button its icon, as `Player.add_icon` does."""
        if self.button.icon is None:
            self.button.icon = viser.Icon.ROUTE

    def build(self) -> None:
        """Build the words and the slider over the iterations in the container at hand."""
        viewer, gui = self._viewer, self._viewer.server.gui
        self.watch = gui.add_checkbox(
            "watch", True, hint=f"show every iteration for {LOOK:g} s, at most {LOOK_IN_ALL:g} s in all"
        )
        self.text = gui.add_html("")
        self.iteration = gui.add_slider("iteration", 0, 1, 1, 0, disabled=True, hint="look back at the optimizer")
        self.iteration.on_update(lambda event: viewer.worker.ask("iterate", self._look_back) if event.client else None)

    @property
    def running(self) -> bool:
        """True if a motion is being planned."""
        return self._follows or (self._thread is not None and self._thread.is_alive())

    def toggle(self) -> None:
        """Start, or stop."""
        if self.running:
            self.stop()
        else:
            self.start()

    def start(self) -> None:
        """Start planning in the scene as it is shown, once the previous result is shown."""
        with self._starting:
            self.end()
            self._viewer.worker.settle(SETTLED)
            scene = self._viewer.scene
            self._begin()
            self._thread = threading.Thread(target=self._run, args=(scene,), name="hdplan-plan", daemon=True)
            self._thread.start()

    def follow(self, scene: Scene, run: Run) -> PlanResult:
        """Show a plan in a scene that is made elsewhere: `run` is called with what takes its events and what tells
        whether to stop. Returns its result, or raises what it raises, and has it shown."""
        with self._starting:
            self.end()
            self._follows = True
            self._begin()
        try:
            return self._shown(scene, run)
        finally:
            self._follows = False

    def stop(self) -> None:
        """Stop with the best motion so far."""
        self._stop.set()

    def end(self) -> None:
        """Stop, and wait until it has."""
        self.stop()
        if self._thread is not None:
            self._thread.join()

    # --- the run, in its own thread ------------------------------------------------------------------------------

    def _run(self, scene: Scene) -> None:
        settings = self._viewer.panel.settings
        with contextlib.suppress(Exception):  # it is reported: the viewer continues
            self._shown(
                scene,
                lambda report, stop: plan(
                    scene,
                    robot=self._viewer.robot,
                    solver=settings.solver.value,
                    seed=settings.seed.value,
                    time_limit=settings.time_limit.value,
                    report=report,
                    stop=stop,
                ),
            )

    def _begin(self) -> None:
        """Say that a plan begins."""
        self._stop.clear()
        self.iterates, self._shown_for = [], 0.0
        self.button.label, self.button.icon = "Stop", viser.Icon.PLAYER_STOP
        self._say("building the problem …")
        self._viewer.panel.say_next("planning, building the problem …")

    def _shown(self, scene: Scene, run: Run) -> PlanResult:
        """Plan, and have the result shown."""
        worker = self._viewer.worker
        try:
            result = run(self._report, self._stop.is_set)
        except BaseException as error:  # among them ends in collision, and Ctrl-C
            text = failure_words(scene, error)
            worker.ask("planned", lambda: self._finish(scene, None, text))
            raise
        worker.ask("planned", lambda: self._finish(scene, result, result.certificate.text))
        return result

    def _report(self, event: Event) -> None:
        """Show an iteration, and give it time to be seen."""
        if event.step is None or event.positions is None:
            return
        step = event.step
        words = f"attempt {event.attempt}, iteration {step.iteration}: cost {step.cost:.4g}, weight {step.weight:.3g}"
        self.iterates.append((words, event.positions.copy()))
        if not self.watch.value or self._shown_for > LOOK_IN_ALL:
            return
        began = time.perf_counter()
        self._viewer.worker.ask("iterate", lambda: self._show_iterate(words, event.positions))
        self._viewer.worker.settle(1.0)
        time.sleep(max(0.0, LOOK - (time.perf_counter() - began)))
        self._shown_for += time.perf_counter() - began

    # --- drawing, by the worker's thread -------------------------------------------------------------------------

    def outdate(self) -> None:
        """Withdraw the words about a motion, as the scene has changed."""
        if not self.running:
            self._say("")

    def _show_iterate(self, words: str, positions: Array | None) -> None:
        if positions is None:
            return
        viewer = self._viewer
        curve = Curve.through(positions, row_times(viewer.scene, len(positions)))
        joints = curve.at_parameter(sample_parameters(len(positions)))
        tip = viewer.stage.tip.path(joints)
        if self._path is None:
            self._path = PathNode(viewer.server, "iterate", tip, ITERATE)
        self._path.draw(tip, ITERATE)
        viewer.show_robot(viewer.joints(curve))
        self._say(words)
        if self.running:
            viewer.panel.say_next(f"planning, {words}")

    def _look_back(self) -> None:
        if self.iterates:
            self._show_iterate(*self.iterates[min(int(self.iteration.value), len(self.iterates)) - 1])

    def _finish(self, scene: Scene, result: PlanResult | None, text: str) -> None:
        viewer = self._viewer
        if self._path is not None:
            self._path.node.remove()
            self._path = None
        self.button.label, self.button.icon = "Plan", viser.Icon.ROUTE
        self.stopped = result if self._stop.is_set() else None
        if result is not None:
            unmoved = viewer.scene is scene  # nothing was dragged meanwhile
            viewer.document.step()
            if unmoved and result.goal is not None and result.goal.positions is not None:
                viewer.document.change(viewer.edited.shown_at(np.array(result.goal.positions)), step=False)
            name, known = self._name(result), result.certificate if unmoved else None
            certificate = viewer.document.put(name, result.trajectory, known, result=result, step=False)
            viewer.panel.live.forget()
            viewer.document.make_room(KEPT_PLANS)
            if not unmoved:
                text = f"planned in an earlier scene; in this one {certificate.text}"
            spent = max(result.times.solve - self._shown_for, 0.0) + result.times.certify
            viewer.panel.live.learn(result.times.build + spent)
            text = f"{text} – {result.attempts} attempt(s), {result.iterations} iterations, {spent:.2f} s"
        count = len(self.iterates)
        self.iteration.disabled = count == 0
        if count:
            self.iteration.max, self.iteration.min = max(count, 2), 1
            self.iteration.value = count
        self._say(text)
        if result is None:
            viewer.panel.say_next(text, bad=True)

    def _name(self, result: PlanResult) -> str:
        """Return the name of a new plan: it replaces one that fell short, or found the same motion."""
        motions, found = self._viewer.motions, result.trajectory.positions
        for shown in motions.shown:
            earlier = shown.result
            if earlier is not None and (not earlier.certified or np.array_equal(earlier.trajectory.positions, found)):
                return shown.motion.name
        return motions.free_name(NAME)

    def _say(self, text: str) -> None:
        self.text.content = small(html.escape(text))


def row_times(scene: Scene, count: int) -> Array | None:
    """Return when a motion under way passes its waypoints (count,) [s], where the scene fixes that: only then it meets
    obstacles that move where the planner has them."""
    if not scene.end_time:
        return None
    return MinimumJerk(scene.end_time).time_at(np.linspace(0.0, 1.0, count))
