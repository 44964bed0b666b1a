"""Scenes and motions that a browser sends, or that change on disk: a scene takes the place of the one that is shown, a
motion is certified in it and shown with the others."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
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
from hdplan.planner.view.watch import Source, Watch
from hdplan.scenes.errors import InputError, naming
from hdplan.scenes.scene import SCENE_FILES, Scene
from hdplan.scenes.shapes import files_of
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

    def follow(
        self, scene: Callable[[], Scene], files: Sequence[Path], motions: Sequence[tuple[str, Path]] = ()
    ) -> Watch:
        """Open a scene and motions again whenever their files change: the scene's own, its meshes, and each motion's.
        By any thread."""
        meshes: list[Path] = _meshes(self._viewer.scene)

        def read() -> None:
            again = scene()
            meshes[:] = _meshes(again)
            self.take_scene(again)

        sources = [Source(lambda: (*files, *meshes), lambda: self._editing.do(read))]
        for name, file in motions:
            again = partial(self.take_motion, file, name)
            sources.append(Source(partial(_one, file), partial(self._editing.do, again)))
        return Watch(sources)


def _meshes(scene: Scene) -> list[Path]:
    """The files of obstacles and held objects."""
    shapes = [each.shape for each in scene.obstacles] + [each.shape for each in scene.attached]
    return [file for shape in shapes for file in files_of(shape)]


def _one(file: Path) -> tuple[Path]:
    return (file,)
