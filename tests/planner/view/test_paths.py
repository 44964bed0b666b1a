"""The colours of paths: none that fails looks healthy, whatever else is shown, and the legend says what they mean."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.planner.motion.trajectory import Trajectory
from hdplan.planner.view.drawing import colors
from hdplan.planner.view.drawing.colors import CONTACT, MOTIONS, clearance_colors, hex_of, intensities
from hdplan.planner.view.drawing.nodes import PATH_WIDTH
from hdplan.planner.view.motion_nodes import FAINT
from hdplan.planner.view.motions import Shown
from hdplan.planner.view.things import Thing
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.scene import Scene
from tests.planner.view.events import Opener, by_worker, straight

LINES = (*MOTIONS, *colors.LINES, *colors.SHADES, colors.START, colors.GOAL, colors.INK, colors.LINKS, colors.ITERATE)
GROUNDS = {"light": 255, "dark": 36}  # grey of the page
MM = "mm clear"  # of the scale of clearances


@pytest.fixture
def viewer(opened: Opener, scene: Scene, trajectory: Trajectory) -> Viewer:
    """One motion that is certified, and one that runs into the obstacles."""
    line = straight(trajectory)
    return opened(scene, found=trajectory, line=line)


def drawn(viewer: Viewer, shown: Shown) -> np.ndarray:
    """The colours of a path, each once (c, 3)."""
    return np.unique(np.asarray(viewer.motion_nodes.of(shown).path.node.colors).reshape(-1, 3), axis=0)


def one(color: tuple[int, int, int]) -> list[list[int]]:
    return intensities(np.array([color], dtype=np.uint8)).tolist()


@pytest.mark.parametrize("theme", GROUNDS)
def test_every_line_shows_on_a_light_page_and_a_dark_one(theme: str) -> None:
    """A contrast of 3 : 1, as WCAG 2.2 asks of graphics: the larger luminance by the smaller, both with 0.05 added."""
    scale = clearance_colors(np.linspace(0.0, colors.FAR_CLEARANCE, 200))
    ground = np.array([[GROUNDS[theme]] * 3])
    rows = np.concatenate([np.array([CONTACT, FAINT, *LINES]), scale, ground]) / 255.0
    linear = np.where(rows <= 0.04045, rows / 12.92, ((rows + 0.055) / 1.055) ** 2.4)
    *lines, page = (linear @ [0.2126, 0.7152, 0.0722] + 0.05).tolist()
    assert min(max(line / page, page / line) for line in lines) >= 3.0


@pytest.mark.parametrize("chosen", ["found", "line", ""])
def test_a_motion_that_collides_is_red_beside_any_other(viewer: Viewer, chosen: str) -> None:
    """Whichever is chosen, and at first."""
    if chosen:
        by_worker(viewer, lambda: viewer.document.choose(chosen))
    found, line = viewer.motions.shown
    assert drawn(viewer, line).tolist() == one(CONTACT)
    assert {tuple(link.mesh.color) for link in viewer.motion_nodes.of(line).robot.links} == {CONTACT}
    if chosen != "line":
        scale = clearance_colors(found.motion.clearance)
        assert drawn(viewer, found).tolist() == np.unique(intensities(scale), axis=0).tolist()
        assert MM in viewer.panel.legend.content
    else:
        assert drawn(viewer, found).tolist() == one(found.color)
        assert found.color in MOTIONS
        assert MM not in viewer.panel.legend.content
        assert hex_of(CONTACT) in viewer.panel.legend.content
        assert "in contact" in viewer.panel.legend.content


def test_the_chosen_path_alone_is_wide(viewer: Viewer) -> None:
    for name in ("found", "line", "found"):
        if viewer.motions.active is None or viewer.motions.active.motion.name != name:
            by_worker(viewer, lambda name=name: viewer.document.choose(name))
        nodes = viewer.motion_nodes
        widths = {shown.motion.name: nodes.of(shown).path.node.thickness for shown in viewer.motions.shown}
        assert widths[name] == PATH_WIDTH
        assert all(width < PATH_WIDTH for other, width in widths.items() if other != name)


def test_the_legend_means_the_colours_that_are_drawn(viewer: Viewer) -> None:
    """While something is dragged, after it, and where there is no motion."""
    by_worker(viewer, lambda: viewer.panel.handles.select(Thing("obstacle", "ball")))
    ball = next(each for each in viewer.scene.obstacles if each.name == "ball")
    by_worker(viewer, lambda: viewer.panel.handles.drag(ball.pose))
    assert MM not in viewer.panel.legend.content
    assert "not checked in this scene yet" in viewer.panel.legend.content
    assert drawn(viewer, viewer.motions.shown[0]).tolist() == one(FAINT)
    by_worker(viewer, viewer.panel.handles.let_go)
    assert MM in viewer.panel.legend.content
    for shown in list(viewer.motions.shown):
        by_worker(viewer, lambda shown=shown: viewer.document.remove(shown))
    assert viewer.panel.legend.content == ""
