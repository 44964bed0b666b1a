"""Torque limits along a path, in the form in which TOPP-RA takes limits of second order."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from toppra.constraint import LinearConstraint

from hdplan.planner.kinematics.inverse_dynamics import PathTorques

Array = NDArray[np.float64]


class TorqueConstraint(LinearConstraint):  # type: ignore[misc]
    """−limits ≤ a ü + b u̇² + c ≤ limits at the points of a grid on one path: toppra's own would ask for the torques one
    point at a time."""

    def __init__(self, torques: PathTorques, limits: Array) -> None:
        """Take the torques at the grid's points and limits (n,)."""
        super().__init__()
        self.torques, self.limits = torques, limits
        self.dof = len(limits)
        self.identical = True  # F and g are the same at all points

    def compute_constraint_params(self, path: Any, gridpoints: Array, *_: Any) -> tuple[Any, ...]:
        """Return a, b, c, F, g of F (a ü + b u̇² + c) ≤ g; the path and its grid are those of the torques."""
        both = np.vstack([np.eye(self.dof), -np.eye(self.dof)])
        return self.torques.a, self.torques.b, self.torques.c, both, np.tile(self.limits, 2), None, None
