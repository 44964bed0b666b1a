"""Scenes and motions that a browser sends: a scene takes the place of the one that is shown, a motion is certified in
it and shown with the others."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import viser

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.motion.trajectory_files import READERS
from hdplan.planner.robot.scene_robot import are_alike
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.edit_steps import Editing
from hdplan.planner.view.edited_scene import Edited
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.scene import SCENE_FILES
from hdplan.scenes.yaml_format.reader import load_scene

if TYPE_CHECKING:
    from pathlib import Path

    from hdplan.planner.view.viewer import Viewer

ENDINGS = (*READERS, ".scene")
OTHER_ROBOT = "is a scene of another robot or of other planned joints: open it with hdplan view"
_MESSAGE = re.compile(rb"""^[{\s]*["']?(joint_names|(multi_dof_)?joint_trajectory)["']?\s*:""", re.MULTILINE)  # of ROS


class Opening:
    """The button."""

    def __init__(self, viewer: Viewer, editing: Editing) -> None:
        """Build it in the container at hand."""
        self._viewer, self._editing = viewer, editing
        button = viewer.server.gui.add_upload_button(
            "Open scene or motion", icon=viser.Icon.UPLOAD, mime_type=",".join(ENDINGS)
        )
        button.on_upload(lambda event: editing.do(partial(self.open, event.target.value)))

    def open(self, file: Any) -> None:
        """Show the scene, or the motion, of a file that a browser sent. Raises InputError, and changes nothing, for any
        other file. By the worker's thread."""
        path = self._viewer.uploads.take(file.name, file.content, ENDINGS)
        is_scene = path.suffix.lower() in (*SCENE_FILES, ".scene") and not _MESSAGE.search(file.content)
        (self._take_scene if is_scene else self._take_motion)(path)

    def _take_scene(self, path: Path) -> None:
        viewer, setup = self._viewer, Setup.of(load_scene(path))
        if not are_alike(setup.robot, viewer.robot):
            raise InputError(f"{path}: {OTHER_ROBOT}")
        edited = Edited.of(replace(setup, robot=viewer.robot))
        self._editing.apply("open", lambda _: edited)
        self._editing.say(f"opened: the scene {setup.scene.name}")

    def _take_motion(self, path: Path) -> None:
        trajectory = Trajectory.load(path)
        with naming(path):
            certificate = self._viewer.put(path.name.split(".")[0], trajectory)
        self._editing.say(f"opened: {path.name}, {certificate.text}")
