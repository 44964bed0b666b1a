"""Laws of the plots: curves are the motion's own, markers stand where things happen, all plots show one part of the
timeline, and a page's drag decides which."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hdplan.planner.motion.trajectory import StageMark, Trajectory
from hdplan.planner.plan import plan
from hdplan.planner.view.drawing.plot import Plot
from hdplan.planner.view.viewer import Viewer
from hdplan.scenes.limits import Limits
from hdplan.scenes.scene import Scene
from tests.planner.view.events import Opener, by_worker, tell
from tests.planner.view.in_browser import Tabs, calm
from tests.planner.view.in_page import drawn
from tests.waiting import until


@pytest.fixture(scope="module")
def limited(scene: Scene) -> Scene:
    return dataclasses.replace(scene, limits=Limits(velocity=1.0, acceleration=[2.0, 3.0], jerk=40.0))


@pytest.fixture(scope="module")
def timed(limited: Scene) -> Trajectory:
    return plan(limited).trajectory


def curve(plot: Plot, name: str) -> tuple[np.ndarray, np.ndarray]:
    """A curve's moments and values, where it has any."""
    labels = [str(line["label"]) for line in plot.handle.series]
    times, values = plot.handle.data[0], plot.handle.data[labels.index(name)]
    known = np.isfinite(values)
    return np.asarray(times)[known], np.asarray(values)[known]


def choose(viewer: Viewer, quantity: str) -> None:
    plots = viewer.panel.plots.drawn
    plots.quantity.value = quantity
    by_worker(viewer, lambda: viewer.panel.plot())


def test_rates_are_the_motions_own_with_their_limits(opened: Opener, limited: Scene, timed: Trajectory) -> None:
    viewer = opened(limited, found=timed)
    by_worker(viewer, lambda: None)
    plots = viewer.panel.plots.drawn
    for quantity, limits in (("velocity", [1.0]), ("acceleration", [2.0, 3.0]), ("jerk", [40.0])):
        choose(viewer, quantity)
        assert plots.joints.handle.title.startswith(f"{quantity} of the joints")
        times, values = curve(plots.joints, "shoulder")
        inner = slice(2, -2)
        if quantity == "velocity":
            expected = [timed.at_time(at).velocities[0] for at in times[inner]]
            np.testing.assert_allclose(values[inner], expected, atol=1e-6)
        labels = [str(line["label"]) for line in plots.joints.handle.series]
        rows = [plots.joints.handle.data[i] for i, label in enumerate(labels) if label == "limit"]
        assert [float(row[0]) for row in rows] == limits
        assert np.abs(values).max() <= limits[0] * (1 + 1e-6)
    choose(viewer, "torque")
    assert plots.joints.handle.title.startswith("torque of the joints [N m]: none known")


def test_a_path_without_times_has_no_rates(viewer: Viewer, trajectory: Trajectory) -> None:
    choose(viewer, "velocity")
    assert ": none known" in viewer.panel.plots.drawn.joints.handle.title
    choose(viewer, "position")
    _, values = curve(viewer.panel.plots.drawn.joints, "elbow")
    assert values.min() == pytest.approx(trajectory.positions[:, 1].min(), abs=1e-3)


def test_two_motions_are_compared_on_one_axis(opened: Opener, limited: Scene, timed: Trajectory) -> None:
    """The other one is dashed, over the same seconds, and ends where it ends."""
    assert timed.times is not None
    assert timed.velocities is not None
    assert timed.accelerations is not None
    slow = dataclasses.replace(
        timed, times=1.5 * timed.times, velocities=timed.velocities / 1.5, accelerations=timed.accelerations / 2.25
    )
    viewer = opened(limited, found=timed, slow=slow)
    choose(viewer, "position")
    plots = viewer.panel.plots.drawn
    assert slow.times is not None
    own, other = curve(plots.joints, "elbow"), curve(plots.joints, "elbow of slow")
    assert (own[0].max(), other[0].max()) == pytest.approx((timed.times[-1], slow.times[-1]))
    assert own[1][-1] == pytest.approx(other[1][-1])
    dashes = {str(line["label"]): "dash" in line for line in plots.joints.handle.series}
    assert (dashes["elbow"], dashes["elbow of slow"]) == (False, True)


