"""The layer "separating plane": the plane of the active motion's proof for the closest pair, moment by moment.

Without a proof's file, one is written when the layer is on and the motion is certified, by a thread of its own: that
takes up to seconds. A proof is of one motion in one scene; when either changes, the plane goes until there is another.
"""

from __future__ import annotations

import html
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from hdplan.planner.certificate.verdict import Closest, proven_length
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.page.gliding import LEAST_THICKNESS, slab_of
from hdplan.planner.view.drawing.colors import PLANE
from hdplan.planner.view.drawing.labels import LABELS
from hdplan.planner.view.drawing.nodes import wxyz_of
from hdplan.planner.view.words import small
from hdplan.scenes.array_types import Array
from hdplan.scenes.deadline import time_limit
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.writer import scene_text

if TYPE_CHECKING:
    from hdplan.planner.proof.reading import Plane, ReadProof
    from hdplan.planner.view.viewer import Viewer

EDGE = 0.3  # [m] of the square that is drawn
WRITING_LIMIT = 30.0  # [s] to write a proof
WAIT = 5.0  # [s] for the thread at the end


class PlaneLayer:
    """The slab between the closest pair, the words about it, and the proof at hand."""

    def __init__(self, viewer: Viewer) -> None:
        """Send the nodes, unseen."""
        self._viewer = viewer
        scene = viewer.server.scene
        self.slab = scene.add_box(
            "/plane",
            PLANE,
            (EDGE, EDGE, LEAST_THICKNESS),
            opacity=0.45,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self.label = scene.add_label("/plane_label", "", visible=False, **LABELS | {"anchor": "top-center"})
        self.text = viewer.server.gui.add_html("")
        self._of: tuple[Trajectory, Scene] | None = None  # the subject of the proof at hand
        self._proof: ReadProof | str = ""  # or why there is none
        self._thread: threading.Thread | None = None

    def end(self) -> None:
        """Wait for the thread."""
        if self._thread is not None:
            self._thread.join(timeout=WAIT)

    # --- by the worker's thread -----------------------------------------------------------------------------------

    def take(self, proof: ReadProof) -> None:
        """Show this proof, which is about the active motion in the scene as it is now."""
        active = self._viewer.motions.active
        assert active is not None
        self._of, self._proof = (active.motion.trajectory, self._viewer.scene), proof

    def proof_of(self, trajectory: Trajectory) -> ReadProof | None:
        """Return the proof at hand, if it is of a motion in the scene as it is now."""
        if isinstance(self._proof, str) or not self._is_about((trajectory, self._viewer.scene)):
            return None
        return self._proof

    def show(self, on: bool, parameter: float, pairs: Sequence[Closest | None]) -> None:
        """Draw the plane between the closest pair where the active motion is at a path parameter; none unless `on` is
        true."""
        plane, words = self._plane(parameter, pairs) if on else (None, "")
        self.text.content = small(html.escape(words))
        self.slab.visible = self.label.visible = plane is not None
        nearest = pairs[0] or pairs[1]
        if plane is None or nearest is None:
            return
        at, thickness = slab_of(plane, nearest)
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), plane.normal).toRotationMatrix()
        self.slab.dimensions = (EDGE, EDGE, thickness)
        self.slab.position, self.slab.wxyz = at, wxyz_of(turn)
        self.label.text, self.label.position = words, at + _lowest(turn)

    def _plane(self, parameter: float, pairs: Sequence[Closest | None]) -> tuple[Plane | None, str]:
        """Return the plane, and the words: about it, or why there is none."""
        motions, nearest = self._viewer.motions, pairs[0] or pairs[1]
        active = motions.active
        if active is None or nearest is None:
            return None, "no motion, or nothing to touch: no plane"
        if not self._viewer.document.holds(active) or not active.motion.certificate.certified:
            return None, "the motion is not certified in this scene: there is no proof"
        about = active.motion.trajectory, self._viewer.scene
        if not self._is_about(about):
            self._write(about)
            return None, "the proof is being written …"
        if isinstance(self._proof, str):
            return None, self._proof
        row = self._proof.row(active.motion.curve, parameter)
        plane = self._proof.closest(nearest.link, nearest.other, nearest.to_obstacle, row)
        if plane is None:
            return None, f"{nearest.link} and {nearest.other} are not compared"
        return plane, f"proven ≥ {proven_length(plane.bound)}, by plane {plane.leaf + 1} of {plane.leaves}"

    def _is_about(self, about: tuple[Trajectory, Scene]) -> bool:
        return self._of is not None and all(one is two for one, two in zip(self._of, about, strict=True))

    def _write(self, about: tuple[Trajectory, Scene]) -> None:
        """Begin to write a proof, if no other one is being written."""
        if self._thread is not None and self._thread.is_alive():
            return
        try:
            scene = scene_text(self._viewer.panel.saving.standing_alone()[0])
        except HdplanError as error:
            self._of, self._proof = about, f"no proof: {error}"
            return
        self._thread = threading.Thread(target=self._run, args=(about, scene), name="hdplan-prove", daemon=True)
        self._thread.start()

    def _run(self, about: tuple[Trajectory, Scene], scene: str) -> None:
        """Write a proof, in a thread of its own, and have it shown."""
        found = _proof(about[0], scene)

        def done() -> None:
            self._of, self._proof = about, found
            self._thread = None
            self._viewer.draw(self._viewer.panel.player.time)

        self._viewer.worker.ask("proof", done)


def _proof(trajectory: Trajectory, scene: str) -> ReadProof | str:
    """Return the proof of a motion in a scene, or say why there is none."""
    from hdplan.planner.proof.proof import prove  # not before it is needed: the first picture comes sooner
    from hdplan.planner.proof.reading import ReadProof

    with tempfile.TemporaryDirectory() as folder, time_limit(WRITING_LIMIT):
        files = Path(folder) / "scene.yaml", Path(folder) / "motion.json"
        try:
            files[0].write_text(scene, encoding="utf-8")
            trajectory.save(files[1])
            return ReadProof(*files, prove(*files).data)
        except HdplanError as error:
            return f"no proof: {str(error).replace(f'{folder}/', '')}"
        except OSError as error:  # a full disk
            return f"no proof: {error}"


def _lowest(turn: Array) -> Array:
    """Return the corner of the square that is lowest, from its middle: the label of the closest pair is above."""
    corners = 0.5 * EDGE * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]]) @ turn.T
    return np.asarray(corners[corners[:, 2].argmin()])
