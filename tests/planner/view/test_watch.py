"""Laws of files that change on disk: the page follows them, whole or not at all, and so do its messages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view import watch as watch_module
from hdplan.planner.view.things import Thing
from hdplan.planner.view.viewer import Viewer
from hdplan.planner.view.watch import Seen, Source, Watch, seen, seen_meshes
from hdplan.scenes.poses import Pose
from hdplan.scenes.scene import Scene
from hdplan.scenes.yaml_format.reader import load_scene, shipped_scenes
from tests.planner.view.events import Opener, active_of, by_worker
from tests.waiting import until

HOOK = shipped_scenes()["panda_vase"].parent / "hook.obj"
HOOKED = "  - {name: hook, shape: {type: mesh, file: hook.obj}, pose: {position: [0, -3, 0]}}\n"


@pytest.fixture
def files(scene: Scene, trajectory: Trajectory, tmp_path: Path) -> tuple[Path, Path]:
    """A scene with a mesh, and a motion."""
    assert scene.source is not None
    for each in Path(scene.source).parent.glob("planar_arm.*"):
        shutil.copy(each, tmp_path)
    shutil.copy(HOOK, tmp_path)
    file = tmp_path / "planar_arm.yaml"
    file.write_text(file.read_text().replace("obstacles:\n", f"obstacles:\n{HOOKED}"))
    trajectory.save(tmp_path / "motion.json")
    return file, tmp_path / "motion.json"


@pytest.fixture
def viewer(
    opened: Opener, files: tuple[Path, Path], trajectory: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Viewer]:
    monkeypatch.setattr(watch_module, "EVERY", 0.05)
    found = opened(load_scene(files[0]), motion=trajectory)
    watch: Watch = found.panel.opening.follow(
        lambda: load_scene(files[0]), seen([files[0]]), seen_meshes(found.scene), {"motion": seen([files[1]])}
    )
    yield found
    watch.close()


def says_the_truth(viewer: Viewer, file: Path) -> None:
    """The verdict on the motion is the one that holds in the file's scene."""
    assert viewer.worker.settle(20)
    by_worker(viewer, viewer.document.measure)
    motion = active_of(viewer).motion
    assert motion.scene is viewer.scene
    assert motion.certificate.text == certify(load_scene(file), motion.trajectory).text


def place_of_ball(viewer: Viewer) -> tuple[float, ...]:
    return next(each.pose.position for each in viewer.scene.obstacles if each.name == "ball")


def test_a_scene_is_followed_whole_or_not_at_all(viewer: Viewer, files: tuple[Path, Path]) -> None:
    """A ball that moves, half a file, no file, a file of another robot, and the first one again."""
    text, first = files[0].read_text(), viewer.edited
    moved = text.replace("[0.9, 0.05, 0.1]", "[0.9, -0.35, 0.1]")
    files[0].write_text(moved)
    until(lambda: place_of_ball(viewer) == (0.9, -0.35, 0.1), "the ball stays")
    says_the_truth(viewer, files[0])
    shown, editing = viewer.edited, viewer.panel.editing
    for wrong, words in (
        (moved[: moved.index("start:")], "start"),
        (moved.replace("radius: 0.12", "radius: -1"), "radius"),
        ("hdplan: 1\nrobot: {name: ur5}\nobstacles: []\nstart: {state: default}\ngoal: {state: default}\n", ""),
    ):
        files[0].write_text(wrong)
        until(
            lambda words=words: "not done: " in editing.text.content and words in editing.text.content,
            "the panel has no message",
        )
        assert viewer.edited is shown
        by_worker(viewer, lambda: editing.say(""))
    files[0].unlink()
    files[0].with_suffix(".new").write_text(text)
    files[0].with_suffix(".new").rename(files[0])
    until(lambda: place_of_ball(viewer) == (0.9, 0.05, 0.1), "the ball stays")
    says_the_truth(viewer, files[0])
    editing.ask("undo")
    until(lambda: viewer.edited is shown, "it cannot be undone")
    assert first is not shown


