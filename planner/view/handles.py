"""Dragging: a handle on one obstacle, or on the goal, whose configuration follows by inverse kinematics.

Dragging a moving obstacle changes where it is at time 0; its motion from there stays the same. While something is
dragged, the body, the current clearance and the contacts of start and goal are updated; certificates and curves of the
motions are updated when it is released.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pinocchio as pin
from scipy.spatial.transform import Rotation

from hdplan.planner.view.drawing.goal import follow
from hdplan.planner.view.drawing.nodes import pose_of, wxyz_of
from hdplan.scenes.obstacles import Obstacle, TimedPoses
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.targets import JointTarget

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

NOTHING, GOAL = "nothing", "the goal"
REACHED = 1e-3  # [m] by which the tip may miss its handle without a message
SIZE = 0.18  # [m] of the handle


class Handles:
    """The choice of what is dragged, and its handle."""

    def __init__(self, viewer: Viewer) -> None:
        """Build the choice in the container at hand."""
        self._viewer = viewer
        self._names = {f"obstacle {obstacle.name}": i for i, obstacle in enumerate(viewer.scene.obstacles)}
        self.choice = viewer.server.gui.add_dropdown(
            "drag", (NOTHING, GOAL, *self._names), initial_value=NOTHING, hint="what gets a handle in the scene"
        )
        self._said = viewer.server.gui.add_html("")
        self._handle: Any = None
        self.choice.on_update(lambda _: viewer.worker.ask("handle", self._place))

    def drag(self, pose: Pose) -> None:
        """Move what has the handle to `pose`, as dragging does. Called by the worker's thread."""
        viewer = self._viewer
        if self.choice.value == GOAL:
            target = pin.SE3(pose.matrix)
            q, off = follow(viewer.tip, viewer.query.goal, target)
            viewer.move(replace(viewer.scene, goal=JointTarget("goal", positions=tuple(q.tolist()))))
            self._say(f"out of reach: the tip is {off * 1e3:.0f} mm short" if off > REACHED else "")
        elif self.choice.value in self._names:
            index = self._names[self.choice.value]
            viewer.move(_with(viewer.scene, index, moved(viewer.scene.obstacles[index], pose)))

    def let_go(self) -> None:
        """Update everything after dragging. Called by the worker's thread."""
        self._viewer.measure()
        self._place()

    def _place(self) -> None:
        """Put the handle where the chosen thing is."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
        if self.choice.value == NOTHING:
            self._say("")
            return
        viewer = self._viewer
        if self.choice.value == GOAL:
            place = viewer.tip.placement(viewer.query.goal)
            position, wxyz = place.translation, wxyz_of(place.rotation)
        else:
            obstacle = viewer.scene.obstacles[self._names[self.choice.value]]
            if obstacle.motion is not None:
                viewer.player.go_to(viewer.player.timeline.begin)
            self._say("" if obstacle.motion is None else "its handle is where it is at 0 s; it moves on as before")
            pose = obstacle.pose
            x, y, z, w = pose.quaternion_xyzw
            position, wxyz = pose.position, (w, x, y, z)
        handle = viewer.server.scene.add_transform_controls(
            "/handle", scale=SIZE, position=position, wxyz=wxyz, depth_test=False
        )
        handle.on_update(self._dragged)
        self._handle = handle

    def _dragged(self, event: Any) -> None:
        """Handle a browser's event."""
        self._viewer.worker.ask("drag", lambda: self.drag(pose_of(event.target)))
        if event.phase == "end":
            self._viewer.worker.ask("let go", self.let_go)

    def _say(self, text: str) -> None:
        self._said.content = f'<div style="padding:0 0.9em;font-size:0.8em">{text}</div>' if text else ""


def moved(obstacle: Obstacle, pose: Pose) -> Obstacle:
    """Return an obstacle that is at `pose` at time 0; one that moves keeps its velocity and spin at every time."""
    motion = obstacle.motion
    if not isinstance(motion, TimedPoses):
        return replace(obstacle, pose=pose)
    shift = pose.matrix[:3, 3] - obstacle.pose.matrix[:3, 3]
    turn = Rotation.from_quat(obstacle.pose.quaternion_xyzw).inv() * Rotation.from_quat(pose.quaternion_xyzw)
    poses = [
        Pose(
            tuple((each.matrix[:3, 3] + shift).tolist()),
            tuple((Rotation.from_quat(each.quaternion_xyzw) * turn).as_quat().tolist()),
        )
        for each in motion.poses[1:]
    ]
    return replace(obstacle, pose=pose, motion=replace(motion, poses=(pose, *poses)))


def _with(scene: Scene, index: int, obstacle: Obstacle) -> Scene:
    obstacles = list(scene.obstacles)
    obstacles[index] = obstacle
    return replace(scene, obstacles=tuple(obstacles))
