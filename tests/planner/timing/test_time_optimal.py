"""Laws of the fastest law along a path: toppra's linear programs find the same, loop and twin agree to the bit, limits
hold, and the absence of a law is reported."""

from __future__ import annotations

import numpy as np
import pytest

from hdplan.planner.timing import time_optimal as module
from hdplan.planner.timing.limits import RateLimit
from hdplan.planner.timing.path_spline import PathSpline, smooth
from hdplan.planner.timing.time_optimal import GRID, OnGrid, PathRows, grid, time_optimal
from hdplan.scenes.errors import HdplanError
from tests.loops import in_numpy, needs_loops

ROUNDING = 1e-6  # [–] of a limit
SEIDEL = 1e-5  # [–] by which toppra's law differs: its programs have tolerances, and may fail at a pace


def any_path(rng: np.random.Generator, trial: int) -> PathSpline:
    n, waypoints = int(rng.integers(1, 9)), int(rng.integers(2, 30))
    path = np.cumsum(rng.normal(size=(waypoints, n)) * rng.uniform(0.01, 1.0, n), axis=0)
    if trial % 3 == 0:
        path[:, 0] = path[0, 0]  # a joint that stands
    if trial % 5 == 0:
        path = np.linspace(path[0], path[-1], waypoints)  # straight
    return smooth(path)


def as_torques(rng: np.random.Generator, spline: PathSpline) -> PathRows:
    """Something like torques: with a mass matrix, and gravity that takes a part of each limit."""
    n = len(spline(0.0))
    half = rng.normal(size=(n, n))
    mass, limit = half @ half.T + 0.1 * np.eye(n), rng.uniform(1.0, 50.0, n)
    gravity = rng.uniform(0.0, 0.9, n) * limit * np.sin(spline(grid()) + rng.uniform(0.0, 3.0, n))
    return PathRows.both(spline(grid(), 1) @ mass, spline(grid(), 2) @ mass, gravity, limit)


def test_the_time_law_equals_toppras_within_the_limits() -> None:
    from tests.planner.timing.toppras_law import toppras_path_speeds  # which imports toppra, and that Matplotlib

    rng = np.random.default_rng(17)
    for trial in range(30):
        spline = any_path(rng, trial)
        n = len(spline(0.0))
        velocity, acceleration = rng.uniform(0.5, 3.0, n), rng.uniform(0.5, 15.0, n)
        ours = [RateLimit(order, each).rows(OnGrid.of(spline)) for order, each in ((1, velocity), (2, acceleration))]
        torques = [as_torques(rng, spline)] if trial % 2 else []
        ours += torques
        law = time_optimal([rows for rows in ours if rows is not None])
        path_speeds = toppras_path_speeds(spline, velocity, acceleration, torques)
        assert law.knots[-1] == pytest.approx((2.0 / GRID / (path_speeds[1:] + path_speeds[:-1])).sum(), rel=SEIDEL)
        assert np.median(np.abs(law.path_speeds - path_speeds)) <= SEIDEL * path_speeds.max()
        assert law.path_speeds[0] == law.path_speeds[-1] == 0.0
        assert np.all(np.abs(spline(grid(), 1)) * law.path_speeds[:, None] <= (1 + ROUNDING) * velocity)
        change = np.diff(law.path_speeds**2)[:, None] * GRID / 2
        for a, b, c in filter(None, ours[1:]):
            for end in (slice(-1), slice(1, None)):  # of each interval
                assert np.all(
                    a[end] * change + b[end] * law.path_speeds[end, None] ** 2 <= c[end] + ROUNDING * np.abs(c).max()
                )


@needs_loops
def test_loop_and_twin_agree_to_the_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    for trial in range(12):
        spline = any_path(rng, trial)
        n = len(spline(0.0))
        given = [RateLimit(order, rng.uniform(0.5, 15.0, n)).rows(OnGrid.of(spline)) for order in (1, 2)]
        given += [as_torques(rng, spline)] * (trial % 2)
        rows = [each for each in given if each is not None]
        if trial % 4 == 3:  # hardly any law
            a, b = rng.normal(size=(2, GRID + 1, 3))
            rows.append(PathRows(a, b, np.full((GRID + 1, 3), 10.0 ** rng.uniform(-3, 1))))
        found = []
        with monkeypatch.context() as patch:
            for _ in ("loop", "twin"):
                try:
                    found.append(time_optimal(rows).path_speeds.tobytes())
                except HdplanError as error:
                    found.append(str(error).encode())
                in_numpy(patch, module)
        assert found[0] == found[1]


@pytest.mark.parametrize("loops", [True, False], ids=["loop", "twin"])
def test_the_absence_of_a_law_is_reported(monkeypatch: pytest.MonkeyPatch, loops: bool) -> None:
    """Limits that are not numbers have none, either; without limits, a law is as fast as it gets."""
    if not loops:
        in_numpy(monkeypatch, module)
    one = np.ones((GRID + 1, 1))
    assert time_optimal([]).knots[-1] < 1e-3
    limited = PathRows.both(one, 0.0 * one, 0.0 * one, np.ones(1))
    assert time_optimal([limited]).knots[-1] == pytest.approx(2.0, rel=1e-2)  # half the way each at 1/s²
    height = 1e3 * one
    height[GRID // 2] = -1.0  # u̇² ≤ −1
    unknown = PathRows(one, one * np.nan, one), PathRows(one, one, one * np.nan), PathRows(one * np.inf, one, one)
    for rows in (PathRows(0.0 * one, one, height), PathRows(one, 0.0 * one, -one), *unknown):
        with pytest.raises(HdplanError, match="no time law was found"):
            time_optimal([limited, rows])


def test_limits_too_small_for_any_pace_are_refused_in_words() -> None:
    """The squares of such path_speeds are 0: dividing by them would warn, or give a motion that never ends."""
    spline = smooth(np.array([[0.0, 0.0], [1.0, -1.0], [0.5, 0.3], [1.0, 1.0]]))
    rows = RateLimit(1, np.array([1e-200, 1.0])).rows(OnGrid.of(spline))
    assert rows is not None
    with pytest.raises(HdplanError, match="no time law"):
        time_optimal([rows])


def test_limits_hold_where_a_path_turns_back_or_stands() -> None:
    """There slopes and what is left of rows are rounding, which must not decide the speed."""
    rng = np.random.default_rng(1)
    for _ in range(40):
        path = rng.normal(size=(2, int(rng.integers(1, 8))))
        spline = smooth(np.repeat(np.vstack([path, path[::-1]]), 7, axis=0))
        limits = 10.0 ** rng.uniform(-3.0, 3.0, (2, path.shape[1]))
        given = [RateLimit(order, each).rows(OnGrid.of(spline)) for order, each in zip((1, 2), limits, strict=True)]
        law = time_optimal([rows for rows in given if rows is not None])
        change = np.diff(law.path_speeds**2)[:, None] * GRID / 2
        for end in (slice(-1), slice(1, None)):
            acceleration = spline(grid(), 1)[end] * change + spline(grid(), 2)[end] * law.path_speeds[end, None] ** 2
            assert np.all(np.abs(acceleration) <= (1 + ROUNDING) * limits[1])
