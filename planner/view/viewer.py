"""The viewer: one scene, its robot and its motions, the same in every browser that looks at it.

Everything is drawn by one thread (`Worker`); browsers only send requests. The other modules here hold the parts.
"""

from __future__ import annotations

import html
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import viser

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.certificate.verdict import Certificate, Contact
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.search.goals import settled
from hdplan.planner.view.drawing.colors import CONTACT, GOAL, OTHERS, START, clearance_colors, hex_of, legend
from hdplan.planner.view.drawing.motion import ShownMotion, Tip
from hdplan.planner.view.drawing.nodes import (
    ClosestNodes,
    ObstacleNode,
    RobotNodes,
    draw_path,
    draw_region,
    millimetres,
)
from hdplan.planner.view.drawing.plots import MotionPlots, joint_table
from hdplan.planner.view.drawing.skins import Color, Skin, collision_skins, visual_skins
from hdplan.planner.view.drawing.timeline import Timeline
from hdplan.planner.view.layers import Layers
from hdplan.planner.view.planning import Planning
from hdplan.planner.view.player import Player
from hdplan.planner.view.quiet import quiet
from hdplan.planner.view.recording import record
from hdplan.planner.view.worker import Worker
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError, InputError, naming
from hdplan.scenes.once import read_only
from hdplan.scenes.scene import Scene

GHOST = 0.35  # opacity
PLOT_EVERY = 0.1  # [s] between movements of the plots' bars while the slider moves
FAINT: Color = (190, 190, 190)
UP = read_only(np.array([0.0, 0.0, 1.0]))
OUTDATED = "the scene is being changed: nothing is known of this motion in it yet"


@dataclass(eq=False)
class Shown:
    """A motion with its nodes in the scene."""

    motion: ShownMotion
    robot: RobotNodes
    path: Any  # viser's node


