"""Every layer draws something: a row of the table without its drawing fails here by name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.layers import LAYERS
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.clouds import Cloud
from hdplan.scenes.scene import Scene
from tests.waiting import until


def in_sight(viewer: Viewer) -> set[str]:
    """The nodes of the scene that are visible, as is all above them; without frames, which are invisible parents."""
    viewer.worker.settle(30.0)
    nodes = viewer.server.scene._handle_from_node_name
    hidden = {name for name, handle in nodes.items() if not handle.visible}
    drawn = {name for name, handle in nodes.items() if not isinstance(handle, viser.FrameHandle)}
    return {name for name in drawn if not any(name == each or name.startswith(f"{each}/") for each in hidden)}


def test_every_layer_is_seen_when_it_is_switched(
    opened: Callable[..., Viewer], scene: Scene, trajectory: Trajectory
) -> None:
    # Points beyond the arm's reach, and one inside the arm, which is its own image.
    points = np.vstack([np.mgrid[0:2, 3:5, 0:2].reshape(3, -1).T, [[0.0, 0.0, 0.0]]])
    seen = Cloud(points, 0.01, name="seen", ignore_robot=0.2)
    viewer = opened(
        Scene(robot=scene.robot, obstacles=[*scene.obstacles, seen], start=scene.start, goal=scene.goal),
        motion=trajectory,
    )
    assert viewer.stage.left_out is not None
    layers = viewer.panel.layers
    for name in LAYERS:
        before = in_sight(viewer)
        layers.toggle(name)
        until(lambda before=before: in_sight(viewer) != before, f"{name}: nothing is drawn")
        layers.toggle(name)
        assert in_sight(viewer) == before, name
