"""The edited document, without a server: after edits in any order, what is known of a motion is true, undo restores
scene and motions, and every listener hears of all."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable

import numpy as np
import pytest

from hdplan.planner.certificate.certifier import certify
from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.robot.setup import Setup
from hdplan.planner.view import scene_edits
from hdplan.planner.view.document import Document
from hdplan.planner.view.edited_scene import Edited
from hdplan.scenes.errors import HdplanError, InputError
from hdplan.scenes.scene import Scene


class Hall:
    """A listener that may fail."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.fails = False

    def scene_changed(self, before: Scene) -> None:
        self.calls.append("scene")
        if self.fails:
            raise ZeroDivisionError

    def motions_changed(self) -> None:
        self.calls.append("motions")

    def doubted(self) -> None:
        self.calls.append("doubted")

    def left(self) -> None:
        self.calls.append("left")


@pytest.fixture
def hall() -> Hall:
    return Hall()


@pytest.fixture
def document(scene: Scene, trajectory: Trajectory, hall: Hall) -> Document:
    document = Document(Edited.of(Setup.of(scene)), hall)
    document.put("planned", trajectory)
    hall.calls.clear()
    return document


def assert_true(document: Document) -> None:
    """Verdicts on the motions in the scene as it is now are those of the certifier."""
    motions = document.motions
    assert (motions.active is None) == (not motions.shown)
    for shown in motions.shown:
        if document.holds(shown):
            again = certify(document.scene, shown.motion.trajectory, document.edited.robot)
            assert shown.motion.certificate.text == again.text


def moved(x: float) -> Callable[[Edited], Edited]:
    def edit(edited: Edited) -> Edited:
        at = edited.scene.obstacles[0].pose.position
        return scene_edits.placed(edited, edited.scene.obstacles[0].name, (at[0] + x, at[1], at[2]))

    return edit


def test_random_edits_in_any_order_keep_the_document_consistent(
    scene: Scene, trajectory: Trajectory, hall: Hall
) -> None:
    rng = np.random.default_rng(7)
    document = Document(Edited.of(Setup.of(scene)), hall)
    document.put("plan 0", trajectory)
    seen: set[object] = set()

    def delete() -> None:
        if len(document.scene.obstacles) > 1:
            document.change(scene_edits.deleted(document.edited, document.scene.obstacles[-1].name))

    def in_the_way() -> None:
        if (active := document.motions.active) is not None:
            x, y, z = active.motion.tip[len(active.motion.tip) // 2].tolist()
            name = document.scene.obstacles[0].name
            document.change(scene_edits.placed(document.edited, name, (x, y, z)), check=True)

    acts: list[Callable[[], object]] = [
        lambda: document.put(f"plan {rng.integers(3)}", trajectory, measured=rng.random() < 0.5),
        in_the_way,
        lambda: document.change(moved(0.1 * rng.normal())(document.edited), check=rng.random() < 0.5),
        lambda: document.change(moved(0.02)(document.edited), step=False),
        delete,
        document.undo,
        document.redo,
        document.reset,
        document.measure,
        lambda: document.motions.shown and document.remove(document.motions.shown[0]),
        lambda: document.motions.shown and document.choose(document.motions.shown[0].motion.name),
        lambda: document.make_room(2),
    ]
    for act in [lambda: None, *(acts[k] for k in rng.integers(len(acts), size=40))]:
        act()
        assert_true(document)
        active = document.motions.active
        known = active is not None and document.holds(active)
        seen.add("nothing" if active is None or not known else active.motion.certificate.certified)
    assert seen == {"nothing", True, False}
    document.measure()
    assert all(document.holds(shown) or shown.misfit for shown in document.motions.shown)


def test_undo_brings_scene_and_motions_back(document: Document, trajectory: Trajectory) -> None:
    first = document.edited
    document.rename(document.motions.shown[0], "mine")
    document.change(moved(0.05)(document.edited))
    document.put("planned", trajectory, step=False)  # as live does: a part of the same step
    assert [shown.motion.name for shown in document.motions.shown] == ["mine", "planned"]
    document.undo()
    assert document.edited is first
    assert [shown.motion.name for shown in document.motions.shown] == ["mine"]
    document.undo()
    assert [shown.motion.name for shown in document.motions.shown] == ["planned"]
    document.redo()
    document.redo()
    assert [shown.motion.name for shown in document.motions.shown] == ["mine", "planned"]
    assert_true(document)


def test_earlier_scenes_keep_no_certifiers(document: Document) -> None:
    """They are the largest part of a step, and made again when somebody comes back."""
    earlier = []
    for step in (True, True, False, True):
        earlier.append(weakref.ref(document.edited.certifier))
        document.change(moved(0.01)(document.edited), step=step)
    gc.collect()
    assert [each() for each in earlier] == [None] * len(earlier)
    now = document.edited.certifier
    document.undo()
    document.redo()
    assert document.edited.certifier is not now
    assert_true(document)


def test_a_change_of_the_active_motion_is_reported_first(
    document: Document, hall: Hall, trajectory: Trajectory
) -> None:
    """Before anything is shown of it: what is planned from the old one would take its place."""
    acts: list[Callable[[], object]] = [
        lambda: document.put("another", trajectory),
        lambda: document.choose("planned"),
        lambda: document.remove(document.motions.shown[0]),
        document.undo,
        document.redo,
        document.reset,
    ]
    for act in acts:
        hall.calls.clear()
        act()
        assert hall.calls[0] == "left"
        assert hall.calls[-1] == "motions" or act == document.reset


def test_of_a_scene_that_could_not_be_shown_nothing_is_known(document: Document, hall: Hall) -> None:
    hall.fails = True
    with pytest.raises(ZeroDivisionError):
        document.change(moved(0.001)(document.edited), check=True)
    assert hall.calls == ["scene", "doubted"]
    assert not document.holds(document.motions.shown[0])
    hall.fails = False
    document.measure()
    assert document.holds(document.motions.shown[0])


def test_refused_edits_change_nothing(document: Document, hall: Hall) -> None:
    before = document.edited
    document.locked.add(before.scene.obstacles[0].name)
    with pytest.raises(InputError, match="is locked"):
        document.change(moved(0.1)(before))
    with pytest.raises(HdplanError, match="1 to 40 characters"):
        document.rename(document.motions.shown[0], " ")
    assert document.edited is before
    assert hall.calls == []
    document.undo()  # of what came before: nothing was added
    assert not document.motions.shown
