"""Everything in the scene besides the motions: obstacles, start and goal as ghosts, the robot, the closest pairs."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial

import numpy as np
import viser

from hdplan.planner.certificate.verdict import Closest
from hdplan.planner.view.drawing.clash import ClashNode
from hdplan.planner.view.drawing.clouds import CloudNode
from hdplan.planner.view.drawing.colors import GOAL, START
from hdplan.planner.view.drawing.labels import Label
from hdplan.planner.view.drawing.motion import Tip, shortened
from hdplan.planner.view.drawing.nodes import ClosestNodes, ObstacleNode, RobotNodes, draw_left_out, draw_region
from hdplan.planner.view.drawing.skins import INSET, Skin, collision_skins
from hdplan.planner.view.drawing.standing import Standing
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.reported import Report
from hdplan.planner.view.things import GOAL as THE_GOAL, START as THE_START, Thing
from hdplan.planner.view.words import contact_words
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import read_only

GHOST = 0.35  # opacity
UP = read_only(np.array([0.0, 0.0, 1.0]))


class Stage:
    """The nodes of one scene; all but `__init__` is called by the viewer's one thread."""

    def __init__(self, server: viser.ViserServer, edited: Edited, skins: tuple[Skin, ...]) -> None:
        """Send everything that stands; `skins` are the robot's looks."""
        robot = edited.robot
        self.tip = Tip.of(robot)
        self.standing = Standing(server)
        self._handled = ""  # the kind of what has a handle, in whose place no label is read
        regions = edited.scene.path.regions  # where a point of a link is to stay
        self.region = draw_region(server, *regions) if regions else None
        solid = [skin for skin in collision_skins(robot) or skins if skin.joint]  # what stands still is there once
        self.start = RobotNodes(server, "start", robot, solid, color=START, opacity=GHOST, inset=INSET)
        self.goal = RobotNodes(server, "goal", robot, solid, color=GOAL, opacity=GHOST, inset=2.0 * INSET)
        self.labels = [Label(server, f"/label of {name}", name, visible=True) for name in ("start", "goal")]
        self.robot = RobotNodes(server, "robot", robot, skins)  # where it says it is, the active motion, or the start
        self.report_label = Label(server, "/label of robot")
        self.closest = ClosestNodes(server)
        self.clash = ClashNode(server)
        image = edited.setup.filtered_points
        self.left_out = None if image is None or not len(image) else draw_left_out(server, image)
        self.take(edited)

    def take(self, edited: Edited) -> None:
        """Show another scene of the same robot: what stays is moved, what is new is sent. Start and goal are drawn with
        what they touch in the colour of contact, and words there say so."""
        self.standing.take(edited.read.obstacles)
        for ghost, label, name, q, contacts in zip(
            (self.start, self.goal),
            self.labels,
            ("start", "goal"),
            (edited.start, edited.goal),
            edited.contacts,
            strict=True,
        ):
            ghost.show(q)
            ghost.mark({link for contact in contacts for link in (contact.link, contact.other)})
            label.text = name if not contacts else shortened(f"{name}: {contact_words(contacts[:1])}")
            label.place = self.tip.placement(q).translation + 0.06 * UP
        touched = {contact.other for contacts in edited.contacts for contact in contacts}
        for each in self.obstacles:
            each.mark(each.obstacle.name in touched)

    def show(self, q: Array, seconds: float, ghosts: bool, pairs: tuple[Closest | None, Closest | None]) -> None:
        """Draw a moment: obstacles where they are at a time [s], `ghosts` where the robot at `q` (n,) does not stand,
        and the closest pairs."""
        for obstacle in self.obstacles:
            obstacle.show(seconds)
        for ghost in (self.start, self.goal):
            ghost.visible = ghosts and not _same(ghost.q, q)
        for name, label in zip(("start", "goal"), self.labels, strict=True):  # also where the robot stands there
            label.visible = ghosts and name != self._handled
        self.closest.show(pairs)

    def name(self, report: Report | None) -> None:
        """Label the robot that reports its state, at its place; None: no robot does."""
        label = self.report_label
        if report is not None:
            label.place = self.tip.placement(report.q).translation + 0.12 * UP
            label.text = report.words
        label.visible = report is not None

    def on_click(self, chosen: Callable[[Thing, bool], object]) -> None:
        """Name the listener to clicks: it gets what was clicked, and whether that is to be selected beside what is."""
        for thing, ghost in ((THE_START, self.start), (THE_GOAL, self.goal)):
            for link in ghost.links:
                link.clicks.listen(partial(chosen, thing))
        self.standing.on_click(lambda name, more: chosen(Thing("obstacle", name), more))

    @property
    def words(self) -> tuple[Label, ...]:
        """The labels that are not to lie over each other, from the one that stays to the one that gives way most."""
        return *self.labels, self.report_label, self.clash.label, self.closest.label

    @property
    def obstacles(self) -> list[ObstacleNode]:
        """The nodes of the obstacles."""
        return self.standing.nodes

    @property
    def clouds(self) -> list[CloudNode]:
        """The obstacles that are clouds of points."""
        return [node for node in self.obstacles if isinstance(node, CloudNode)]

    def highlight(self, thing: Thing | None, obstacles: Collection[str]) -> None:
        """Show what is selected, of the obstacles these; labels make room for its handle."""
        self.closest.labelled = thing is None
        self._handled = "" if thing is None else thing.kind
        for node in self.obstacles:
            node.select(node.obstacle.name in obstacles)
        for kind, ghost in (("start", self.start), ("goal", self.goal)):
            ghost.select(thing is not None and thing.kind == kind)


def _same(a: Array | None, b: Array) -> bool:
    """True if two robots stand in each other's place, where their surfaces would flicker."""
    return a is not None and bool(np.abs(a - b).max() < 1e-3)
