"""Laws of quality over time: motions only get better, what is drawn is what was found, and what has no choice of its
time is left out by name."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from hdplan import Trajectory, load_robot, load_scene
from hdplan.planner.studies.anytime import AnytimeCurve, Moment, _measures, anytime_curves, anytime_rows, shares
from tests.extras import needs

pytestmark = needs("matplotlib")


def test_motions_get_better_and_are_counted_once() -> None:
    curves, left_out = anytime_curves([load_scene(name) for name in ("panda_cage", "panda_conveyor")], quick=True)
    (curve,) = curves
    assert left_out == ["panda_conveyor: its duration is given"]
    assert len(curve.moments) > 1
    assert all(np.diff([moment.seconds for moment in curve.moments]) > 0.0)
    assert all(np.diff([moment.duration for moment in curve.moments]) < 0.0)
    assert len(anytime_rows(curves)) == len(curve.moments)
    table = shares(curves)
    assert table[0]["motion time [%]"] == pytest.approx(100.0)
    assert float(table[-1]["motion time [%]"]) <= 100.0


def test_it_stops_with_what_there_is() -> None:
    curves, left_out = anytime_curves([load_scene("panda_cage")], quick=True, stop=lambda: True)
    assert (curves, left_out) == ([], [])


def test_acceleration_and_path_by_hand() -> None:
    """Constant acceleration of 2 rad/s² from rest for a second: ∫ 4 dt = 4, and 1 rad."""
    robot = load_robot("panda")
    times = np.linspace(0.0, 1.0, 5)
    one = np.eye(7)[0]
    rows, rates = np.outer(times**2, one), np.outer(2.0 * times, one)
    motion = Trajectory(robot.joint_names, rows, robot.locked, times, rates, np.tile(2.0 * one, (5, 1)))
    length, squared = _measures(robot, motion)
    assert length == pytest.approx(1.0)
    assert squared == pytest.approx(4.0)


def test_the_best_at_a_time() -> None:
    curve = AnytimeCurve("x", (Moment(1.0, 3.0, 3.0, 3.0), Moment(2.0, 2.0, 2.0, 2.0)))
    assert [curve.best_at(seconds).duration for seconds in (0.5, 1.0, 1.9, 2.0, 9.0)] == [3.0, 3.0, 3.0, 2.0, 2.0]


def test_names_do_not_cover_each_other() -> None:
    """Also where two motions gain the same, and everything written is in the picture."""
    from hdplan.planner.studies.anytime_sheet import anytime_sheet

    rows = {"a_scene_with_a_long_name": 0.8, "another": 0.8, "a_third": 0.801, "a_fourth": 1.1}
    curves = [
        AnytimeCurve(scene, (Moment(0.1, 1.0, 1.0, 1.0), Moment(0.5, share, share, share)))
        for scene, share in rows.items()
    ]
    figure = anytime_sheet(curves)
    figure.draw_without_rendering()
    for axis in figure.axes:
        boxes = [text.get_window_extent() for text in axis.texts]
        assert len(boxes) == 3
        assert not any(one.overlaps(two) for one, two in itertools.combinations(boxes, 2))
    assert all(figure.bbox.y0 <= text.get_window_extent().y0 for text in figure.texts)
    assert all(text.get_window_extent().x1 <= figure.bbox.x1 for text in figure.texts)
