"""The viewer of a job: one scene with a job and its motion, the same in every browser that looks at it.

Everything is drawn by one thread (`Worker`); browsers only send requests. What is shown is a value (`EditedJob`), in
which a verdict goes with the scene that it is of, with a `History`.
"""

from __future__ import annotations

import html
from collections.abc import Callable

import numpy as np
import viser

from hdplan.planner.certificate.verdict import Closest
from hdplan.planner.job.certify import certify_job
from hdplan.planner.job.result import JobResult
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.view.drawing.ground import ground_of
from hdplan.planner.view.drawing.labels import Label
from hdplan.planner.view.drawing.motion import few_of
from hdplan.planner.view.drawing.nodes import ObstacleNode
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.gate import Gate, Served
from hdplan.planner.view.history import History
from hdplan.planner.view.job_handles import JobHandles
from hdplan.planner.view.job_layers import JobLayers
from hdplan.planner.view.job_planning import JobPlanning, Run
from hdplan.planner.view.job_plots import JobPlots
from hdplan.planner.view.job_saving import JobSaving
from hdplan.planner.view.job_stage import JobStage
from hdplan.planner.view.job_words import held_words, job_badge, job_legend, job_words, stage_rows
from hdplan.planner.view.keys import Keys, common_keys
from hdplan.planner.view.looking import Looking
from hdplan.planner.view.page_script import Message, Page
from hdplan.planner.view.player import Player
from hdplan.planner.view.words import clearance_words, next_words, small
from hdplan.planner.view.worker import Worker
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene

OTHER_ROBOT = "is a scene of another robot, or without a job: open it with hdplan view"
FAILED = "hdplan failed here ({error}): plan again"


