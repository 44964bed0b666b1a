"""Scenes and motions that a browser sends, or that change on disk: a scene takes the place of the one that is shown, a
motion is certified in it and shown with the others."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.motion.trajectory_files import READERS
from hdplan.planner.robot.scene_robot import are_alike
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.edit_steps import Editing
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.watch import Seen, Source, Watch
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.scene import SCENE_FILES, Scene
from hdplan.scenes.yaml_format.reader import load_scene

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer

ENDINGS = (*READERS, ".scene")
OTHER_ROBOT = "is a scene of another robot or of other planned joints: open it with hdplan view"
_MESSAGE = re.compile(rb"""^[{\s]*["']?(joint_names|(multi_dof_)?joint_trajectory)["']?\s*:""", re.MULTILINE)  # of ROS


class Opening:
    """The button."""

    def __init__(self, viewer: Viewer, editing: Editing) -> None:
        """Build it in the container at hand."""
        self._viewer, self._editing = viewer, editing
        button = viewer.server.gui.add_upload_button("Open scene or motion", mime_type=",".join(ENDINGS))
        button.on_upload(lambda event: editing.do(partial(self.open, event.target.value)))

    def open(self, file: Any) -> None:
        """Show the scene, or the motion, of a file that a browser sent. Raises InputError, and changes nothing, for any
        other file. By the worker's thread."""
        path = self._viewer.uploads.take(file.name, file.content, ENDINGS)
        is_scene = path.suffix.lower() in (*SCENE_FILES, ".scene") and not _MESSAGE.search(file.content)
        if is_scene:
            self.take_scene(load_scene(path))
        else:
            self.take_motion(path, path.name.split(".")[0])

    def take_scene(self, scene: Scene) -> None:
        """Show a scene in place of the one that is shown. Raises InputError, and changes nothing, for one of another
        robot. By the worker's thread."""
        viewer, setup = self._viewer, Setup.of(scene)
        if not are_alike(setup.robot, viewer.robot):
            raise InputError(f"{scene.source}: {OTHER_ROBOT}")
        edited = Edited.of(replace(setup, robot=viewer.robot))
        with viewer.panel.tree.replaced():
            self._editing.apply("open", lambda _: edited)
        self._editing.say(f"opened: the scene {setup.scene.name}")

    def take_motion(self, path: Path, name: str) -> None:
        """Show the motion of a file under a name. Raises InputError, and changes nothing, for a file that holds none
        for this robot. By the worker's thread."""
        trajectory = Trajectory.load(path)
        with naming(path):
            certificate = self._viewer.document.put(name, trajectory)
        self._editing.say(f"opened: {path.name}, {certificate.text}")

    def follow(self, load: Callable[[], Scene], files: Seen, meshes: Seen, motions: Mapping[str, Seen]) -> Watch:
        """Open the scene that `load` reads again whenever its files or meshes change, and the motions by name whenever
        theirs do; all files as they were before they were read. By any thread."""
        do = self._editing.do
        sources = [
            Source.of_scene(files, meshes, load, lambda scene: do(partial(self.take_scene, scene)), self._editing.fail)
        ]
        for name, files in motions.items():
            (file,) = files
            sources.append(Source(files, partial(do, partial(self.take_motion, file, name))))
        return Watch(sources)
