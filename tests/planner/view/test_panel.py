"""Words and fields of the panel stay true: refused values leave their fields, words of a file go with what it was
about, new shapes stand on the eye's side, and long names take no room."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view import scene_edits
from hdplan.planner.view.drawing.colors import clearance_colors
from hdplan.planner.view.drawing.motion import Tip, millimetres, shortened
from hdplan.planner.view.drawing.nodes import SEGMENT_WIDTH, TIGHT
from hdplan.planner.view.edit_steps import LINGERS
from hdplan.planner.view.edited_scene import Edited
from hdplan.planner.view.page_script import NARROWEST
from hdplan.planner.view.things import START, Thing, place_of
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Box
from hdplan.scenes.yaml_format.reader import load_scene
from tests.planner.view.events import BALL, Opener, by_worker, field_of, tell, typed


@pytest.fixture
def viewer(opened: Opener, scene: Scene, trajectory: Trajectory) -> Viewer:
    viewer = opened(scene, found=trajectory)
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    return viewer


def test_refused_values_leave_their_fields(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not at once, as somebody may still be typing."""
    waiting: list[tuple[str, float, Callable[[], None]]] = []
    monkeypatch.setattr(viewer.panel.editing, "_later", lambda *timer: waiting.append(timer))
    fields = viewer.panel.obstacles._fields
    values: dict[str, object] = {"clearance": "a lot", "name": "prism", "radius": -1.0}
    before = {name: field_of(fields, name).value for name in values}
    for name, value in values.items():
        assert typed(viewer, fields, name, value).value == value
        assert "not done: " in viewer.panel.editing.text.content
    what, when, bring_back = waiting[-1]
    assert (what, when) == ("values", LINGERS)
    by_worker(viewer, bring_back)
    assert {name: field_of(fields, name).value for name in values} == before
    assert "not done: " in viewer.panel.editing.text.content


def test_an_exponent_is_refused_in_words(viewer: Viewer) -> None:
    before = viewer.edited
    tell(viewer, do="exponent")
    assert "without an exponent" in viewer.panel.editing.text.content
    assert viewer.edited is before


def test_a_message_about_a_file_disappears_with_its_motion(viewer: Viewer) -> None:
    saving = viewer.panel.saving
    by_worker(viewer, saving.motion_file)
    assert "saved: certified" in saving._text.content
    by_worker(viewer, viewer.motions_changed)
    assert "saved: certified" in saving._text.content
    place = place_of(viewer.edited, BALL, viewer.stage.tip)
    by_worker(viewer, lambda: viewer.panel.editing.say("opened: the scene"))
    by_worker(viewer, lambda: viewer.panel.handles.drag(Pose((place.position[0] + 0.01, *place.position[1:]))))
    assert saving._text.content == ""
    assert viewer.panel.editing.text.content == ""
    by_worker(viewer, saving.scene_file)
    assert "saved: the scene" in saving._text.content
    by_worker(viewer, viewer.document.undo)
    assert saving._text.content == ""


def test_esc_selects_nothing_also_while_something_is_dragged(viewer: Viewer) -> None:
    place = place_of(viewer.edited, BALL, viewer.stage.tip)
    by_worker(viewer, lambda: viewer.panel.handles.drag(place))
    escape = next(each for each in viewer.panel.keys._keys if each.key == "escape")
    escape.act(None)
    assert viewer.worker.settle(20)
    assert viewer.panel.handles.selected is None
    assert not viewer.panel.handles.dragging
    assert viewer.edited.scene.obstacles


def test_esc_closes_the_list_of_keys_before_it_selects_nothing(viewer: Viewer) -> None:
    keys, client = viewer.panel.keys, SimpleNamespace(client_id=7, gui=viewer.server.gui)
    escape = next(each for each in keys._keys if each.key == "escape")
    by_worker(viewer, lambda: viewer.panel.handles.select(BALL))
    keys._list(client)
    listed = keys._lists[7]
    for left in (BALL, None):
        keys._pressed(escape, client)
        assert viewer.worker.settle(20)
        assert listed.closed
        assert viewer.panel.handles.selected == left


