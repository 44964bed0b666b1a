"""Messages of the page to the server, and the list of motions: clicks take effect, and nonsense changes nothing."""

from __future__ import annotations

import dataclasses
import html

import numpy as np
import pytest

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.view.drawing.colors import MOTIONS
from hdplan.planner.view.motions import LONGEST_NAME
from hdplan.planner.view.planning import KEPT_PLANS, NAME
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene
from tests.planner.view.events import Opener, by_worker, straight, tell


@pytest.fixture
def viewer(opened: Opener, scene: Scene, trajectory: Trajectory) -> Viewer:
    line = straight(trajectory)
    return opened(scene, found=trajectory, line=line)


def curves(viewer: Viewer) -> list[str]:
    """The motions whose clearance is plotted."""
    series = [str(line["label"]) for line in viewer.panel.plots.drawn.clearance.handle.series]
    return series[1:-5]


def motions(viewer: Viewer) -> list[str]:
    return [shown.motion.name for shown in viewer.motions.shown]


def test_a_click_on_a_line_chooses_its_motion(viewer: Viewer, trajectory: Trajectory) -> None:
    first, second = viewer.motions.shown
    assert viewer.motions.active is first
    viewer.show(0.5)
    tell(viewer, do="choose", motion=second.number)
    assert viewer.motions.active is second
    np.testing.assert_allclose(viewer.stage.robot.q, second.motion.curve.at_parameter(0.5))
    assert not viewer.motion_nodes.of(second).robot.visible  # the robot itself stands there
    assert viewer.motion_nodes.of(first).robot.visible


def test_a_hidden_motion_is_seen_neither_in_the_scene_nor_in_the_plots(viewer: Viewer) -> None:
    _, second = viewer.motions.shown
    viewer.show(0.5)
    nodes = viewer.motion_nodes.of(second)
    for visible, plotted in ((True, ["found", "line"]), (False, ["found"]), (True, ["found", "line"])):
        assert (nodes.path.node.visible, nodes.robot.visible) == (visible, visible)
        assert curves(viewer) == plotted
        tell(viewer, do="hide", motion=second.number)


def test_a_name_is_any_text_that_no_other_motion_has(viewer: Viewer) -> None:
    first, second = viewer.motions.shown
    wanted = '<b onclick="x">&amp; "quoted"</b>'
    tell(viewer, do="rename", motion=second.number, answer=f"  {wanted}\n")
    assert motions(viewer) == ["found", wanted]
    assert html.escape(wanted) in viewer.panel.rows.html.content
    assert wanted not in viewer.panel.rows.html.content
    for refused in ("found", "", " \n", "x" * (LONGEST_NAME + 1)):
        tell(viewer, do="rename", motion=second.number, answer=refused)
        assert motions(viewer) == ["found", wanted]
        assert "motion" in viewer.panel.verdict.split("</div>")[0]
    tell(viewer, do="rename", motion=first.number, answer="found")  # its own
    assert motions(viewer) == ["found", wanted]


def test_removed_motions_are_gone_and_the_last_one_leaves_the_first_thing_to_do(viewer: Viewer) -> None:
    first, second = viewer.motions.shown
    tell(viewer, do="remove", motion=first.number)
    assert viewer.motions.active is second
    tell(viewer, do="remove", motion=first.number)  # another browser was slower
    tell(viewer, do="remove", motion=second.number)
    assert viewer.motions.active is None
    assert viewer.panel.rows.html.content == ""
    assert "press Plan" in viewer.panel.verdict
    np.testing.assert_array_equal(viewer.stage.robot.q, viewer.edited.start)


def test_the_closest_moment_is_the_closest(viewer: Viewer) -> None:
    for shown in viewer.motions.shown:
        tell(viewer, do="closest", motion=shown.number)
        assert viewer.motions.active is shown
        least = min(shown.motion.clearance.min(), shown.motion.self_clearance.min())
        here = min(pair.distance for pair in viewer.certifier.closest(viewer.configuration, 0.0) if pair)
        assert here == pytest.approx(least, abs=1e-4)  # the slider has steps


def test_a_click_in_a_plot_goes_to_that_moment(viewer: Viewer) -> None:
    for share in (0.25, 1.0, 0.0):
        tell(viewer, do="seek", share=share)
        assert viewer.panel.player.time == pytest.approx(share, abs=1e-3)


def test_invalid_messages_of_a_page_change_nothing(viewer: Viewer) -> None:
    """Seeded nonsense: no error, no motion gone (the fixture checks the console)."""
    rng = np.random.default_rng(0)
    words = ["choose", "hide", "rename", "closest", "seek", "theme", "", "quit", None, 3, [], {}]
    values = [-1, 1e9, "NaN", None, [], {}, True, "1", 0.5, "x" * 5000]
    before = [(shown.number, shown.motion.name) for shown in viewer.motions.shown]
    for text in ("", "{", "[]", "3", '"do"', "{}", '{"do": "choose"}', "\x00", "[" * 2000):
        tell(viewer, text)
    for _ in range(100):
        keys = rng.choice(["motion", "share", "answer", "dark", "at"], 3)
        message = {str(key): values[rng.integers(len(values))] for key in keys}
        message["motion"] = [None, -1, 99, "1", []][rng.integers(5)]
        word = words[rng.integers(len(words))]
        if word != "theme":  # which needs a real browser
            tell(viewer, do=word, **message)
    assert [(shown.number, shown.motion.name) for shown in viewer.motions.shown] == before


def test_plans_that_follow_each_other_are_kept_but_not_for_ever(opened: Opener, scene: Scene) -> None:
    viewer = opened(scene)
    results = [
        plan(dataclasses.replace(scene, planner=dataclasses.replace(scene.planner, clearance=0.002 * k)))
        for k in range(KEPT_PLANS + 2)
    ]

    def finish(result: object) -> None:
        by_worker(viewer, lambda: viewer.panel.planning._finish(viewer.scene, result, "found"))

    for result in results:
        finish(result)
    assert len(viewer.motions.shown) == KEPT_PLANS
    assert viewer.motions.active is viewer.motions.shown[-1]
    assert len({shown.color for shown in viewer.motions.shown}) == min(KEPT_PLANS, len(MOTIONS))
    assert len(set(motions(viewer))) == KEPT_PLANS
    finish(results[-1])  # found once more: the same motion, the same line
    assert len(viewer.motions.shown) == KEPT_PLANS
    assert all(name.startswith(NAME) for name in motions(viewer))
