"""Effects of the panel on the scene, without a browser: each value that a browser may send is taken or refused in one
line, and nothing is half applied."""

from __future__ import annotations

import asyncio
import dataclasses
import html
import re
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from viser._messages import GuiUpdateMessage
from viser.infra import ClientId

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view import edit_steps, scene_edits
from hdplan.planner.view.planning import NAME
from hdplan.planner.view.things import GOAL, START, Thing, things
from hdplan.planner.view.uploads import Uploads
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.errors import InputError
from hdplan.scenes.obstacles import Obstacle, SteadyMotion
from hdplan.scenes.scene import Scene
from hdplan.scenes.shapes import Points
from hdplan.scenes.timing import Timing
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from hdplan.scenes.yaml_format.writer import scene_text
from tests.planner.view.events import Opener, by_worker, heard
from tests.waiting import PATIENCE, until

HOOK = shipped_scenes()["panda_vase"].parent / "hook.obj"
LONG_AGO = -1e3  # [s]


def field(viewer: Viewer, label: str) -> Any:
    """The input that stands in the panel with a label."""
    inputs = viewer.server.gui._gui_input_handle_from_uuid.values()
    return [each for each in inputs if getattr(each, "label", "") == label][-1]


def sent(viewer: Viewer, handle: Any, value: object, wait: bool = True) -> None:
    """Have a browser send a value."""
    heard(handle, value)
    if wait:
        assert viewer.worker.settle(20)


def status(viewer: Viewer) -> str:
    """The panel's words about the last edit."""
    return html.unescape(re.sub("<[^>]*>", "", viewer.panel.editing.text.content))


def selected(viewer: Viewer) -> Obstacle:
    thing = viewer.panel.handles.selected
    return next(each for each in viewer.scene.obstacles if thing is not None and each.name == thing.name)


def file(path: Path, name: str | None = None) -> SimpleNamespace:
    return SimpleNamespace(name=name or path.name, content=path.read_bytes())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("word", scene_edits.NEW)
def test_an_obstacle_is_added_named_resized_duplicated_and_deleted(viewer: Viewer, word: str) -> None:
    first = viewer.scene
    sent(viewer, field(viewer, "add"), word)
    assert selected(viewer).shape == scene_edits.NEW[word]
    sent(viewer, field(viewer, "name"), "thing")
    assert selected(viewer).name == "thing"
    assert viewer.panel.handles.choice.value == "obstacle thing"
    sent(viewer, field(viewer, "position [m]"), (-0.3, -0.3, 0.2))
    sizes: dict[str, object] = {
        "size": (0.1, 0.2, 0.1),
        "radius": 0.03,
        "radii": (0.1, 0.2, 0.1),
        "length": 0.3,
        "points": "0 0 0\n0.1, 0 0\n0 0.1 0\n\n0 0 0.1\n",
    }
    for key in (each.name for each in dataclasses.fields(selected(viewer).shape) if not each.kw_only):
        sent(viewer, field(viewer, f"{key} [m]"), sizes[key])
        if key != "points":
            assert getattr(selected(viewer).shape, key) == sizes[key]
        else:
            shape = selected(viewer).shape
            assert isinstance(shape, Points)
            assert shape.points[1] == (0.1, 0.0, 0.0)
    sent(viewer, field(viewer, "clearance [m]"), "0.002")
    sent(viewer, field(viewer, "obstacle"), "duplicate")
    names = [obstacle.name for obstacle in viewer.scene.obstacles]
    assert names[-2:] == ["thing", "thing2"]
    assert selected(viewer).clearance == 0.002
    assert len(viewer.stage.obstacles) == len(names)
    sent(viewer, field(viewer, "obstacle"), "delete")
    assert [obstacle.name for obstacle in viewer.scene.obstacles] == names[:-1]
    assert viewer.panel.handles.selected is None
    assert not viewer.panel.obstacles._folder.visible
    assert status(viewer) == ""
    sent(viewer, field(viewer, "history"), "reset")
    assert viewer.scene is first