@pytest.mark.parametrize("angle", np.linspace(0.0, 2 * np.pi, 7)[:-1])
def test_new_shapes_stand_on_the_eyes_side_where_there_is_room(angle: float) -> None:
    empty = Edited.of(Setup.of(load_scene("planar_arm"))).changed(obstacles=())
    eye = 3.0 * np.array([np.cos(angle), np.sin(angle), 0.3])
    ends = [place_of(empty, Thing(end), Tip.of(empty.robot)).position for end in ("start", "goal")]

    def placed(*eyes: np.ndarray) -> tuple[float, float]:
        """How much room there is, and how far it is from the eye."""
        after, _ = scene_edits.added(empty, Box((0.05, 0.05, 0.05)), "box", *eyes)
        at = np.array(after.scene.obstacles[-1].pose.position)
        return min(float(np.linalg.norm(at - end)) for end in ends), float(np.linalg.norm(at - eye))

    (most, farther), (room, near) = placed(), placed(eye)
    assert near <= farther
    assert scene_edits.ROOMY * most < room <= most


@pytest.mark.parametrize("length", [1, 79, 80, 81, 300])
def test_long_names_take_no_room(length: int) -> None:
    name = "".join(chr(97 + i % 26) for i in range(length))
    found = shortened(name)
    assert len(found) <= 80
    assert (found == name) == (length <= 80)
    assert (found[0], found[-1]) == (name[0], name[-1])


def test_the_panel_leaves_room_for_the_scene(viewer: Viewer) -> None:
    calls: list[float] = []
    gui = SimpleNamespace(configure_theme=lambda **_: None, main_panel=SimpleNamespace(set_width=calls.append))
    scene = SimpleNamespace(add_grid=lambda *_, **__: None)
    widths: list[tuple[object, float | None]] = [
        (1400, None),
        (700, 280),
        (600, NARROWEST),
        (float("nan"), None),
        ("a", None),
    ]
    for number, (window, width) in enumerate(widths):
        client: Any = SimpleNamespace(client_id=number, gui=gui, scene=scene)
        for _ in range(2):
            viewer.panel.page._theme(client, {"do": "theme", "dark": False, "width": window})
        assert calls == ([] if width is None else [width])
        calls.clear()


def test_start_and_goal_have_their_names_also_where_the_robot_stands(viewer: Viewer) -> None:
    stage = viewer.stage
    by_worker(viewer, lambda: viewer.panel.handles.select(None))
    for now, ghosts in ((0.0, (False, True)), (0.5, (True, True)), (1.0, (True, False))):
        viewer.show(now)
        assert (stage.start.visible, stage.goal.visible) == ghosts
        assert [label.visible for label in stage.labels] == [True, True]
    by_worker(viewer, lambda: viewer.panel.handles.select(START))
    assert [label.visible for label in stage.labels] == [False, True]
    by_worker(viewer, lambda: viewer.panel.layers.set("start and goal", on=False))
    assert not any(label.visible for label in stage.labels)


def test_the_closest_pairs_are_joined_and_the_tight_one_pulses(viewer: Viewer) -> None:
    """By segments as long as their distances, in its colour; the nearer one is labelled where nothing is selected."""
    by_worker(viewer, lambda: viewer.panel.handles.select(None))
    closest, tight = viewer.stage.closest, []
    for now in np.linspace(0.0, 1.0, 21):
        viewer.show(now)
        pairs = viewer.certifier.closest(viewer.configuration)
        assert [line.visible for line in closest.lines] == [each is not None for each in pairs]
        for line, each in zip(closest.lines, pairs, strict=True):
            if each is not None:
                np.testing.assert_allclose(line.points[0], each.points, rtol=0, atol=1e-6)
                length = np.linalg.norm(np.diff(line.points[0], axis=0))
                assert length == pytest.approx(abs(each.distance), abs=1e-6)
        pair = pairs[0]
        if pair is not None:
            assert np.ravel(closest.lines[0].colors)[:3].tolist() == clearance_colors(pair.distance).tolist()
            assert closest.label.visible
            assert closest.label.text.endswith(millimetres(pair.distance))
        widths = []
        for phase in np.linspace(0.0, 1.0, 9):
            closest.pulse(phase)
            widths.append(closest.lines[0].thickness)
        assert widths[0] == widths[-1] == SEGMENT_WIDTH
        tight.append(pair is not None and pair.distance < TIGHT)
        assert (max(widths) > SEGMENT_WIDTH) == tight[-1]
    assert len(set(tight)) == 2