class JobViewer(Served):
    """A scene with a job in the browsers of one server."""

    def __init__(
        self,
        server: viser.ViserServer,
        gate: Gate,
        scene: Scene,
        trajectory: Trajectory | None = None,
        complain: Callable[[str], object] = lambda text: None,
    ) -> None:
        """Show a scene with a job, and a motion of it; `complain` is called with what goes wrong later.

        Raises InputError for a scene that no job can be planned in, and a motion that is not of this job.
        """
        self.server, self.gate, self._complain = server, gate, complain
        self.edited = EditedJob.of(scene)
        if trajectory is not None:
            self.edited = self.edited.done(trajectory, certify_job(scene, trajectory))
        self.first = self.edited
        self.history: History[EditedJob] = History()
        self.worker = Worker(self._failed)
        self.stage = JobStage(server)
        self._stage_now: int | None = None
        self._build(scene)
        self.planning = JobPlanning(self._planning_text, self._planned)
        self.worker.ask("begin", self._begin)
        self.worker.settle()
        self.worker.ask("icons", self.player.add_icon)

    def _build(self, scene: Scene) -> None:
        """Build the panel."""
        gui = self.server.gui
        setup = self.edited.setup
        ground = ground_of(setup.robot, scene.robot, setup.scene.obstacles)
        self.page = Page(self.server, self.gate, scene.name, ground)
        self.button = gui.add_button("Plan")
        self.button.on_click(lambda _: self.toggle())
        self.player = Player(self.server, self.worker, self.draw)
        self._next, self._badge = gui.add_html(""), gui.add_html("")
        self._held, self._clearance = gui.add_html(""), gui.add_html("")
        self._rows = gui.add_html("")
        self.live = gui.add_checkbox("live", True, hint="after each drag, plan the job again")
        self.looking = Looking(self.server, self.worker, self)
        self._legend = gui.add_html("")
        self.page.build()
        self.ways = gui.add_button_group("history", ("undo", "redo", "reset"), hint="reset: the original scene")
        self.ways.on_click(lambda event: self.go_back(str(event.target.value)))
        self.handles = JobHandles(self)
        self.player.build_speed(self.server)
        self.plots = JobPlots(self.server, self.page, self.worker, self.player)
        self.saving = JobSaving(self.server, self.worker, lambda: self.edited)
        with gui.add_folder("layers", expand_by_default=False):
            self.layers = JobLayers(self.server, self.worker, self.stage, lambda: self.player.draw())
        self._note = gui.add_html("")
        keys = common_keys(self.player, self.toggle, self.go_back, self.handles.deselect, self.looking.frame)
        self.keys = Keys(self.server, keys)
        self.page.on("stage", self._go_to_stage)

    # --- what is shown --------------------------------------------------------------------------------------------

    @property
    def verdict(self) -> str:
        """The text on the job and its stages, as HTML."""
        return str(self._next.content) + str(self._badge.content) + str(self._rows.content)

    def show(self, result: JobResult) -> None:
        """Show a planned job in place of what is shown, and wait until it is drawn. Raises InputError for one of
        another robot."""
        edited = self._alike(result.scene).done(result.trajectory, result.certificate, result.failure)
        self.worker.ask("show", lambda: self.change(edited))
        self.worker.settle()

    def follow(self, run: Run) -> JobResult:
        """Show a plan of the job that is made elsewhere: `run` is called with what takes its events and what tells
        whether to stop. Returns its result, or raises what it raises."""
        self.worker.ask("plan", lambda: self._say_next("planning the job …"))
        return self.planning.follow(self.edited, run)

    def take_scene(self, scene: Scene) -> None:
        """Show another scene of the same robot, as a step that can be undone. Raises InputError, and changes nothing,
        for any other."""
        edited = self._alike(scene)

        def job() -> None:
            self.change(edited)
            self.replan()

        self.worker.ask("show", job)

    def take_motion(self, trajectory: Trajectory) -> None:
        """Show a motion of the job that is shown, certified in its scene, as a step that can be undone."""

        def job() -> None:
            self.change(EditedJob.of(self.edited.scene).done(trajectory, certify_job(self.edited.scene, trajectory)))

        self.worker.ask("motion", job)

    def refuse(self, error: HdplanError) -> None:
        """Say why something was not taken. By any thread."""
        self.worker.ask("refused", lambda: self._say_next(str(error), bad=True))

    def _alike(self, scene: Scene) -> EditedJob:
        if scene.job is None or scene.robot != self.edited.scene.robot:
            raise InputError(f"{scene.source}: {OTHER_ROBOT}")
        return EditedJob.of(scene)

    def close(self) -> None:
        """End the threads and the server."""
        self.planning.end()
        self.player.end()
        self.worker.end()
        super().close()

    # --- the subject of the cameras -------------------------------------------------------------------------------

    @property
    def robot(self) -> Robot:
        """The robot that is shown."""
        return self.stage.drawn

    @property
    def obstacles(self) -> list[ObstacleNode]:
        """The objects, where they are drawn."""
        return self.stage.standing.nodes

    @property
    def ghosts(self) -> tuple[()]:
        """No robots that could be clicked."""
        return ()

    def postures(self) -> Array:
        """Return configurations (k, n) of the robot along the motion, or at the start."""
        setup, shown = self.edited.setup, self.edited.shown
        if shown is None:
            return setup.robot.configuration(setup.scene.start)[None]
        return few_of(shown.motion.joints)

    def paths(self) -> Array:
        """Return the path of the tip, and the objects' places (k, 3)."""
        places = np.array([each.pose.position for each in self.edited.setup.scene.obstacles]).reshape(-1, 3)
        return places if self.edited.shown is None else np.concatenate([self.edited.shown.motion.tip, places])

    def selected(self) -> ObstacleNode | None:
        """Return the object that is selected."""
        return self.handles.node

    def handle(self) -> Pose | None:
        """Return the pose of the handle; None: there is none."""
        thing = self.handles.thing
        return None if thing is None else self.edited.place_of(thing)

    def words(self) -> tuple[Label, ...]:
        """Return the labels that are not to be cut off, or lie over each other."""
        return (self.stage.closest.label,)

    # --- requests of browsers: by any thread ------------------------------------------------------------------------

    def toggle(self) -> None:
        """Plan, or stop."""
        if self.planning.running:
            self.planning.stop()
            self.worker.ask("message", self._say)
        else:
            self.worker.ask("plan", self.plan)

    def go_back(self, way: str) -> None:
        """Request "undo", "redo" or "reset"."""
        self.worker.ask(way, lambda: self._back(way))

    def _go_to_stage(self, _: object, message: Message) -> None:
        number, shown = message.get("to"), self.edited.shown
        if shown is not None and type(number) is int and 0 <= number < len(shown.certificate.stages):
            self.player.go_to(shown.certificate.stages[number].begins)

    # --- changes: by the worker's thread --------------------------------------------------------------------------

    def plan(self) -> None:
        """Request a plan of the job in the scene as it is."""
        self.planning.ask(self.edited)
        self._say()
        self._say_next("planning the job …")

    def replan(self) -> None:
        """Request a plan of the job after a change, if that is wanted."""
        if self.live.value:
            self.plan()

    def change(self, edited: EditedJob, step: bool = True, by_hand: bool = False) -> None:
        """Show another scene or motion: a step that can be undone, or a part of the last one, as what is dragged `by
        hand` is after the first movement. What another one changes leaves the hand."""
        before = self.edited
        if step:
            self.history.step(before)
        else:
            self.history.part()
        self._take(edited, by_hand)

    def _take(self, edited: EditedJob, by_hand: bool = False) -> None:
        if not by_hand:
            self.handles.leave()
        if edited.scene is not self.edited.scene:
            self.planning.give_up()  # what it finds is of an earlier scene
        self.edited = edited
        self._draw()

    def _back(self, way: str) -> None:
        if way == "reset":
            if self.edited is not self.first:
                self.change(self.first)
        elif way in ("undo", "redo"):
            move = self.history.undone if way == "undo" else self.history.redone
            self._take(move(self.edited))

    # --- drawing: by the worker's thread --------------------------------------------------------------------------

    def draw(self, now: float) -> None:
        """Draw the moment `now` of the timeline."""
        edited, shown = self.edited, self.edited.shown
        setup = edited.setup
        if shown is None:
            q = setup.robot.configuration(setup.scene.start)
            number: int | None = None
            pairs: tuple[Closest | None, Closest | None] = (None, None)
        else:
            number, pairs = shown.number_at(now), shown.closest(now)
            q = shown.motion.curve.at_time(np.array([now]))[0]
        with self.server.atomic():
            self.stage.show(q, now, pairs)
            self.looking.arrange()
            self.layers.show(q)
            words = "" if shown is None else clearance_words(self.player.timeline.words(now), pairs)
            self._clearance.content, self._held.content = words, held_words(edited, number)
            if number != self._stage_now:
                self._stage_now = number
                self._rows.content = stage_rows(edited, number)
            self.plots.follow(now)

    def _draw(self) -> None:
        """Draw all that does not follow from the time alone."""
        edited, shown = self.edited, self.edited.shown
        self._say()
        self.stage.take(edited)
        self.player.run_over(Timeline() if shown is None else Timeline.of(edited.setup.scene, [shown.motion.curve]))
        self.player.enable(shown is not None)
        self.handles.update()
        self.saving.outdate()
        self.plots.take(edited)
        self.player.draw()
        self.looking.fade()

    def _say(self) -> None:
        """Say what holds."""
        planning = self.planning.running
        self.button.label, self.button.icon = (
            ("Stop", viser.Icon.PLAYER_STOP) if planning else ("Plan", viser.Icon.ROUTE)
        )
        self._say_next(job_words(self.edited), bad=self.edited.shown is not None and not self.edited.certified)
        self._badge.content = job_badge(self.edited, planning)
        self._stage_now = None if self.edited.shown is None else self.edited.shown.number_at(self.player.time)
        self._rows.content, self._legend.content = stage_rows(self.edited, self._stage_now), job_legend(self.edited)

    def _say_next(self, words: str, bad: bool = False) -> None:
        self._next.content = next_words(words, bad)

    def _begin(self) -> None:
        self._draw()
        self._note.content = small(html.escape(self.stage.note))
        self.looking.begin()

    # --- what the planner says ------------------------------------------------------------------------------------

    def _planning_text(self, words: str) -> None:
        self.worker.ask("progress", lambda: self._say_next(words) if self.planning.running else None)

    def _planned(self, requested: EditedJob, found: EditedJob | None, why: str) -> None:
        self.worker.ask("planned", lambda: self._finish(requested, found, why))

    def _finish(self, requested: EditedJob, found: EditedJob | None, why: str) -> None:
        """Show a motion that was found, if the scene is still the one in which it was planned."""
        if found is not None and requested.scene is self.edited.scene:
            self.change(found)
        else:
            self._say()
            if found is None and requested.scene is self.edited.scene:
                self._say_next(why, bad=True)

    def _failed(self, error: Exception) -> None:
        """Say what a job of the worker could not do: what was refused has changed nothing, anything else is a fault of
        hdplan, after which no verdict is shown."""
        if isinstance(error, HdplanError):
            self._say_next(str(error), bad=True)
            return
        self.edited = EditedJob(self.edited.scene)
        text = FAILED.format(error=f"{type(error).__name__}: {error}")
        self._say()
        self._say_next(text, bad=True)
        self._complain(text)