def test_no_change_after_the_first_reading_is_missed(tmp_path: Path) -> None:
    """Neither before the first look, nor of a renamed file, nor of one that goes and comes back."""
    scene, mesh, counts = tmp_path / "scene", tmp_path / "mesh", []

    def looked() -> int:
        counts.clear()
        for _ in range(3):
            source.look()
        return len(counts)

    def read() -> Seen:
        counts.append(1)
        return seen([mesh] if "mesh" in scene.read_text() else [])

    scene.write_text("first")
    source = Source(seen([scene]), read)
    assert looked() == 0
    scene.write_text("changed before the first look")
    source = Source({scene: ()}, read)
    assert looked() == 1
    scene.write_text("a mesh that comes later")
    assert looked() == 1
    mesh.write_text("half")
    source.look()
    mesh.write_text("whole")  # while it is being written
    counts.clear()
    source.look()
    assert not counts
    assert looked() == 1
    mesh.unlink()
    assert looked() == 1  # which reports that it is missing
    scene.write_text("without it")
    assert looked() == 1
    mesh.write_text("another")
    assert looked() == 0


def test_a_mesh_that_changes_is_another_obstacle(viewer: Viewer, files: tuple[Path, Path]) -> None:
    node = next(each for each in viewer.stage.obstacles if each.obstacle.name == "hook")
    before, mesh = viewer.edited, files[0].parent / "hook.obj"
    rows = [line.split() for line in mesh.read_text().splitlines()]
    mesh.unlink()
    files[0].write_text(files[0].read_text() + " ")  # the scene is read, and refused, before its mesh is there again
    until(lambda: "does not exist" in viewer.panel.editing.text.content, "the panel has no message")
    assert viewer.edited is before
    mesh.write_text("\n".join(f"v {r[1]} {float(r[2]) + 2.2} {r[3]}" if r[:1] == ["v"] else " ".join(r) for r in rows))
    until(lambda: viewer.edited is not before, "the mesh stays as it was")
    says_the_truth(viewer, files[0])
    again = next(each for each in viewer.stage.obstacles if each.obstacle.name == "hook")
    assert again is not node
    assert not np.array_equal(again.mesh.vertices, node.mesh.vertices)


def test_a_file_changes_while_something_is_dragged(viewer: Viewer, files: tuple[Path, Path]) -> None:
    """One that is refused leaves it in the hand; one that is taken puts it where it says, out of the hand."""
    handles, text = viewer.panel.handles, files[0].read_text()
    viewer.worker.ask("select", lambda: handles.select(Thing("obstacle", "ball")))
    viewer.worker.ask("drag", lambda: handles.drag(Pose((0.8, 0.05, 0.1))))
    files[0].write_text(text.replace("radius: 0.12", "radius: -1"))
    until(lambda: "not done: " in viewer.panel.editing.text.content, "it is not reported")
    assert handles.dragging
    assert place_of_ball(viewer) == (0.8, 0.05, 0.1)
    files[0].write_text(text.replace("name: prism", "name: other"))
    until(lambda: "opened: " in viewer.panel.editing.text.content, "it is not opened")
    assert viewer.worker.settle(20)
    assert not handles.dragging
    assert place_of_ball(viewer) == (0.9, 0.05, 0.1)
    says_the_truth(viewer, files[0])


def test_a_motion_is_followed(viewer: Viewer, files: tuple[Path, Path], trajectory: Trajectory) -> None:
    half = trajectory.between(0, 9)
    half.save(files[1])
    active = active_of(viewer)
    until(lambda: len(active.motion.trajectory.positions) == 10, "the motion stays")
    says_the_truth(viewer, files[0])
    assert not active.motion.certificate.certified
    files[1].write_text("{")
    until(lambda: "not done: " in viewer.panel.editing.text.content, "the panel has no message")
    assert len(active.motion.trajectory.positions) == 10
