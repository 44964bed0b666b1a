"""Saving the scene and the motion: a saved file is valid at that moment, as a motion is certified once more in the
scene that is saved with it.

Files are sent to the browser that requested them, as downloads: a browser cannot write anything on the server's
machine.
"""

from __future__ import annotations

import html
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hdplan.planner.certificate.certifier import Certifier
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view.words import small
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.scene import SCENE_FILES, Scene
from hdplan.scenes.shapes import files_of
from hdplan.scenes.targets import JointTarget
from hdplan.scenes.yaml_format.writer import scene_text

if TYPE_CHECKING:
    from hdplan.planner.view.viewer import Viewer


class Saving:
    """The two buttons, and what they write."""

    def __init__(self, viewer: Viewer) -> None:
        """Build them in the container at hand."""
        self._viewer = viewer
        gui = viewer.server.gui
        scene = gui.add_button("Save scene")
        motion = gui.add_button("Save motion")
        self._text = gui.add_html("")
        self._about: tuple[object, object] = None, None  # the scene and the motion that the text describes
        scene.on_click(lambda event: self._download(event, f"{viewer.scene.name}.yaml", self.scene_file))
        motion.on_click(lambda event: self._download(event, "motion.json", self.motion_file))

    def scene_file(self) -> bytes:
        """The scene as it is shown, as a file that any command takes. Raises InputError if none would."""
        scene, _ = self.standing_alone()
        text = scene_text(scene).replace(f"{self._viewer.uploads.folder}/", "")
        names = ", ".join(file.name for file in self._sent())
        self.say("saved: the scene as it is shown" + (f"; keep {names} beside it" if names else ""))
        return text.encode()

    def _sent(self) -> tuple[Path, ...]:
        """The mesh files of the scene that a browser sent: they are gone when the viewer ends."""
        scene = self._viewer.scene
        shapes = [each.shape for each in scene.obstacles] + [each.shape for each in scene.attached]
        return self._viewer.uploads.of([file for shape in shapes for file in files_of(shape)])

    def motion_file(self) -> bytes:
        """The active motion as JSON, with verdict and steps if it was planned here: certified now, in the scene that
        `scene_file` gives now."""
        active = self._viewer.motions.active
        if active is None:
            raise HdplanError("there is no motion yet: press Plan")
        scene, certifier = self.standing_alone()
        trajectory = active.motion.trajectory
        certificate = certifier.certify(trajectory)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "motion.json"
            if active.result is not None:
                replace(active.result, scene=scene.name, certificate=certificate).save(file)
            else:
                trajectory.save(file)
            data = file.read_bytes()
        self.say(f"saved: {certificate.text}")
        return data

    def standing_alone(self) -> tuple[Scene, Certifier]:
        """The scene with its ends as joint values, or poses, and the held joints where they are held, whatever file it
        came from, and its certifier. Raises InputError for a scene that could not be read again."""
        viewer = self._viewer
        edited, scene = viewer.edited, viewer.scene
        start = JointTarget("start", positions=tuple(edited.start.tolist()))
        goal = scene.goal
        if isinstance(goal, JointTarget):
            goal = JointTarget("goal", positions=tuple(edited.goal.tolist()))
        spec = replace(scene.robot, locked=dict(viewer.robot.locked))
        scene = replace(scene, robot=spec, start=start, goal=goal)
        setup = Setup.of(scene)
        for target in (start, goal):
            if isinstance(target, JointTarget):
                setup.robot.configuration(target, scene.from_request)  # refused early
        return scene, Certifier(setup)

    def outdate(self) -> None:
        """Withdraw the words about a file, as scene or motion are others by now."""
        if self._text.content and any(one is not two for one, two in zip(self._about, self.now(), strict=True)):
            self._text.content = ""

    def now(self) -> tuple[object, object]:
        """Return the scene and the active motion that the words may describe."""
        active = self._viewer.motions.active
        return self._viewer.edited, None if active is None else active.motion.trajectory

    def say(self, text: str) -> None:
        """Say something of the scene and the active motion as they are now."""
        self._about = self.now()
        self._text.content = small(html.escape(text))

    def _download(self, event: Any, name: str, content: Callable[[], bytes]) -> None:
        """Handle a browser's request for a file: the worker makes it, so that nothing moves meanwhile."""
        self._viewer.worker.ask(f"{name} for {event.client_id}", lambda: self._hand_over(event, name, content))

    def _hand_over(self, event: Any, name: str, content: Callable[[], bytes]) -> None:
        try:
            data = content()
        except HdplanError as error:
            self.say(f"not saved: {error}")
            return
        if event.client is not None:
            event.client.send_file_download(name, data, save_immediately=True)
            for mesh in self._sent() if name.endswith(SCENE_FILES) else ():
                event.client.send_file_download(mesh.name, mesh.read_bytes(), save_immediately=True)
