"""The viewer: one scene, its robot and its motions, the same in every browser that looks at it.

Everything is drawn by one thread (`Worker`); browsers only send requests. What is edited is a `Document`, which knows
no browser; `Stage` and `MotionNodes` draw it, `Panel` says it and changes it, and this one tells them what has become
another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import viser

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.document import Document
from hdplan.planner.view.drawing.motion import ShownMotion
from hdplan.planner.view.drawing.shading import two_toned
from hdplan.planner.view.drawing.skins import collision_skins, shown_skins
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.gate import Gate, Served
from hdplan.planner.view.motion_nodes import MotionNodes
from hdplan.planner.view.motions import Motions
from hdplan.planner.view.pulse import Pulse
from hdplan.planner.view.reported import Reported
from hdplan.planner.view.stage import Stage
from hdplan.planner.view.uploads import Uploads
from hdplan.planner.view.words import small
from hdplan.planner.view.worker import Worker
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError, naming
from hdplan.scenes.scene import Scene

if TYPE_CHECKING:
    from hdplan.planner.proof.reading import ReadProof
    from hdplan.planner.view.panel import Panel

LOADING = "loading the robot's meshes …"
FAILED = "hdplan failed here ({error}): the motions are not checked until the scene changes again"


class Viewer(Served):
    """A scene in the browsers of one server."""

    def __init__(
        self,
        server: viser.ViserServer,
        gate: Gate,
        setup: Setup,
        trajectories: Sequence[tuple[str, Trajectory]] = (),
        complain: Callable[[str], object] = lambda text: None,
        found: Callable[[Served], object] = lambda viewer: None,
    ) -> None:
        """Show a scene with some trajectories by name; `complain` is called with what goes wrong later, and `found`
        once all is checked: browsers may come from then on, and see everything at once, as soon as it is drawn.

        Raises InputError for start, goal, obstacles or trajectories that do not fit the robot.
        """
        self.server, self.gate = server, gate
        edited = Edited.of(setup, trajectories[0][1] if trajectories else None)
        self.document = Document(edited, self)
        self._complain = complain
        motions = []
        for name, trajectory in trajectories:
            with naming(name):  # several may have come, and one not fit
                motions.append(ShownMotion.of(name, trajectory, self.certifier))
        _ = edited.contacts  # refused before anything is shown
        loading = server.gui.add_html(small(LOADING))
        found(self)
        with server.atomic():
            loading.remove()
            self._build(motions)
        self.worker.ask("icons", self._add_icons)
        self.pulse = Pulse(self)

    def _build(self, motions: Sequence[ShownMotion]) -> None:
        """Draw everything, and build the panel."""
        from hdplan.planner.view.panel import Panel  # with the planner, while a browser loads its own part

        server = self.server
        skins, note = shown_skins(self.robot, self.scene.robot)
        skins = two_toned(self.robot, skins)
        self.worker, self.uploads = Worker(self._failed), Uploads()
        self.reported = Reported(self.robot)
        self.stage = Stage(server, self.edited, skins)
        through = collision_skins(self.robot) or skins
        self.motion_nodes = MotionNodes(server, self.robot, through, self.document)
        self.panel: Panel = Panel(self, note)
        self.worker.ask("begin", lambda: self._begin(motions))
        self.worker.settle()

    # --- what is shown --------------------------------------------------------------------------------------------

    @property
    def edited(self) -> Edited:
        """The scene as it is now, with a configuration for each end."""
        return self.document.edited

    @property
    def motions(self) -> Motions:
        """The motions as they are now."""
        return self.document.motions

    @property
    def scene(self) -> Scene:
        """The scene as it is now."""
        return self.edited.scene

    @property
    def robot(self) -> Robot:
        """The robot shown."""
        return self.edited.robot

    @property
    def certifier(self) -> Certifier:
        """The certifier in the scene as it is now."""
        return self.edited.certifier

    @property
    def configuration(self) -> Array:
        """The active robot's configuration at the moment that is shown (n,)."""
        active = self.motions.active
        return self.joints(active.motion.curve) if active else self.edited.start

    def joints(self, curve: Curve) -> Array:
        """Return a motion's configuration at the moment that is shown (n,)."""
        player = self.panel.player
        return curve.at_parameter(player.timeline.parameter(curve, player.time))

    def show(self, now: float) -> None:
        """Show the moment `now` of the timeline, and wait until it is drawn."""
        self.panel.player.go_to(now)
        self.worker.settle()

    def state(self, q: Sequence[float] | Array | Mapping[str, float] | None) -> None:
        """Show where the robot itself is, as it reports its joints: in the order of the scene's planned ones, or by
        name, where other joints are passed over. Of reports that come faster than they are drawn, the newest; None: it
        reports no more. Clearances are the reported robot's then; verdicts stay those of the motions.

        Returns at once. Raises InputError for values that are not one finite number for each planned joint.
        """
        self.reported.take(q)
        self.panel.player.draw()

    def show_proof(self, proof: ReadProof) -> None:
        """Switch on the layer with the planes of a proof, which is about the active motion in the scene as it is."""
        self.worker.ask("proof", lambda: self.panel.layers.show_proof(proof))
        self.worker.settle()

    def record(self, page: Path) -> None:
        """Write the motions as one page that needs no server. Raises InputError if it cannot be written."""
        from hdplan.planner.page.recorded_page import page_of

        page_of(self.edited.setup, [shown.motion for shown in self.motions.shown]).save(page)

    def close(self) -> None:
        """End the threads and the server."""
        self.pulse.end()
        self.panel.end()
        self.worker.end()
        self.uploads.close()
        super().close()

    # --- what the document says: by the worker's thread -----------------------------------------------------------

    def scene_changed(self, before: Scene) -> None:
        """Show the scene as it is now in place of an earlier one."""
        self.stage.take(self.edited)
        if self.scene is not before:
            self.panel.tree.follow(before)
            self.paint()
            self.panel.outdate()
            self._time()
        self.panel.update()
        self._say()
        self.panel.player.draw()
        self.panel.looking.fade()

    def motions_changed(self) -> None:
        """Draw all that does not follow from the time alone."""
        self.paint()
        self._time()
        self.panel.plot()
        self._say()
        self.panel.player.draw()

    def left(self) -> None:
        """Drop what is being planned from the active motion."""
        self.panel.live.forget()

    def doubted(self) -> None:
        """Take back the words about the motions: what is shown may be half drawn."""
        self.paint()
        self.panel.take_back()

    # --- drawing: by the worker's thread --------------------------------------------------------------------------

    def paint(self) -> None:
        """Draw the paths of the motions."""
        self.motion_nodes.paint(self.panel.layers.on("path"))

    def show_robot(self, q: Array) -> None:
        """Show the robot in a configuration (n,) that is not of the active motion, until a moment is drawn again."""
        self.stage.robot.show(q)

    def draw(self, now: float) -> None:
        """Draw the moment `now` of the timeline."""
        timeline, layers, active = self.panel.player.timeline, self.panel.layers, self.motions.active
        seconds, report = timeline.seconds(now), self.reported.newest
        q = self.configuration if report is None else report.q
        parameter = timeline.parameter(active.motion.curve, now) if active else 0.0
        with self.server.atomic():
            self.stage.robot.show(q)
            self.motion_nodes.show(
                lambda curve: timeline.parameter(curve, now), q, layers.on("robot"), report is not None
            )
            layers.show(q)
            pairs = self.certifier.closest(q, seconds)
            self.stage.show(q, seconds, layers.on("start and goal"), pairs)
            if any(node.motion is not None for node in self.stage.obstacles):
                self.panel.looking.fade()
            self.stage.name(report)
            self.panel.looking.arrange()
            layers.show_plane(parameter, pairs, reported=report is not None)
            self.panel.follow(now, q, pairs, report)

    def _say(self) -> None:
        """Say what holds, and show where the active motion fails."""
        active = self.motions.active
        self.stage.clash.show(None if active is None else active.motion, self.certifier)
        self.panel.say()

    def _add_icons(self) -> None:
        """Give buttons their icons, last: they take a while to be found."""
        self.panel.planning.add_icon()
        self.panel.player.add_icon()

    def _begin(self, motions: Sequence[ShownMotion]) -> None:
        for motion in motions:
            self.motions.add(motion)
        if motions:
            self.motions.active = self.motions.shown[0]
        self.panel.update()
        self.motions_changed()
        self.panel.looking.begin()

    def _time(self) -> None:
        """Let the slider run over what moves."""
        timeline = Timeline.of(self.scene, [shown.motion.curve for shown in self.motions.shown])
        self.panel.player.run_over(timeline)
        self.panel.player.enable(bool(self.motions.shown) or timeline.timed)

    def _failed(self, error: Exception) -> None:
        """Say what a job could not do: what was refused has changed nothing, anything else is a fault of hdplan."""
        if isinstance(error, HdplanError):
            self.panel.say_next(str(error), bad=True)
            return
        self.document.doubt()
        self.panel.say_next(FAILED.format(error=f"{type(error).__name__}: {error}"), bad=True)
        self._complain(f"{type(error).__name__}: {error}")
