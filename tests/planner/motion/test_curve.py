"""Laws of the executed curve: it is the interpolation rule that its file names, and its bounds are never too small."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicSpline

from hdplan import InputError, Trajectory
from hdplan.planner.motion.curve import Curve, row_count

ROWS, JOINTS = 7, 3


def rows(seed: int) -> tuple[np.ndarray, ...]:
    """Times, positions, velocities, accelerations: random, at uneven times."""
    rng = np.random.default_rng(seed)
    return (np.cumsum(rng.uniform(0.05, 2.0, ROWS)), *rng.normal(size=(3, ROWS, JOINTS)))


def curves(seed: int) -> list[Curve]:
    times, positions, velocities, accelerations = rows(seed)
    return [
        Curve.through(positions),
        Curve.through(positions, times),
        Curve.through(positions, times, velocities),
        Curve.through(positions, times, velocities, accelerations),
    ]


@pytest.mark.parametrize("held", [1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_a_curve_is_scipys_hermite_interpolation(held: int, seed: int) -> None:
    """Positions, velocities and accelerations of the rows, and of the curve through them: by another library."""
    times, *values = rows(seed)
    curve = Curve.through(values[0], times, *values[1:held])
    other = BPoly.from_derivatives(times, np.stack(values[:held], axis=1))
    when = np.linspace(times[0], times[-1], 501)
    for order in range(2 * held):
        found = curve.over_time(order).at_parameter(curve.parameter_of(when[1:-1]))
        wanted = (other.derivative(order) if order else other)(when[1:-1])
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9 * max(1.0, np.abs(wanted).max()))
    assert not curve.over_time(2 * held).largest().any()


def test_cubics_through_a_splines_rows_are_the_spline() -> None:
    times, positions, *_ = rows(5)
    spline = CubicSpline(times, positions)
    curve = Curve.through(positions, times, spline(times, 1))
    when = np.linspace(times[0], times[-1], 200)
    np.testing.assert_allclose(curve.at_parameter(curve.parameter_of(when)), spline(when), atol=1e-12)


@pytest.mark.core
@pytest.mark.parametrize("seed", range(4))
def test_no_value_lies_outside_the_bounds(seed: int) -> None:
    for curve in curves(seed):
        for order in range(4 if curve.times is not None else 1):
            values = curve.over_time(order)
            low, high = values.bounds()
            for k in range(ROWS - 1):
                found = values.at(np.full(101, k), np.linspace(0, 1, 101))
                scale = 1e-12 * max(1.0, np.abs(found).max())
                assert np.all(low[k] <= found.min(axis=0) + scale)
                assert np.all(high[k] >= found.max(axis=0) - scale)
                room = np.maximum(high[k] - found.max(axis=0), found.min(axis=0) - low[k])
                assert np.all(room <= 0.15 * np.ptp(found, axis=0) + scale)  # bounds that are true but useless


@pytest.mark.parametrize("seed", range(4))
def test_a_part_leaves_its_chord_no_farther_than_stated(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for curve in curves(seed):
        interval = rng.integers(ROWS - 1, size=20)
        start = rng.uniform(size=20)
        width = (1 - start) * rng.uniform(size=20)
        middle, delta, away = curve.part(interval, start, width)
        np.testing.assert_allclose(middle, curve.at(interval, start + width / 2), rtol=0, atol=1e-12)
        for s in np.linspace(-1, 1, 41):
            found = curve.at(interval, start + 0.5 * (1 + s) * width)
            assert np.all(np.abs(found - middle - s * delta) <= away + 1e-12)
        if curve.degree == 1:
            assert not away.any()
    _, _, whole = curves(seed)[3].part(interval, start, width)
    _, _, half = curves(seed)[3].part(interval, start + width / 4, width / 2)
    assert np.median(half / whole) == pytest.approx(0.25, abs=0.15)  # it falls with the square of the width


@pytest.mark.parametrize("seed", range(4))
def test_several_intervals_leave_their_chord_no_farther_than_stated(seed: int) -> None:
    for curve in curves(seed):
        for count in (2, 4):
            first = np.arange(len(curve) - count)
            middle, delta, away = curve.part(first, np.zeros(len(first)), np.full(len(first), float(count)))
            np.testing.assert_array_equal(middle, curve.rows[first + count // 2])
            for s in np.linspace(-1, 1, 81):
                along = 0.5 * (1 + s) * count
                whole = min(int(along), count - 1)
                found = curve.at(first + whole, np.full(len(first), along - whole))
                assert np.all(np.abs(found - middle - s * delta) <= away + 1e-12)


@pytest.mark.parametrize("place", [0.0, 0.5, 1.0])
def test_a_part_without_width_is_a_point(place: float) -> None:
    for curve in curves(1):
        one = np.array([2]), np.array([place]), np.zeros(1)
        middle, delta, away = curve.part(*one)
        np.testing.assert_allclose(middle, curve.at(one[0], one[1]), atol=1e-14)
        assert max(np.abs(delta).max(), np.abs(away).max()) < 1e-14


def test_jumps_are_reported() -> None:
    times, positions, velocities, _ = rows(2)
    cubic = Curve.through(positions, times, velocities)
    np.testing.assert_allclose(cubic.over_time(1).jumps()[1:-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(cubic.over_time(1).jumps()[[0, -1]], np.abs(velocities[[0, -1]]), atol=1e-12)
    assert cubic.over_time(2).jumps()[1:-1].min() > 1e-3
    slopes = np.diff(positions, axis=0) / np.diff(times)[:, None]
    broken = Curve.through(positions, times).over_time(1).jumps()
    np.testing.assert_allclose(broken[1:-1], np.abs(np.diff(slopes, axis=0)), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_rates_of_rows_do_not_jump_however_close_they_lie(seed: int) -> None:
    times, *values = rows(seed)
    close = times[0] + (times - times[0]) * 1e-4
    rated = [value * scale for value, scale in zip(values, (1.0, 1e4, 1e8), strict=True)]
    for held in (1, 2):
        curve = Curve.through(rated[0], close, *rated[1 : held + 1])
        for order in range(1, held + 1):
            rate = curve.over_time(order).columns([2, 0])
            assert not rate.steps()[1:-1].any()
            np.testing.assert_array_equal(rate.rows, rated[order][:, [2, 0]])


@pytest.mark.parametrize("ending", [".json", ".csv", ".npz"])
@pytest.mark.parametrize("held", [0, 1, 2, 3])
def test_a_controller_that_samples_the_file_finds_the_curve(ending: str, held: int, tmp_path: Path) -> None:
    """Written, read, sampled 1,000 times a second by the rule that the file names: nothing else."""
    times, *values = rows(3)
    timed = (times, *values[1:held]) if held else ()
    written = Trajectory(("a", "b", "c"), values[0], {}, *timed)
    written.save(tmp_path / f"motion{ending}")
    read = Trajectory.load(tmp_path / f"motion{ending}")
    for name in ("positions", "times", "velocities", "accelerations"):
        first, second = getattr(written, name), getattr(read, name)
        assert (first is None) == (second is None)
        if first is not None:
            np.testing.assert_array_equal(first, second)
    if held:
        other = BPoly.from_derivatives(read.times, np.stack(values[:held], axis=1))
        when = np.arange(times[0], times[-1], 1e-3)
        found = written.curve.at_parameter(written.curve.parameter_of(when))
        np.testing.assert_allclose(found, other(when), rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("rates", "words"),
    [
        ({"velocities": np.zeros((2, 1))}, "velocities: need times"),
        ({"times": [0, 1], "accelerations": np.zeros((2, 1))}, "accelerations: need velocities"),
        ({"times": [0, 1], "velocities": np.zeros((2, 2))}, r"velocities: shape \(2, 2\), expected \(2, 1\)"),
        ({"times": [0, 1], "velocities": [[np.nan], [0]]}, "velocities: waypoint 0, joint 'a': nan is not a finite"),
    ],
)
def test_rates_that_do_not_fit_are_refused(rates: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Trajectory(("a",), np.zeros((2, 1)), **rates)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("time,a,b,a.velocity", "column 'b.velocity' is missing beside 'a.velocity'"),
        ("time,a,b,c.velocity", "column 'a.velocity' is missing beside 'c.velocity'"),
        ("time,a,a,b", "'a' appears twice"),
    ],
)
def test_columns_that_do_not_fit_are_refused(header: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    file.write_text(f"{header}\n0,1,2,3\n1,2,3,4\n")
    with pytest.raises(InputError, match=words):
        Trajectory.load(file)


def test_a_rule_that_the_rows_do_not_hold_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "motion.json"
    Trajectory(("a",), np.zeros((2, 1)), {}, np.arange(2.0)).save(file)
    file.write_text(file.read_text().replace('"linear"', '"quintic"'))
    with pytest.raises(InputError, match="interpolation: 'quintic', but the fields of its rows make it linear"):
        Trajectory.load(file)


@pytest.mark.parametrize(("duration", "rate", "count"), [(1.0, 100, 101), (0.3, 10, 4), (0.301, 10, 5), (1e-6, 10, 2)])
def test_rows_are_no_farther_apart_than_the_rate_says(duration: float, rate: float, count: int) -> None:
    assert row_count(duration, rate) == count
