"""Path speeds of toppra's time law, under limits of velocity and acceleration and any further rows."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from toppra import constraint
from toppra.algorithm import TOPPRA
from toppra.constraint.linear_constraint import LinearConstraint, canlinear_colloc_to_interpolate
from toppra.interpolator import AbstractGeometricPath

from hdplan.planner.timing.path_spline import PathSpline
from hdplan.planner.timing.time_optimal import PathRows, grid
from hdplan.scenes.array_types import Array


class Path(AbstractGeometricPath):
    """A spline as toppra takes it."""

    def __init__(self, spline: PathSpline) -> None:
        self.spline = spline

    @property
    def dof(self) -> int:
        return len(self.spline(0.0))

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, 1.0])

    def __call__(self, path_positions: Array, order: int = 0) -> Array:
        return np.asarray(self.spline(path_positions, order))


class AsRows(LinearConstraint):
    """Any rows, as toppra takes them."""

    def __init__(self, rows: PathRows, dof: int) -> None:
        super().__init__()
        self.rows, self.dof = rows, dof

    def compute_constraint_params(self, path: Path, points: Array, *_: object) -> tuple[Array | None, ...]:
        a, b, c = self.rows
        each = np.tile(np.eye(a.shape[1]), (len(a), 1, 1))
        found: tuple[Array | None, ...] = canlinear_colloc_to_interpolate(a, b, 0.0 * c, each, c, None, None, points)
        return found


def toppras_path_speeds(spline: PathSpline, velocity: Array, acceleration: Array, rows: Iterable[PathRows]) -> Array:
    """Path speeds at the points of the grid, from rest to rest."""
    both = [np.stack([-each, each], axis=1) for each in (velocity, acceleration)]
    limits = [constraint.JointVelocityConstraint(both[0]), constraint.JointAccelerationConstraint(both[1])]
    limits += [AsRows(each, len(velocity)) for each in rows]
    _, found, _ = TOPPRA(limits, Path(spline), gridpoints=grid()).compute_parameterization(0.0, 0.0)
    return np.asarray(found)
