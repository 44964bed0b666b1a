"""The fastest law along a path within the limits of velocity, acceleration and torque, by TOPP-RA.

Reachability analysis on a grid (Pham & Pham, "A New Approach to Time-Optimal Path Parameterization Based on
Reachability Analysis", T-RO 2018): backwards the squared path speeds from which the end can be reached, forwards the
greatest of them. toppra's own linear programs and checks; only its two inner steps are written again, as there half of
its time went into making and checking arrays of two numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import BSpline
from toppra.algorithm import TOPPRA

from hdplan.planner.timing.time_laws import Stepwise
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.once import read_only

GRID = 200  # intervals of the path
UPWARDS = read_only(np.array([1e-9, -1.0]))  # the objective of toppra that asks for the greatest squared path speed
DOWNWARDS = read_only(-UPWARDS)


def grid() -> Array:
    """Return the parameters (GRID + 1,) at which limits are asked for."""
    return np.linspace(0.0, 1.0, GRID + 1)


def time_optimal(spline: BSpline, constraints: list[Any]) -> Stepwise:
    """Return the fastest law, from rest to rest. Raises HdplanError if there is none."""
    points = grid()
    _, path_speeds, _ = _Toppra(constraints, _Path(spline), gridpoints=points).compute_parameterization(0.0, 0.0)
    if (
        path_speeds is None
        or not np.isfinite(path_speeds).all()
        or not (path_speeds[1:] + path_speeds[:-1] > 0.0).all()
    ):
        raise HdplanError("no time law was found within the limits of velocity and acceleration")
    widths = 2.0 * np.diff(points) / (path_speeds[1:] + path_speeds[:-1])
    return Stepwise(np.concatenate([[0.0], np.cumsum(widths)]), points, path_speeds)


class _Toppra(TOPPRA):  # type: ignore[misc]
    """toppra's algorithm, the same to the bit."""

    def _one_step(self, i: int, K_next: Array) -> tuple[float, float]:
        """Return the squared path speeds at grid point i from which one in K_next can be reached; NaN if there is
        none."""
        solve, (low, high) = self.solver_wrapper.solve_stagewise_optim, K_next
        most = solve(i, None, UPWARDS, np.nan, np.nan, low, high)[1]
        return solve(i, None, DOWNWARDS, np.nan, np.nan, low, high)[1], most

    def _forward_step(self, i: int, x: float, K_next: Array) -> Array:
        """Return the path's acceleration and squared path speed at i with the greatest path speed in K_next; NaN if
        there is none."""
        quickest = np.array([-2.0 * self.solver_wrapper.get_deltas()[i], -1.0])
        found: Array = self.solver_wrapper.solve_stagewise_optim(i, None, quickest, x, x, K_next[0], K_next[1])
        return found


class _Path:
    """A spline with TOPP-RA's interface for paths."""

    def __init__(self, spline: BSpline) -> None:
        self.spline = spline
        self.dof = spline.c.shape[1]
        self.path_interval = np.array([0.0, 1.0])

    def __call__(self, path_positions: Array, order: int = 0) -> Array:
        return np.asarray(self.spline(path_positions, order))