def test_any_value_of_a_browser_is_taken_whole_or_refused_in_a_line(viewer: Viewer) -> None:
    """At random, over all fields: a scene that cannot be saved and read again is never shown."""
    rng = np.random.default_rng(4)
    numbers = [0.0, -1.0, 0.05, 1e-9, 1e7, float("nan"), float("inf"), 0.1234567]
    texts = ["", "0.01", "-3", "nan", "1e400", "abc", "ball", "ä\u2028b", "0 0 0", "\x00"]
    by_worker(viewer, lambda: viewer.panel.obstacles.add("points"))
    by_worker(viewer, lambda: viewer.panel.obstacles.add("capsule"))
    refused, taken, earlier = 0, 0, [viewer.edited]
    for _ in range(100):
        if rng.random() < 0.2:
            thing = things(viewer.edited)[rng.integers(len(things(viewer.edited)))]
            by_worker(viewer, lambda thing=thing: viewer.panel.handles.select(thing))
        fields = [*viewer.panel.obstacles._fields._fields, *viewer.panel.settings._fields._fields]
        handle = fields[rng.integers(len(fields))][0]
        if isinstance(handle.value, tuple):
            value: Any = tuple(numbers[i] for i in rng.integers(len(numbers), size=3))
        elif isinstance(handle.value, str):
            value = texts[rng.integers(len(texts))]
        else:
            value = type(handle.value)(rng.choice([0, -1, 5, 1000, 10**9]))
        before = viewer.edited
        sent(viewer, handle, value)
        if status(viewer):
            refused += 1
            assert status(viewer).startswith("not done: ")
            assert "\n" not in status(viewer)
            assert any(viewer.edited is each for each in earlier)  # before it, or before the beginning of it
        else:
            taken += viewer.edited is not before
        earlier.append(viewer.edited)
        scene_text(viewer.scene)
        assert "Error" not in viewer.panel.verdict
    assert refused > 20
    assert taken > 10


