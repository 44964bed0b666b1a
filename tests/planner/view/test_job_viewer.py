"""The viewer of jobs: verdicts of the very scene that is shown, stages, what is held, places that are dragged."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hdplan
from hdplan.planner.job.certify import certify_job
from hdplan.planner.job.planning import plan_job
from hdplan.planner.job.result import JobResult
from hdplan.planner.job.spots import moved, spots_of
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.edited_job import EditedJob
from hdplan.planner.view.job_layers import LAYERS
from hdplan.planner.view.job_viewer import JobViewer
from hdplan.planner.view.server import open_job_viewer
from hdplan.scenes.errors import InputError
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene, derived
from hdplan.scenes.yaml_format.reader import load_scene
from tests.waiting import until

Open = Callable[..., JobViewer]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("panda_pick_place")


@pytest.fixture(scope="module")
def planned(scene: Scene) -> JobResult:
    result = plan_job(scene)
    assert result.certified
    return result


@pytest.fixture
def opened() -> Iterator[Open]:
    viewers: list[JobViewer] = []
    complaints: list[str] = []

    def opened(scene: Scene, motion: Any = None) -> JobViewer:
        viewers.append(open_job_viewer(scene, motion, port=8580, complain=complaints.append))
        return viewers[-1]

    yield opened
    for viewer in viewers:
        viewer.close()
    assert not complaints


def there_and_wait() -> Scene:
    """A light scene with a job: an arm of a few boxes among obstacles."""
    single = load_scene("planar_arm")
    job = hdplan.Job([hdplan.Move(single.goal, name="there"), hdplan.Wait(0.5)])
    limits = hdplan.Limits(velocity=2.0, acceleration=5.0)
    return derived(single, goal=single.start, job=job, limits=limits)


def by_worker(viewer: JobViewer, job: Callable[[], object]) -> None:
    viewer.worker.ask("test", lambda: (job(), None)[1])
    viewer.worker.settle()


def says(viewer: JobViewer) -> str:
    """The verdict, by its colours."""
    words = viewer.verdict
    return "good" if "hd-badge hd-good" in words else "bad" if "hd-badge hd-bad" in words else "nothing"


def test_the_shown_scene_follows_the_stages(opened: Open, scene: Scene, planned: JobResult) -> None:
    viewer = opened(scene, planned.trajectory)
    assert says(viewer) == "good"
    nodes = {node.obstacle.name: node for node in viewer.obstacles}
    places = []
    for stage in planned.certificate.stages:
        viewer.player.go_to(0.5 * (stage.begins + stage.ends))
        viewer.worker.settle()
        assert (", ".join(stage.held) or "nothing") in viewer._held.content
        assert stage.name in viewer._held.content
        places.append(nodes["can"].place[:3, 3].copy())
    names = [stage.name for stage in planned.certificate.stages]
    lift, carry, out = (places[names.index(each)] for each in ("lift", "carry", "back out"))
    np.testing.assert_allclose(places[0], [0.5, 0.3, 0.16], atol=1e-9)  # until it is taken
    assert np.linalg.norm(carry - lift) > 0.1
    np.testing.assert_allclose(out, places[names.index("let go")], atol=1e-9)


def test_no_verdict_outlives_its_scene(opened: Open) -> None:
    """Any acts in any order: what is called certified is certified in the scene that is shown."""
    planned = plan_job(there_and_wait())
    viewer = opened(planned.scene, planned.trajectory)
    viewer.live.value = False
    rng = np.random.default_rng(5)

    def drag() -> None:
        things = viewer.edited.movables
        viewer.handles.select(things[rng.integers(len(things))])
        assert viewer.handles.thing is not None
        pose = viewer.edited.place_of(viewer.handles.thing)
        for _ in range(2):
            at = np.array(pose.position) + [*rng.normal(0.0, 0.2, 2), 0.0]
            viewer.handles.drag(Pose(tuple(at.tolist()), pose.quaternion_xyzw))
        if rng.random() < 0.5:
            viewer.handles.let_go()

    seen = set()
    for _ in range(20):
        act = rng.choice(["drag", "undo", "redo", "reset", "motion", "motion"])
        if act == "drag":
            by_worker(viewer, drag)
        elif act == "motion":
            viewer.take_motion(planned.trajectory)
        else:
            viewer.go_back(act)
        viewer.worker.settle()
        seen.add(text := says(viewer))
        shown = viewer.edited.shown
        if shown is None:
            assert text == "nothing"
        else:
            assert shown.scene is viewer.edited.scene
            again = certify_job(viewer.edited.scene, shown.trajectory)
            assert again.certified == (text == "good")
    assert seen == {"good", "bad", "nothing"}


def test_a_plan_of_an_earlier_scene_comes_too_late(opened: Open, scene: Scene, planned: JobResult) -> None:
    viewer = opened(scene)
    assert says(viewer) == "nothing"
    edited = viewer.edited
    found = edited.done(planned.trajectory, planned.certificate)
    far = viewer.edited.movables[0]

    def drag() -> None:
        viewer.handles.select(far)
        viewer.handles.drag(Pose((0.55, 0.0, 0.05)))

    by_worker(viewer, drag)
    viewer._planned(edited, found, "")
    viewer.worker.settle()
    assert says(viewer) == "nothing"
    viewer.go_back("undo")  # where the same plan is in time
    viewer.worker.settle()
    viewer._planned(edited, found, "")
    viewer.worker.settle()
    assert says(viewer) == "good"


def test_part_of_a_job_is_not_called_certified(opened: Open, scene: Scene, planned: JobResult) -> None:
    marks = planned.trajectory.stages
    part = replace(planned.trajectory.between(0, marks[3].row), stages=marks[:3])
    viewer = opened(scene, part)
    assert says(viewer) == "bad"
    assert "3 of 8 stages" in viewer.verdict
    assert viewer.verdict.count("no motion yet") == 5


def test_a_dragged_object_takes_its_stages_along_and_is_planned(opened: Open, scene: Scene) -> None:
    viewer = opened(scene)

    def drag() -> None:
        viewer.handles.select_obstacle("can")
        viewer.handles.drag(Pose((0.48, 0.25, 0.16)))
        viewer.handles.let_go()

    by_worker(viewer, drag)
    until(lambda: says(viewer) == "good", "it is not planned")
    assert viewer.edited.scene == moved(scene, spots_of(scene)[0], np.array([-0.02, -0.05, 0.0]))
    shown = viewer.edited.shown
    assert shown is not None
    assert certify_job(viewer.edited.scene, shown.trajectory).certified
    assert viewer.first.scene is scene


def test_refused_scenes_and_motions_change_nothing(opened: Open, scene: Scene, planned: JobResult) -> None:
    viewer = opened(scene, planned.trajectory)
    before = viewer.edited
    other = derived(scene, job=hdplan.Job([hdplan.Wait(1.0)]))
    with pytest.raises(InputError, match="another robot"):
        viewer.take_scene(load_scene("ur5_palletize"))
    with pytest.raises(InputError, match="without a job"):
        viewer.take_scene(derived(scene, job=None))
    viewer.take_scene(other)
    viewer.take_motion(planned.trajectory)  # of another job
    viewer.worker.settle()
    assert "its stage 0 is" in viewer.verdict
    assert says(viewer) == "nothing"
    viewer.go_back("undo")
    viewer.worker.settle()
    assert viewer.edited is before
    assert says(viewer) == "good"


def test_a_job_that_is_planned_elsewhere_is_shown(opened: Open) -> None:
    """Its stop reaches whoever plans; what comes of it counts in the very scene that was planned alone."""
    viewer = opened(there_and_wait())
    edited = viewer.edited

    def run(report: Any, stop: Callable[[], bool]) -> JobResult:
        assert viewer.planning.running
        result = plan_job(edited.scene, report=report)
        assert not stop()
        viewer.toggle()
        assert stop()
        return result

    result = viewer.follow(run)
    viewer.worker.settle()
    assert says(viewer) == "good"
    assert not viewer.planning.running
    assert viewer.edited.shown is not None
    assert viewer.edited.shown.trajectory is result.trajectory

    def fails(report: Any, stop: Callable[[], bool]) -> JobResult:
        by_worker(viewer, lambda: viewer.change(EditedJob.of(derived(edited.scene, name="other"))))
        raise InputError("no way there")

    with pytest.raises(InputError, match="no way there"):
        viewer.follow(fails)
    viewer.worker.settle()
    assert says(viewer) == "nothing"
    assert not viewer.planning.running


def test_layers_are_switched_and_follow_the_motion(opened: Open, scene: Scene, planned: JobResult) -> None:
    viewer = opened(scene, planned.trajectory)
    layers, stage = viewer.layers, viewer.stage
    for name in LAYERS:
        layers.set(name, not layers.on(name))
    for now in (0.3, 0.6):
        viewer.player.go_to(now * viewer.player.timeline.end)
        viewer.worker.settle()
        assert not any(
            each.visible for each in (stage.robot, stage.standing.root, stage.closest.root, stage._path.node)
        )
        assert layers._collisions is not None
        np.testing.assert_array_equal(layers._collisions[1].q, stage.robot.q)
        assert len(layers._frames.axes.points) == viewer.robot.model.njoints - 1
        assert not layers._names.labels  # of what is not seen itself
    for name in LAYERS:
        layers.set(name, not layers.on(name))
    viewer.worker.settle()
    assert all(each.visible for each in (stage.robot, stage.standing.root, stage.closest.root, stage._path.node))
    assert layers._collisions is None


def test_saved_files_are_read_again_and_certified(
    opened: Open, scene: Scene, planned: JobResult, tmp_path: Path
) -> None:
    viewer = opened(scene, planned.trajectory)
    sent: list[str] = []
    client = SimpleNamespace(
        client_id=1,
        send_file_download=lambda name, data, save_immediately: (
            sent.append(name),
            (tmp_path / name).write_bytes(data),
        ),
    )
    for what in ("scene", "motion", "page", "anything"):
        viewer.saving._download(what, client)
        viewer.worker.settle()
    assert sent == ["panda_pick_place.yaml", "job.json", "panda_pick_place.html"]
    again = certify_job(load_scene(tmp_path / sent[0]), Trajectory.load(tmp_path / sent[1]))
    assert again.certified
    assert again.text in html.unescape(viewer.saving.text.content)
    by_worker(viewer, lambda: viewer.change(EditedJob.of(derived(scene, name="other"))))
    assert viewer.saving.text.content == ""  # it was of another scene
    viewer.saving._download("motion", client)
    viewer.worker.settle()
    assert "no motion of this job yet" in viewer.saving.text.content


def test_by_mouse_a_job_is_planned_and_a_stage_is_gone_to(browser: Any, tab: Any) -> None:
    """The Plan button plans it, and a click on a stage leads to where it begins, also if its line is rewritten
    meanwhile."""
    from tests.planner.view.in_browser import press

    viewer = open_job_viewer(there_and_wait(), port=8680)
    viewer.server.scene.configure_environment_map(None)
    viewer.server.scene.configure_default_lights(cast_shadow=False)
    try:
        page = tab(viewer.address())
        press(page, "Plan")
        until(lambda: says(viewer) == "good", "it is not planned")
        shown = viewer.edited.shown
        assert shown is not None
        last = shown.certificate.stages[-1]
        # What the server knows, a page shows later: until then the line of that name is one that leads nowhere.
        page.locator(".hd-badge.hd-good").wait_for()
        line = page.get_by_role("button", name=last.name)
        line.hover()
        page.mouse.down()
        by_worker(viewer, lambda: setattr(viewer._rows, "content", viewer._rows.content + "<p>anew</p>"))
        page.get_by_text("anew").wait_for()
        page.mouse.up()
        until(lambda: abs(viewer.player.time - last.begins) < 1e-3, "it does not go to where the stage begins")
        assert page.locator(".hd-badge").inner_text().startswith("✓ certified")
        details = page.locator("details").filter(has_text=last.name)
        line.click()
        line.click()
        opened = details.evaluate("each => each.open")
        for wanted in (opened, not opened):
            if wanted != opened:
                line.click()
            by_worker(viewer, lambda: setattr(viewer._rows, "content", viewer._rows.content + "<p>again</p>"))
            page.get_by_text("again").nth(int(wanted != opened)).wait_for()
            assert details.evaluate("each => each.open") == wanted
    finally:
        viewer.close()
