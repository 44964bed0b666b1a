"""The layer of separating planes: a proof's own, or those of a proof that the layer writes when shown."""

from __future__ import annotations

import html
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hdplan
from hdplan.planner.certificate.verdict import proven_length
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.proof.reading import ReadProof
from hdplan.planner.view.layers import PLANE
from hdplan.planner.view.planes import EDGE
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import find_scene
from tests.planner.view.events import Opener, by_worker, straight
from tests.waiting import until

PATIENCE = 30.0  # [s]


def waited_for(viewer: Viewer, words: str) -> str:
    """The layer's words once these contain `words`."""

    def text() -> str:
        return html.unescape(viewer.panel.layers.plane.text.content)

    until(lambda: words in text(), words)
    return text()


def switch(viewer: Viewer, on: bool) -> None:
    """Switch the layer as a browser does."""
    by_worker(viewer, lambda: viewer.panel.layers.set(PLANE, on))


def test_the_slab_lies_between_the_closest_pair(viewer: Viewer) -> None:
    """Written when the layer is shown; drawn between the points that are closest, as thick as is proven."""
    layer = viewer.panel.layers.plane
    assert not layer.slab.visible
    assert not layer.text.content
    switch(viewer, True)
    waited_for(viewer, "proven ≥")
    for now in np.linspace(0.0, 1.0, 11).tolist():
        viewer.show(now)
        nearest = next(filter(None, viewer.certifier.closest(viewer.configuration)))
        assert layer.slab.visible
        width, depth, thick = layer.slab.dimensions
        assert (width, depth) == (EDGE, EDGE)
        assert 0.0 < thick <= nearest.distance + 1e-9
        w, x, y, z = layer.slab.wxyz
        normal = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        heights = (nearest.points - layer.slab.position) @ normal
        assert heights.min() < 0.0 < heights.max()
        assert np.abs(heights).min() >= 0.5 * thick - 1e-6  # neither enters the slab
        assert proven_length(thick) in layer.label.text
    switch(viewer, False)
    assert not layer.slab.visible
    assert not layer.label.visible


def test_a_proof_is_of_the_scene_as_it_was(
    opened: Opener, scene: Scene, trajectory: Trajectory, tmp_path: Path
) -> None:
    """A file's proof is shown; once an obstacle moves there is none, until the motion is certified again."""
    trajectory.save(tmp_path / "motion.json")
    proof = hdplan.prove(find_scene("planar_arm"), tmp_path / "motion.json")
    viewer = opened(scene, found=trajectory)
    viewer.show_proof(ReadProof(find_scene("planar_arm"), tmp_path / "motion.json", proof.data))
    layer = viewer.panel.layers.plane
    assert layer.slab.visible
    assert "proven ≥" in layer.label.text

    def push(by: float) -> None:
        first, *rest = viewer.scene.obstacles
        x, y, z = first.pose.position
        moved = replace(first, pose=Pose((x + by, y, z), first.pose.quaternion_xyzw))
        viewer.document.change(viewer.edited.changed(obstacles=(moved, *rest)))

    by_worker(viewer, lambda: push(10.0))
    assert not layer.slab.visible
    assert "not certified in this scene" in layer.text.content
    viewer.worker.ask("measure", viewer.document.measure)
    waited_for(viewer, "proven ≥")
    assert layer.slab.visible


@pytest.mark.parametrize("found", [False, True])
def test_without_a_certified_motion_it_says_so(
    opened: Opener, scene: Scene, trajectory: Trajectory, found: bool
) -> None:
    grazing = straight(trajectory)
    viewer = opened(scene, **({"straight": grazing} if found else {}))
    switch(viewer, True)
    waited_for(viewer, "not certified" if found else "no motion")
    assert not viewer.panel.layers.plane.slab.visible
