"""Start and goal in numbers: the tip, or the goal pose, is where they say, and what cannot be reached is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hdplan.planner.view import scene_edits
from hdplan.planner.view.things import GOAL, START, Thing, place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.poses import Pose
from hdplan.scenes.targets import PoseTarget
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.view.events import Opener, by_worker, field_of, typed


def place(viewer: Viewer, thing: Thing) -> Pose:
    return place_of(viewer.edited, thing, viewer.stage.tip)


@pytest.mark.parametrize(("name", "thing"), [("panda_cage", START), ("panda_grasp", GOAL)])
def test_typed_values_hold_and_are_undone(opened: Opener, name: str, thing: Thing) -> None:
    """Of joint values that follow the tip, and of a goal pose, which keeps what it leaves free."""
    viewer = opened(load_scene(name))
    by_worker(viewer, lambda: viewer.panel.handles.select(thing))
    before, first = viewer.edited, place(viewer, thing)
    typed(viewer, viewer.panel.ends._fields, "turned [°]", tuple(np.add(scene_edits.turn_of(first), (0.0, 5.0, 0.0))))
    turned = place(viewer, thing)
    assert "not done" not in viewer.panel.editing.text.content
    assert turned.quaternion_xyzw != first.quaternion_xyzw
    np.testing.assert_allclose(turned.position, first.position, atol=1e-3)
    x, y, z = turned.position
    typed(viewer, viewer.panel.ends._fields, "at [m]", (x, y + 0.02, z))
    np.testing.assert_allclose(place(viewer, thing).position, (x, y + 0.02, z), atol=1e-3)
    shown = np.array([float(word) for word in str(field_of(viewer.panel.ends._fields, "x y z w").value).split()])
    np.testing.assert_allclose(abs(shown @ place(viewer, thing).quaternion_xyzw), 1.0, atol=1e-5)
    by_worker(viewer, viewer.panel.ends.snap)
    np.testing.assert_allclose(np.round(place(viewer, thing).position, 2), place(viewer, thing).position, atol=1.1e-3)
    if thing == GOAL:
        now, then = viewer.edited.target, before.target
        assert isinstance(now, PoseTarget)
        assert isinstance(then, PoseTarget)
        assert replace(now, pose=then.pose) == then
    while viewer.edited is not before:
        assert viewer.document.history.can_undo
        by_worker(viewer, viewer.document.undo)


def test_poses_out_of_the_tips_reach_are_refused(opened: Opener) -> None:
    viewer = opened(load_scene("panda_cage"))
    by_worker(viewer, lambda: viewer.panel.handles.select(START))
    before = viewer.edited
    typed(viewer, viewer.panel.ends._fields, "at [m]", (5.0, 0.0, 0.0))
    assert viewer.edited is before
    assert "from this posture the tip stays" in viewer.panel.editing.text.content
    typed(viewer, viewer.panel.ends._fields, "x y z w", "0 0 0 zero")
    assert "must be a number" in viewer.panel.editing.text.content
    typed(viewer, viewer.panel.ends._fields, "x y z w", "0 0 0 0")
    assert "not all 0" in viewer.panel.editing.text.content
    assert viewer.edited is before
    by_worker(viewer, lambda: viewer.panel.handles.select(None))
    by_worker(viewer, lambda: viewer.panel.editing.do(viewer.panel.ends.snap))
    assert "neither start nor goal" in viewer.panel.editing.text.content