class Viewer:
    """A scene in the browsers of one server."""

    def __init__(
        self,
        server: viser.ViserServer,
        setup: Setup,
        trajectories: Sequence[tuple[str, Trajectory]] = (),
        complain: Callable[[str], object] = lambda text: None,
    ) -> None:
        """Show a scene with some trajectories by name; `complain` is told of what goes wrong later.

        Raises InputError for start, goal, obstacles or trajectories that do not fit the robot.
        """
        setup = settled(setup, trajectories[0][1] if trajectories else None)  # dragging and planning share one goal
        scene, robot = setup.scene, setup.robot
        self.server, self.scene, self.robot = server, scene, robot
        self.query, self.certifier = setup.query, Certifier(setup)
        self.tip = Tip.of(robot)
        self.contacts: tuple[tuple[Contact, ...], tuple[Contact, ...]] = ((), ())  # of start and goal
        self._complain = complain
        motions = []
        for name, trajectory in trajectories:
            with naming(name):  # several may have come, and one not fit
                motions.append(ShownMotion.of(name, trajectory, self.certifier))
        self.skins, self.note = _skins(scene, robot)
        self.worker = Worker(self._failed)

        _look_from(server, robot, self.query.start)
        base = scene.robot.base.position
        server.scene.add_grid(
            "/ground",
            3.0,
            3.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(236, 236, 236),
            section_color=(215, 215, 215),
            position=base,
        )
        self.obstacles = [ObstacleNode(server, index, obstacle) for index, obstacle in enumerate(scene.obstacles)]
        region = scene.path.position
        self.region = draw_region(server, region) if region else None  # where a point of a link is to stay
        solid = [skin for skin in collision_skins(robot) or self.skins if skin.joint]  # what stands still is there once
        self.start = RobotNodes(server, "start", robot, solid, color=START, opacity=GHOST)
        self.goal = RobotNodes(server, "goal", robot, solid, color=GOAL, opacity=GHOST)
        self.labels = [
            server.scene.add_label(f"/{name}/label", name, font_screen_scale=0.9) for name in ("start", "goal")
        ]
        self.at_rest = RobotNodes(server, "robot", robot, self.skins)  # where there is no motion yet
        self.closest = ClosestNodes(server)
        self.shown: list[Shown] = []

        self._verdict = server.gui.add_html("")
        self.player = Player(server, self.worker, self._show)
        self._clearance = server.gui.add_html("")
        self._legend = server.gui.add_html(legend())
        self._choice = server.gui.add_dropdown("motion", ("none",), hint="whose joints, clearance and closest pair")
        self._choice.on_update(lambda _: self.worker.ask("choice", self._redraw))
        self.tabs = server.gui.add_tab_group()
        self._plot_tab = self.tabs.add_tab("Plots", viser.Icon.CHART_LINE)
        with self.tabs.add_tab("Joints", viser.Icon.ROBOT):
            self._table = server.gui.add_html("")
        with self.tabs.add_tab("Plan", viser.Icon.ROUTE):
            self.planning = Planning(self)
        with self.tabs.add_tab("Layers", viser.Icon.STACK_2):
            self.layers = Layers(self)
        self._plots: MotionPlots | None = None
        self._plotted = 0.0

        server.on_client_disconnect(lambda _: self.worker.ask("measure", self.measure))  # perhaps while it dragged
        self.worker.ask("begin", lambda: self._begin(motions))
        self.worker.settle()

    # --- for the other parts -------------------------------------------------------------------------------------

    @property
    def port(self) -> int:
        """The port on which it is served."""
        return int(self.server.get_port())

    @property
    def active(self) -> Shown | None:
        """The motion whose joints and clearance are shown."""
        named = [shown for shown in self.shown if shown.motion.name == self._choice.value]
        return named[0] if named else None

    @property
    def verdict(self) -> str:
        """What is written at the top, as HTML."""
        return str(self._verdict.content)

    def choose(self, name: str) -> None:
        """Make a motion the active one."""
        self._choice.value = name

    @property
    def configuration(self) -> Array:
        """The active robot's configuration at the moment that is shown (n,)."""
        return self.joints(self.active.motion.curve) if self.active else self.query.start

    def joints(self, curve: Curve) -> Array:
        """Return a motion's configuration at the moment that is shown (n,)."""
        return curve.at_parameter(self.player.timeline.parameter(curve, self.player.time))

    def put(self, name: str, trajectory: Trajectory, certificate: Certificate | None = None) -> Certificate:
        """Add a motion, or replace the one of that name, and make it the active one; return what holds of it in the
        scene as it is now: `certificate`, if it is of this scene. By the worker's thread."""
        motion = ShownMotion.of(name, trajectory, self.certifier, certificate)
        self._add(motion)
        self._redraw()
        return motion.certificate

    def move(self, scene: Scene) -> None:
        """Show the same scene with obstacles or goal elsewhere. Motions stay as they are, and what was said of them
        falls until they are measured again. By the worker's thread. Raises InputError, and moves nothing, for a scene
        that does not fit the robot."""
        setup = Setup(scene, self.robot)
        query, certifier = setup.query, Certifier(setup)
        held = [shown for shown in self.shown if self.holds(shown.motion)]
        self.scene, self.query, self.certifier = scene, query, certifier
        for node, obstacle in zip(self.obstacles, scene.obstacles, strict=True):
            node.take(obstacle)
        for shown in held:
            shown.path = self._draw_path(shown.motion, FAINT)
        if held and self._plots is not None:
            self._plots.outdate()
        self.planning.outdate()
        self._show_ends()
        self._show_verdict()
        self._show(self.player.time)

    def holds(self, motion: ShownMotion) -> bool:
        """Whether what is known of a motion is of the scene as it is now."""
        return motion.scene is self.scene

    def show_robot(self, name: str, q: Array) -> None:
        """Show the robot of a motion in a configuration (n,) that is not of this motion, until a moment is drawn again;
        another robot if there is no such motion yet. By the worker's thread."""
        robot = next((shown.robot for shown in self.shown if shown.motion.name == name), self.at_rest)
        robot.visible = self.layers.on("robot")
        robot.show(q)

    def measure(self) -> None:
        """Certify and sample the motions again that are not of the scene as it is now. By the worker's thread."""
        outdated = [shown for shown in self.shown if not self.holds(shown.motion)]
        for shown in outdated:
            motion = ShownMotion.of(shown.motion.name, shown.motion.trajectory, self.certifier)
            shown.motion = motion
            shown.path = self._draw_path(motion)
        if outdated:
            self._redraw()

    def show(self, now: float) -> None:
        """Show the moment `now` of the timeline, and wait until it is drawn."""
        self.player.go_to(now)
        self.worker.settle()

    def record(self, page: Path) -> None:
        """Write the motions as one page that needs no server; see `recording`."""
        record(self, page)

    def close(self) -> None:
        """End the threads and the server."""
        self.planning.end()
        self.player.end()
        self.worker.end()
        with quiet():
            self.server.stop()

    # --- drawing: by the worker's thread --------------------------------------------------------------------------

    def _begin(self, motions: Sequence[ShownMotion]) -> None:
        for motion in motions:
            self._add(motion)
        self._redraw()

    def _add(self, motion: ShownMotion) -> None:
        number = next((i for i, shown in enumerate(self.shown) if shown.motion.name == motion.name), len(self.shown))
        if number < len(self.shown):
            self.shown[number].motion, self.shown[number].path = motion, self._draw_path(motion)
        else:
            color = OTHERS[(number - 1) % len(OTHERS)] if number else None
            skins = [skin for skin in self.skins if skin.joint or not number]  # what stands still is there once
            visible = self.layers.on("robot")
            nodes = RobotNodes(self.server, f"robot{number}", self.robot, skins, color=color, visible=visible)
            self.shown.append(Shown(motion, nodes, self._draw_path(motion)))
            self._choice.options = tuple(shown.motion.name for shown in self.shown)
            self._plots = self._new_plots()
        self._choice.value = motion.name if number else self.shown[0].motion.name
        self._choice.visible = len(self.shown) > 1

    def _draw_path(self, motion: ShownMotion, color: Color | None = None) -> Any:
        """Draw a motion's path by its clearance, or in one colour where that is not known."""
        name = "path/" + "".join(c if c.isalnum() else "_" for c in motion.name)
        path = draw_path(self.server, name, motion.tip, color or clearance_colors(motion.clearance))
        path.visible = self.layers.on("path")
        return path

    def _new_plots(self) -> MotionPlots:
        if self._plots is not None:
            self._plots.remove()
        with self._plot_tab:
            return MotionPlots(self.server, self.robot.joint_names, [shown.motion.name for shown in self.shown])

    def _redraw(self) -> None:
        """Draw all that does not follow from the time alone."""
        self._show_ends()
        active = self.active
        self.at_rest.visible = not self.shown and self.layers.on("robot")
        timeline = Timeline.of(self.scene, [shown.motion.curve for shown in self.shown])
        self.player.run_over(timeline)
        self.player.enable(bool(self.shown) or timeline.timed)
        if active is not None and self._plots is not None:
            self._plots.set(active.motion, [shown.motion for shown in self.shown], timeline, self.player.time)
        self._show_verdict()
        self._show(self.player.time)

    def _show(self, now: float) -> None:
        """Draw the moment `now` of the timeline."""
        timeline = self.player.timeline
        with self.server.atomic():
            for shown in self.shown:
                curve = shown.motion.curve
                shown.robot.show(curve.at_parameter(timeline.parameter(curve, now)))
            for obstacle in self.obstacles:
                obstacle.show(timeline.seconds(now))
            q = self.configuration
            if not self.shown:
                self.at_rest.show(q)
            self.layers.show(q)
            for ghost in (self.start, self.goal):
                ghost.visible = self.layers.on("start and goal") and not _same(ghost.q, q)
            pairs = self.certifier.closest(q, timeline.seconds(now))
            self.closest.show(pairs)
            self._clearance.content = _clearance_words(timeline.words(now), pairs)
            self._table.content = joint_table(self.robot.joint_names, q, self.robot.lower, self.robot.upper)
        if self._plots is not None and (time.perf_counter() - self._plotted > PLOT_EVERY or not self.player.playing):
            self._plots.follow(now)
            self._plotted = time.perf_counter()

    def _show_ends(self) -> None:
        """Draw start and goal, with what they touch in the colour of contact, and say it in place."""
        ends = (self.query.start, self.query.goal)
        self.contacts = (
            self.certifier.contacts(ends[0]),
            self.certifier.contacts(ends[1], self.scene.end_time),
        )
        for node, label, name, q, contacts in zip(
            (self.start, self.goal), self.labels, ("start", "goal"), ends, self.contacts, strict=True
        ):
            node.show(q)
            node.mark({link for contact in contacts for link in (contact.link, contact.other)})
            label.text = name if not contacts else f"{name}: {contact_words(contacts[:1])}"
            label.position = self.tip.placement(q).translation + 0.06 * UP
        touched = {contact.other for contacts in self.contacts for contact in contacts}
        for obstacle in self.obstacles:
            obstacle.mark(obstacle.obstacle.name in touched)

    def _show_verdict(self) -> None:
        lines = [
            _line(f"{name} is in collision: {contact_words(contacts)}", CONTACT)
            for name, contacts in zip(("start", "goal"), self.contacts, strict=True)
            if contacts
        ]
        for number, shown in enumerate(self.shown):
            certificate = shown.motion.certificate
            color = hex_of(OTHERS[(number - 1) % len(OTHERS)]) if number else "#dddddd"
            mark = f'<span style="color:{color}">●</span> ' if len(self.shown) > 1 else ""
            extent = "" if shown.motion.curve.times is None else f" ({shown.motion.trajectory.extent})"
            name = f"<b>{html.escape(shown.motion.name)}</b>{extent} " if len(self.shown) > 1 else ""
            tint = START if certificate.certified else CONTACT
            said = _line(certificate.text, tint) if self.holds(shown.motion) else OUTDATED
            lines.append(f"{mark}{name}{said}")
        if not self.shown:
            lines.append("no motion yet: press Plan")
        lines += [html.escape(self.note)] if self.note else []
        text = "<br/>".join(lines)
        self._verdict.content = f'<div style="padding:0.2em 0.9em;font-size:0.85em">{text}</div>'

    def _failed(self, error: Exception) -> None:
        if not isinstance(error, HdplanError):
            self._complain(f"{type(error).__name__}: {error}")
        self._verdict.content = _line(str(error), CONTACT)