def test_lanes_lie_one_below_another_and_values_stay_true(opened: Opener, limited: Scene, timed: Trajectory) -> None:
    viewer = opened(limited, found=timed)
    joints = viewer.panel.plots.drawn.joints
    for quantity in ("position", "velocity"):
        choose(viewer, quantity)
        alone = {name: curve(joints, name)[1] for name in ("shoulder", "elbow")}
        viewer.panel.plots.drawn.lanes.value = True
        choose(viewer, quantity)
        shares = []
        for lane, (name, values) in enumerate(alone.items()):
            np.testing.assert_array_equal(curve(joints, name)[1], values)
            low, high = joints.handle.scales[f"lane{lane}"]["range"]
            shares.append(((values.min() - low) / (high - low), (values.max() - low) / (high - low)))
        assert 0.0 < shares[1][0] <= shares[1][1] < 0.5 < shares[0][0] <= shares[0][1] < 1.0
        viewer.panel.plots.drawn.lanes.value = False
    choose(viewer, "velocity")
    assert set(joints.handle.scales) == {"x", "y"}


def test_markers_stand_at_the_closest_moment_and_at_stages(opened: Opener, limited: Scene, timed: Trajectory) -> None:
    assert timed.times is not None
    staged = dataclasses.replace(timed, stages=(StageMark("reach", 0), StageMark("place", 20)))
    viewer = opened(limited, found=staged)
    by_worker(viewer, lambda: None)
    plots = viewer.panel.plots.drawn
    motion = viewer.motions.shown[0].motion
    place = int(np.minimum(motion.clearance, motion.self_clearance).argmin())
    times, values = curve(plots.clearance, "closest")
    assert {round(value, 6) for value in values} == {round(1e3 * float(motion.clearance[place]), 6)}
    assert {*times.tolist()} == {float(motion.curve.time_of(motion.parameter[place]))}
    times, _ = curve(plots.clearance, "stages")
    np.testing.assert_allclose(np.unique(times), timed.times[[0, 20]])


def test_all_plots_are_zoomed_together_and_a_click_stays_a_moment(viewer: Viewer) -> None:
    plots = viewer.panel.plots.drawn
    by_worker(viewer, lambda: None)
    tell(viewer, '{"do": "zoom", "from": 0.8, "to": 0.4}')
    assert plots.view == pytest.approx((0.4, 0.8))
    ranges = [plot.handle.scales["x"]["range"] for plot in (plots.clearance, plots.joints)]
    np.testing.assert_allclose(ranges, [(0.4, 0.8)] * 2)
    tell(viewer, '{"do": "seek", "share": 0.5}')
    assert viewer.panel.player.time == pytest.approx(0.6)
    assert plots.view == pytest.approx((0.4, 0.8))  # the bar moves, and the part stays
    for wrong in ('{"do": "zoom", "from": "x", "to": 1}', '{"do": "zoom"}', '{"do": "zoom", "from": 1e999, "to": 0}'):
        tell(viewer, wrong)
        assert plots.view == pytest.approx((0.4, 0.8))
    tell(viewer, '{"do": "zoom", "from": 0, "to": 0}')
    assert plots.view == (0.0, 1.0)


@pytest.mark.slow
def test_a_drag_in_a_plot_zooms_and_the_mouse_reads_values(tab: Tabs, served: Viewer) -> None:
    page = tab(served.address())
    page.get_by_text("certified: at least").first.wait_for()
    calm(served)  # the plots have their curves, for which they are rebuilt
    drawn(page)
    over, legend, plots = page.locator(".u-over").first, page.locator(".u-legend").first, served.panel.plots.drawn

    def read() -> bool:
        over.scroll_into_view_if_needed()
        box = over.bounding_box()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"])
        return "0.2" in legend.inner_text()

    until(read, "no value under the mouse")
    box = over.bounding_box()
    y = box["y"] + 0.5 * box["height"]
    assert "closest–" in "".join(legend.inner_text().split())  # where it has no value: not NaN
    page.mouse.down()
    page.mouse.move(box["x"] + 0.75 * box["width"], y, steps=4)
    page.mouse.up()
    until(lambda: plots.view == pytest.approx((0.25, 0.75), abs=0.02), "it is not zoomed")
    page.mouse.click(box["x"] + 0.5 * box["width"], y)
    until(lambda: served.panel.player.time == pytest.approx(0.5, abs=0.02), "a click does not seek")
    page.mouse.dblclick(box["x"] + 0.5 * box["width"], y)
    until(lambda: plots.view == (0.0, 1.0), "it is not shown whole again")
