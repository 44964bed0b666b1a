"""Torque limits for a law of time: as TOPP-RA asks for them, and by how much a law must be stretched to keep them.

Along a path q(u) torques are τ = a ü + b u̇² + c (`dynamics`). A motion that takes k times as long needs (τ − c)/k² + c:
gravity's share c stays. So k² ≥ (τ − c)/(limit − c) where τ exceeds c, and the like below. Where gravity alone is
beyond a limit no k helps: such places are left to the certificate, which says so.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from toppra.constraint import LinearConstraint

from hdplan.planner.curve import Curve
from hdplan.planner.dynamics import InverseDynamics
from hdplan.planner.joint_limits import torque_limits
from hdplan.planner.loads import loaded_model
from hdplan.planner.robot import Robot
from hdplan.planner.torque_check import check_torques
from hdplan.scenes.model import Scene

Array = NDArray[np.float64]

MOST_STRETCH = 30.0  # of a law: where that is not enough, gravity leaves next to nothing
LOOKS = 3  # at each interval of a curve
MORE = 1e-3  # [–] longer where looks were not enough


class TorqueLimits:
    """The joints' torque limits, as a law of time has to keep them."""

    def __init__(self, scene: Scene, robot: Robot, limits: Array) -> None:
        """Take limits (n,) [Nm] or [N]; the scene's loads count."""
        self.model, self.robot, self.limits = loaded_model(scene, robot), robot, limits
        self.dynamics = InverseDynamics(self.model)

    @classmethod
    def of(cls, scene: Scene, robot: Robot) -> TorqueLimits | None:
        """Return a scene's, None if it has none. Raises InputError for limits or loads that do not fit the robot."""
        limits = torque_limits(scene, robot)
        return None if limits is None else cls(scene, robot, limits)

    def constraint(self, path: Any, grid: Array) -> LinearConstraint | None:
        """Return what TOPP-RA has to keep at a grid of path parameters; None if gravity alone is beyond a limit there,
        so that nothing can be kept."""
        found = self.dynamics.coefficients(path(grid), path(grid, 1), path(grid, 2))
        if (np.abs(found.c) >= self.limits).any():
            return None
        return _AlongPath(found.a, found.b, found.c, self.limits)

    def stretch(self, q: Array, v: Array, a: Array) -> float:
        """Return by how much a motion with these joint values, velocities and accelerations (k, n) must be stretched;
        below 1 if it may be faster."""
        gravity = self.dynamics.torques(q, np.zeros_like(q), np.zeros_like(q))
        moving = self.dynamics.torques(q, v, a) - gravity
        room = self.limits - np.sign(moving) * gravity
        needed = np.divide(np.abs(moving), room, out=np.zeros_like(room), where=room > 0.0)
        return min(float(np.sqrt(needed.max())), MOST_STRETCH)

    def missing(self, curve: Curve) -> float:
        """Return by how much a timed curve must be stretched for the limits to hold all along; 1 if they do, or if no
        stretching helps."""
        check = check_torques(self.model, self.robot, curve, self.limits)
        if check.within or check.overload is not None:
            return 1.0
        interval = np.repeat(np.arange(len(curve) - 1), LOOKS)
        fraction = np.tile(np.linspace(0.0, 1.0, LOOKS), len(curve) - 1)
        state = (curve.over_time(order).at(interval, fraction) for order in range(3))
        return max(self.stretch(*state), 1.0) + MORE


class _AlongPath(LinearConstraint):  # type: ignore[misc]
    """−limits ≤ a ü + b u̇² + c ≤ limits at the points of a grid, for the one path they were computed for."""

    def __init__(self, a: Array, b: Array, c: Array, limits: Array) -> None:
        super().__init__()
        self.a, self.b, self.c, self.limits = a, b, c, limits
        self.dof = len(limits)
        self.identical = True  # the same F and g at all points

    def compute_constraint_params(self, path: Any, gridpoints: Array, *_: Any) -> tuple[Any, ...]:
        """Return a, b, c, F, g: F (a u + b x + c) ≤ g."""
        both = np.vstack([np.eye(self.dof), -np.eye(self.dof)])
        return self.a, self.b, self.c, both, np.tile(self.limits, 2), None, None