def test_typed_text_survives_an_update_of_the_panel(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though viser's own threads are all busy; nor what the page sends twice."""
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    gui, handle, calls, free = viewer.server.gui, field(viewer, "clearance [m]"), list[object](), threading.Event()
    monkeypatch.setattr(gui, "_resolve_client", lambda _: SimpleNamespace(client_id=1))
    viewer.panel.page.on("count", lambda _, words: calls.append(words["number"]))
    for _ in range(gui._thread_executor._max_workers):
        gui._thread_executor.submit(free.wait, 20)

    def send(handle: Any, value: str) -> None:
        message = GuiUpdateMessage(handle._impl.uuid, {"value": value})
        asyncio.run_coroutine_threadsafe(gui._handle_gui_updates(ClientId(1), message), gui._event_loop).result(20)

    try:
        send(handle, "0.005")
        by_worker(viewer, viewer.panel.show_values)
        for number in range(3):
            send(viewer.panel.page._field, f'{{"do": "count", "number": {number}}}')
    finally:
        free.set()
    assert viewer.worker.settle(20)
    assert viewer.scene.obstacles[-1].clearance == 0.005
    assert calls == [0, 1, 2]


def test_a_field_keeps_the_digits_that_it_does_not_show(viewer: Viewer) -> None:
    exact = (0.123456789, -0.3, 0.111111111)
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    by_worker(viewer, lambda: viewer.panel.editing.apply("", lambda now: scene_edits.placed(now, "box", exact)))
    handle = field(viewer, "position [m]")
    assert handle.value == (0.1235, -0.3, 0.1111)
    sent(viewer, handle, (0.1235, -0.4, 0.1111))
    assert selected(viewer).pose.position == (0.123456789, -0.4, 0.111111111)
    joint = viewer.panel.jogging.sliders
    q = viewer.edited.goal
    sent(viewer, joint[0], round(float(q[0]), 3) + 0.2)
    assert viewer.edited.goal[1] == q[1]


def test_a_moving_obstacle_gets_another_speed(opened: Opener, scene: Scene) -> None:
    viewer = opened(dataclasses.replace(scene, timing=Timing(duration=2.0)))
    by_worker(viewer, lambda: viewer.panel.handles.select(Thing("obstacle", "ball")))
    sent(viewer, field(viewer, "velocity [m/s]"), (0.1, 0.0, 0.0))
    sent(viewer, field(viewer, "spin [rad/s]"), (0.0, 0.0, 1.0))
    assert selected(viewer).motion == SteadyMotion((0.1, 0.0, 0.0), (0.0, 0.0, 1.0))
    sent(viewer, field(viewer, "duration [s]"), "")
    assert "timing.duration is missing" in status(viewer)
    sent(viewer, field(viewer, "duration [s]"), "3")
    assert viewer.panel.player.timeline.end == 3.0


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """The following edits belong together, also on a busy processor."""
    monkeypatch.setattr(edit_steps, "PAUSE", PATIENCE)


@pytest.mark.usefixtures("unhurried")
def test_values_of_one_field_that_come_at_once_are_one_step(viewer: Viewer) -> None:
    slider, first = viewer.panel.jogging.sliders[0], viewer.edited
    for value in np.linspace(0.5, 0.9, 9).tolist():
        sent(viewer, slider, value)
    assert viewer.edited.goal[0] == 0.9
    sent(viewer, field(viewer, "history"), "undo")
    assert viewer.edited is first
    assert slider.value == pytest.approx(first.goal[0])
    sent(viewer, field(viewer, "history"), "undo")
    assert status(viewer) == "not done: there is nothing to undo"
    sent(viewer, field(viewer, "history"), "redo")
    assert viewer.edited.goal[0] == 0.9
    viewer.panel.editing._last = dataclasses.replace(viewer.panel.editing._last, when=LONG_AGO)  # the hand rested
    sent(viewer, slider, 0.3)
    sent(viewer, field(viewer, "history"), "undo")
    assert viewer.edited.goal[0] == 0.9


@pytest.mark.usefixtures("unhurried")
@pytest.mark.parametrize(
    ("label", "text", "words"),
    [("clearance [m]", "1e20", "clearance"), ("name", "ball", "ball"), ("quaternion", "0 0 0 1 2", "quaternion")],
)
def test_of_a_value_that_is_refused_nothing_stays_that_was_typed_before(
    viewer: Viewer, label: str, text: str, words: str
) -> None:
    """Digit by digit, as browsers send it; what follows is taken."""
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    before, handle = viewer.edited, field(viewer, label)
    for count in range(1, len(text) + 1):
        sent(viewer, handle, text[:count])
        assert handle.value == text[:count]  # it stays in the field, as somebody may be typing
    assert words in status(viewer)
    assert viewer.edited is before
    assert selected(viewer).name == "box"
    by_worker(viewer, viewer.panel.show_values)
    assert handle.value != text
    sent(viewer, field(viewer, "clearance [m]"), "0.01")
    assert selected(viewer).clearance == 0.01
    sent(viewer, field(viewer, "history"), "undo")
    assert viewer.edited is before
    sent(viewer, field(viewer, "history"), "undo")
    assert "box" not in [each.name for each in viewer.scene.obstacles]


@pytest.mark.usefixtures("unhurried")
def test_a_refused_value_keeps_the_last_accepted_one(viewer: Viewer) -> None:
    """A number that is stepped down to nothing, or typed after a rest; an exponent takes its beginning back."""
    by_worker(viewer, lambda: viewer.panel.obstacles.add("sphere"))
    handle, first = field(viewer, "radius [m]"), selected(viewer).shape
    for value in (0.02, 0.01, 0.0):
        sent(viewer, handle, value)
    assert "radius" in status(viewer)
    assert selected(viewer).shape == dataclasses.replace(first, radius=0.01)
    viewer.panel.editing._last = dataclasses.replace(viewer.panel.editing._last, when=LONG_AGO)  # the hand rested
    for value in (1.0, 10.0, 100.0, 1e20):
        sent(viewer, handle, value)
    assert selected(viewer).shape == dataclasses.replace(first, radius=0.01)
    sent(viewer, handle, 1.0)
    viewer.panel.editing.refuse("no exponent")
    assert viewer.worker.settle(20)
    assert status(viewer) == "not done: no exponent"
    assert selected(viewer).shape == dataclasses.replace(first, radius=0.01)
    assert handle.value == 0.01


@pytest.mark.parametrize("entered", [False, True])
def test_a_value_is_one_however_long_the_hand_rests_in_it(viewer: Viewer, entered: bool) -> None:
    """Its beginning goes where more of it is refused, unless somebody has left the field meanwhile."""
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    before, handle = viewer.edited, field(viewer, "clearance [m]")
    for text in ("0", "0.", "0.1"):
        sent(viewer, handle, text)
        viewer.panel.editing._last = dataclasses.replace(viewer.panel.editing._last, when=LONG_AGO)  # the hand rested
    if entered:
        viewer.panel.editing.enter()
    sent(viewer, handle, "0.1x")
    assert "must be a number" in status(viewer)
    assert selected(viewer).clearance == (0.1 if entered else None)
    assert (viewer.edited is before) is not entered


def test_presses_count_each(viewer: Viewer) -> None:
    for _ in range(3):
        sent(viewer, field(viewer, "add"), "sphere", wait=False)
    assert viewer.worker.settle(20)
    assert [obstacle.name for obstacle in viewer.scene.obstacles][-3:] == ["sphere", "sphere2", "sphere3"]
    sent(viewer, field(viewer, "history"), "undo", wait=False)
    sent(viewer, field(viewer, "history"), "undo")
    assert viewer.scene.obstacles[-1].name == "sphere"
    assert len(viewer.stage.obstacles) == len(viewer.scene.obstacles)


def test_motions_are_measured_once_edits_pause(viewer: Viewer) -> None:
    sent(viewer, field(viewer, "add"), "box")
    shown = viewer.motions.shown[0]
    until(lambda: viewer.document.holds(shown) and shown.motion.measured, "it is measured")
    assert viewer.worker.settle(20)
    assert "certified" in viewer.panel.verdict


def test_the_ends_go_to_states_and_random_places_and_the_selected_one_is_jogged(viewer: Viewer) -> None:
    by_worker(viewer, lambda: viewer.panel.handles.select(START))
    assert viewer.panel.jogging.end.value == "start"
    sent(viewer, field(viewer, "go to"), "folded")
    np.testing.assert_array_equal(viewer.edited.start, [0.0, 2.5])
    assert [slider.value for slider in viewer.panel.jogging.sliders] == [0.0, 2.5]
    by_worker(viewer, lambda: viewer.panel.handles.select(GOAL))
    sent(viewer, field(viewer, "go to"), "random")
    assert viewer.edited.contacts[1] == ()
    np.testing.assert_array_equal(viewer.edited.start, [0.0, 2.5])


def test_postures_of_a_goal_pose_are_gone_through_and_kept(opened: Opener) -> None:
    viewer = opened(load_scene("pr2_shelf"))
    goal = viewer.scene.goal
    begin = viewer.edited.goal
    seen = [begin]
    for _ in range(2):
        sent(viewer, field(viewer, "posture"), "another")
        assert viewer.scene.goal is goal
        assert viewer.edited.missed is None
        seen.append(viewer.edited.goal)
    assert not np.array_equal(seen[1], seen[2])
    assert "posture 3 of" in str(viewer.panel.jogging._text.content)
    sent(viewer, field(viewer, "posture"), "keep as joint values")
    np.testing.assert_array_equal(viewer.scene.goal.positions, seen[2])
    for q in reversed(seen):
        sent(viewer, field(viewer, "history"), "undo")
        np.testing.assert_array_equal(viewer.edited.goal, q)
        assert viewer.scene.goal is goal
        if q is begin:
            break


def test_the_planner_s_settings_are_those_of_the_plan(opened: Opener, scene: Scene) -> None:
    viewer = opened(scene)
    for label, value in (("waypoints", 17), ("distance", "fcl"), ("clearance [m]", 0.01), ("polish", "2")):
        sent(viewer, field(viewer, label), value)
    settings = viewer.panel.settings
    settings.solver.value, settings.seed.value, settings.time_limit.value = "chomp", 3, 1.0
    planner = viewer.scene.planner
    assert (planner.waypoints, planner.distance, planner.clearance, planner.polish) == (17, "fcl", 0.01, 2)
    viewer.panel.planning.toggle()
    until(lambda: not viewer.panel.planning.running, "the plan ends")
    assert viewer.worker.settle(20)
    shown = viewer.motions.named(NAME)
    assert shown is not None
    assert shown.result is not None
    assert (shown.result.solver, shown.result.seed, len(shown.result.trajectory)) == ("chomp", 3, 17)
    settings.seed.value = -1
    viewer.panel.planning.toggle()
    until(lambda: not viewer.panel.planning.running, "the plan ends")
    assert viewer.worker.settle(20)
    assert "seed" in viewer.panel.planning.text.content


def test_a_mesh_is_sent_and_saved_beside_the_scene(viewer: Viewer, tmp_path: Path) -> None:
    by_worker(viewer, lambda: viewer.panel.obstacles.add_mesh(file(HOOK)))
    by_worker(
        viewer,
        lambda: viewer.panel.obstacles.add_mesh(SimpleNamespace(name="hook.obj", content=HOOK.read_bytes() + b"\n#")),
    )
    sent(viewer, field(viewer, "scale"), (0.5, 0.5, 0.5))
    assert [each.name for each in viewer.scene.obstacles][-2:] == ["hook", "hook_2"]
    folder = viewer.uploads.folder
    (tmp_path / "scene.yaml").write_bytes(viewer.panel.saving.scene_file())
    for mesh in viewer.panel.saving._sent():
        (tmp_path / mesh.name).write_bytes(mesh.read_bytes())
    saved = load_scene(tmp_path / "scene.yaml")
    assert str(folder) not in scene_text(saved)
    assert scene_text(saved).replace(str(tmp_path), str(folder)) == scene_text(viewer.panel.saving.standing_alone()[0])
    viewer.close()
    assert not folder.exists()


def test_scenes_and_motions_are_opened(viewer: Viewer, trajectory: Trajectory, tmp_path: Path) -> None:
    first = viewer.scene
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    (tmp_path / "other.yaml").write_bytes(viewer.panel.saving.scene_file())
    changed = scene_text(viewer.scene)
    sent(viewer, field(viewer, "history"), "reset")
    by_worker(viewer, lambda: viewer.panel.opening.open(file(tmp_path / "other.yaml")))
    assert viewer.scene.name == "other"
    assert viewer.scene.obstacles[-1].name == "box"
    assert changed.count("box") == scene_text(viewer.scene).count("box")
    assert "opened: the scene other" in status(viewer)
    for name in ("way.json", "way.npz", "way.csv", "way.joint_trajectory.yaml", "way.robot_trajectory.yaml"):
        trajectory.save(tmp_path / name)
        by_worker(viewer, lambda name=name: viewer.panel.opening.open(file(tmp_path / name)))
        assert "opened: way" in status(viewer)
        assert "certified" in status(viewer)
    assert [shown.motion.name for shown in viewer.motions.shown] == ["found", "way"]
    for _ in range(6):  # of five motions and the scene
        sent(viewer, field(viewer, "history"), "undo")
    assert viewer.scene is first


def test_files_that_cannot_be_opened_change_nothing(viewer: Viewer, trajectory: Trajectory, tmp_path: Path) -> None:
    trajectory.save(tmp_path / "way.json")
    whole = (tmp_path / "way.json").read_bytes()
    text = shipped_scenes()["planar_arm"].read_bytes()
    panda = shipped_scenes()["panda_cage"].read_bytes()
    opened = viewer.panel.opening.open
    meshes = viewer.panel.obstacles.add_mesh
    cases: list[tuple[Callable[[Any], None], str, bytes, str]] = [
        (opened, "way.json", whole[: len(whole) // 2], "way.json: "),
        (opened, "way.exe", whole, "ends with one of"),
        (opened, "empty.yaml", b"", "is empty"),
        (opened, "bad.yaml", b"\xff\xfe", "bad.yaml: "),
        (opened, "half.yaml", text[: len(text) // 2], "half.yaml: "),
        (opened, "panda.yaml", panda, "another robot"),
        (opened, "rviz.scene", b"(noname)+++\n.\n", "rviz.scene"),
        (opened, "../../../etc/motion.json", b"{}", "motion.json: "),
        (meshes, "hook.obj", HOOK.read_bytes()[:40], "hook.obj"),
        (meshes, "flat.stl", b"solid a\nendsolid a\n", "flat"),
        (meshes, "scene.yaml", text, "ends with one of"),
    ]
    before, motions = viewer.edited, list(viewer.motions.shown)
    for job, name, content, words in cases:
        given = SimpleNamespace(name=name, content=content)
        by_worker(viewer, lambda job=job, given=given: viewer.panel.editing.do(lambda: job(given)))
        assert words in status(viewer), name
        assert str(viewer.uploads.folder) not in status(viewer)
        assert "\n" not in status(viewer)
        assert viewer.edited is before
        assert viewer.motions.shown == motions


def test_uploads_stay_in_their_folder() -> None:
    uploads = Uploads()
    plain = ["../up.obj", "/etc/up.obj", "a\\b\\up.obj", "\n.obj", "a b(1).OBJ", "x" * 300 + ".obj", "腕" * 90 + ".obj"]
    try:
        for take in (lambda name: uploads.take(name, b"o", (".obj",)), lambda name: uploads.take_mesh(name, b"o")):
            for name in plain:
                path = take(name)
                assert path.parent == uploads.folder
                assert path.read_bytes() == b"o"
            for name in ("", "..", "..obj", "/"):
                with pytest.raises(InputError, match="a file that ends with"):
                    take(name)
        long = "腕" * 90 + ".obj"
        every = {
            uploads.take_mesh(name, name.encode()) for name in (long, f"b{long}", "c:d.obj", "c*d.obj", "x/c?d.obj")
        }
        assert len(every) == 5  # a mesh is never another one's, however their names are written
        assert uploads.take_mesh("up.obj", b"o") == uploads.folder / "up.obj"
        assert uploads.take_mesh("up.obj", b"p") == uploads.folder / "up_2.obj"
        assert uploads.take_mesh("up.obj", b"p") == uploads.folder / "up_2.obj"
    finally:
        uploads.close()


def test_keys_act(viewer: Viewer) -> None:
    keys = {each.shown: each for each in viewer.panel.keys._keys}
    client: Any = None
    keys["end"].act(client)
    assert viewer.panel.player.time == 1.0
    keys["←"].act(client)
    assert viewer.panel.player.time == pytest.approx(0.98)
    keys["home"].act(client)
    assert viewer.panel.player.time == 0.0
    keys["space"].act(client)
    assert viewer.panel.player.playing
    keys["space"].act(client)
    assert not viewer.panel.player.playing
    keys["2"].act(client)
    assert not viewer.panel.layers.on("obstacles")
    first = viewer.edited
    by_worker(viewer, lambda: viewer.panel.obstacles.add("box"))
    keys["Z"].act(client)
    assert viewer.worker.settle(20)
    assert viewer.edited is first
    keys["shift Z"].act(client)
    assert viewer.worker.settle(20)
    assert viewer.scene.obstacles[-1].name == "box"


def test_a_motion_that_does_not_fit_the_edited_scene_is_reported_and_fits_again(viewer: Viewer) -> None:
    """One without times, where the motion is to last so long: the edit is taken, and nothing counts as proven."""
    viewer.panel.live.set(False)
    sent(viewer, field(viewer, "duration [s]"), "2")
    assert status(viewer) == ""
    assert viewer.scene.end_time == 2.0
    by_worker(viewer, viewer.document.measure)
    assert not viewer.document.holds(viewer.motions.shown[0])
    assert "has no times" in viewer.panel.verdict
    assert "certified" not in viewer.panel.verdict
    sent(viewer, field(viewer, "history"), "undo")
    assert viewer.document.holds(viewer.motions.shown[0])
    assert "certified" in viewer.panel.verdict


def test_a_value_typed_while_another_field_is_edited_is_not_lost(viewer: Viewer) -> None:
    """Not in the scene, and not in the field: values that wait are those that were sent."""
    by_worker(viewer, lambda: viewer.panel.handles.select(Thing("obstacle", "ball")))
    began, gate = threading.Event(), threading.Event()
    viewer.worker.ask("held", lambda: (began.set(), gate.wait(20), None)[2])
    assert began.wait(20)
    slider = viewer.panel.jogging.sliders[0]
    jogged = round(float(viewer.edited.goal[0]), 3) - 0.1
    obstacles_clearance, planners_clearance = (
        next(each[0] for each in fields._fields if each[1].endswith("clearance"))
        for fields in (viewer.panel.obstacles._fields, viewer.panel.settings._fields)
    )
    typed = [(field(viewer, "radius [m]"), 0.07), (obstacles_clearance, "0.004")]
    typed += [(planners_clearance, 0.002), (slider, jogged)]
    for handle, value in typed:
        sent(viewer, handle, value, wait=False)
    gate.set()
    assert viewer.worker.settle(20)
    ball = selected(viewer)
    assert (ball.shape.radius, ball.clearance) == (0.07, 0.004)
    assert viewer.scene.planner.clearance == 0.002
    assert viewer.edited.goal[0] == jogged
    assert [handle.value for handle, _ in typed] == [value for _, value in typed]
    for _ in typed:
        sent(viewer, field(viewer, "history"), "undo")
    assert not viewer.document.history.can_undo


def test_the_handle_stands_as_what_is_selected(viewer: Viewer) -> None:
    """Upright for an obstacle, also after the goal was selected, whose handle is turned; a move of it turns nothing."""
    handles, name = viewer.panel.handles, viewer.scene.obstacles[0].name
    by_worker(viewer, lambda: handles.select(GOAL))
    turned = handles.grip.node.wxyz.copy()
    by_worker(viewer, lambda: handles._clicked(Thing("obstacle", name), False))
    assert handles.selected == Thing("obstacle", name)
    np.testing.assert_allclose(
        np.roll(handles.grip.node.wxyz, -1), viewer.scene.obstacles[0].pose.quaternion_xyzw, atol=1e-12
    )
    assert np.abs(turned - handles.grip.node.wxyz).max() > 0.1