def _same(a: Array | None, b: Array) -> bool:
    """Whether two robots stand in each other's place, where their surfaces would flicker."""
    return a is not None and bool(np.abs(a - b).max() < 1e-3)


def contact_words(contacts: Sequence[Contact]) -> str:
    """Say which bodies touch, the deepest first, three at most."""
    return "; ".join(
        f"{c.link} and {c.other} " + (f"overlap by {c.depth * 1e3:.3g} mm" if c.depth else "touch")
        for c in contacts[:3]
    )


def _line(text: str, color: tuple[int, int, int]) -> str:
    return f'<span style="color:{hex_of(color)}">{html.escape(text)}</span>'


def _clearance_words(now: str, pairs: Sequence[Any]) -> str:
    words = [
        f"{name} <b>{millimetres(pair.distance)}</b> ({html.escape(pair.link)} – {html.escape(pair.other)})"
        for name, pair in zip(("to obstacles", "between links"), pairs, strict=True)
        if pair is not None
    ]
    return (
        f'<div style="padding:0 0.9em;font-size:0.8em">clearance at {now}, exact:<br/>'
        f"{'<br/>'.join(words) or 'nothing to touch'}</div>"
    )


def _skins(scene: Scene, robot: Robot) -> tuple[Sequence[Skin], str]:
    """What the robot is shown in, and a word where that is not all its visual meshes."""
    try:
        skins, left_out = visual_skins(robot, scene.robot)
    except InputError as error:
        skins, left_out = (), (str(error),)
    if skins:
        return skins, f"left out of the picture: {'; '.join(left_out)}" if left_out else ""
    why = "; ".join(left_out) or "its URDF has no visual meshes"
    return collision_skins(robot), f"{robot.name} is shown in its collision meshes: {why}"


def _look_from(server: viser.ViserServer, robot: Robot, q: Array) -> None:
    """Set where browsers look from when they come: from the front and the side, at the robot's middle."""
    base = robot.model.frames[1].placement.translation if robot.model.nframes > 1 else np.zeros(3)
    tip = Tip.of(robot)
    far = max(float(np.linalg.norm(tip.placement(q).translation - base)), 0.6)
    server.initial_camera.look_at = tuple(base + [0.25 * far, 0.0, 0.52 * far])
    server.initial_camera.position = tuple(base + far * np.array([1.45, -1.15, 0.9]))
