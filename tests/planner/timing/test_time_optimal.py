"""Laws of the fastest law along a path: it is toppra's to the bit, within the limits, and none where there is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from toppra import constraint
from toppra.algorithm import TOPPRA

from hdplan.planner.timing import time_optimal as module
from hdplan.planner.timing.limits import RateLimit
from hdplan.planner.timing.retiming import smooth
from hdplan.planner.timing.time_optimal import GRID, grid, time_optimal
from hdplan.scenes.errors import HdplanError

ROUNDING = 1e-6  # [–] of a limit


class Impossible(constraint.LinearConstraint):  # type: ignore[misc]
    """u̇² ≤ −1 at the middle of the path, and u̇² ≤ 1000 elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.identical = True  # F and g are the same at all points

    def compute_constraint_params(self, path: Any, points: np.ndarray, *_: Any) -> tuple[Any, ...]:
        one, height = np.ones((len(points), 1)), np.full((len(points), 1), -1e3)
        height[len(points) // 2] = 1.0
        return 0.0 * one, one, height, np.ones((1, 1)), np.zeros(1), None, None


def constraints(rng: np.random.Generator, n: int) -> tuple[list[Any], np.ndarray, np.ndarray]:
    velocity, acceleration = rng.uniform(0.5, 3.0, n), rng.uniform(0.5, 15.0, n)
    both = [np.stack([-each, each], axis=1) for each in (velocity, acceleration)]
    made = [constraint.JointVelocityConstraint(both[0]), constraint.JointAccelerationConstraint(both[1])]
    return made, velocity, acceleration


def test_it_is_toppras_own_law_within_the_limits() -> None:
    rng = np.random.default_rng(17)
    for trial in range(30):
        n, waypoints = int(rng.integers(1, 9)), int(rng.integers(2, 30))
        path = np.cumsum(rng.normal(size=(waypoints, n)) * rng.uniform(0.01, 1.0, n), axis=0)
        if trial % 3 == 0:
            path[:, 0] = path[0, 0]  # a joint that stands
        spline = smooth(path)
        limits, velocity, acceleration = constraints(rng, n)
        law = time_optimal(spline, limits)
        own = TOPPRA(limits, module._Path(spline), gridpoints=grid())
        _, path_speeds, _ = own.compute_parameterization(0.0, 0.0)
        assert law.path_speeds.tobytes() == path_speeds.tobytes()
        assert law.path_speeds[0] == law.path_speeds[-1] == 0.0
        assert np.all(np.abs(spline(grid(), 1)) * law.path_speeds[:, None] <= (1 + ROUNDING) * velocity)
        middle = 0.5 * (law.path_speeds[1:] ** 2 + law.path_speeds[:-1] ** 2)[:, None]
        bend, slope = (0.5 * (values[1:] + values[:-1]) for values in (spline(grid(), 2), spline(grid(), 1)))
        change = (np.diff(law.path_speeds**2) * GRID / 2)[:, None]
        assert np.mean(np.abs(bend * middle + slope * change) <= 1.05 * acceleration) > 0.95


def test_where_there_is_no_law_it_is_said() -> None:
    spline = smooth(np.linspace(np.zeros(1), np.ones(1), 5))
    limits, _, _ = constraints(np.random.default_rng(1), 1)
    assert time_optimal(spline, limits).path_speeds.max() > 0.0
    with pytest.raises(HdplanError, match="no time law was found"):
        time_optimal(spline, [*limits, Impossible()])


def test_limits_too_small_for_any_pace_are_refused_in_words() -> None:
    """The squares of such path_speeds are 0: dividing by them would warn, or give a motion that never ends."""
    spline = smooth(np.array([[0.0, 0.0], [1.0, -1.0], [0.5, 0.3], [1.0, 1.0]]))
    limit = RateLimit(1, np.array([1e-200, 1.0])).constraint(spline, grid())
    with pytest.raises(HdplanError, match="no time law"):
        time_optimal(spline, [limit])
