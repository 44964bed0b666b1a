"""Limits of the speed and the acceleration of a link's origin p along a path q(u).

With p' and p'' its derivatives by u: its velocity is p' u̇, its acceleration p'' u̇² + p' ü, of which the part t along p'
and the part n across add up to at most a where they are within an octagon that a circle of radius a is drawn around.
Both are sampled here, not bounded; the certificate bounds them. A path may have several such limits, one part after the
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.link_frame import link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.time_optimal import GREATEST_RATE, OnGrid, PathRows, grid
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import read_only

SAMPLES = 4  # per interval between two rows
MARGINS = {1: 5e-3, 2: 2e-2}  # [–] of speed and acceleration that are left unused, as they are sampled, not bounded
DIFFERENCE_STEP = 1e-4  # of a path's parameter, for differences
INSCRIBED = float(np.cos(np.pi / 8))  # how far the sides of the octagon are from its centre, in radii
# along and across, n ≥ 0
DIRECTIONS = read_only(np.array([[np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)] for k in range(5)]))
LEAST_SLOPE = 1e-9  # [m] of a path's slope, below which it has no direction


@dataclass(frozen=True, eq=False)
class ToolRates:
    """Limits of speed and acceleration of a link on a part of a path."""

    speed: float | None  # [m/s]
    acceleration: float | None  # [m/s²]
    planned: tuple[float, float] = (0.0, 1.0)  # the path's planned span of parameters
    begins: Array | None = None  # (n,) the configuration from which on it is kept; None: from the beginning

    def most(self, order: int) -> float:
        """The most that is planned for, of the speed (1) or the acceleration (2)."""
        value = self.speed if order == 1 else self.acceleration
        return GREATEST_RATE if value is None else (1.0 - MARGINS[order]) * value


class ToolLimit:
    """Speed of the link's origin along a curve that is followed."""

    def __init__(self, robot: Robot, link: str, parts: Sequence[ToolRates]) -> None:
        """Look up the link. Raises InputError as `link_frame`."""
        frame = robot.model.frames[link_frame(robot, link, "path.follow")]
        self.robot, self.arm, self.parts = robot, kinematics_of(robot), parts
        self.joint, self.point = int(frame.parentJoint), frame.placement.translation
        self.orders = [order for order in MARGINS if any(part.most(order) < GREATEST_RATE for part in parts)]

    @classmethod
    def of(cls, setup: Setup) -> ToolLimit:
        """Take that of the curve that a scene's motion follows. Raises InputError as `link_frame`."""
        follow = setup.scene.path.follow
        assert follow is not None
        return cls(setup.robot, follow.link, [ToolRates(follow.speed, follow.acceleration)])

    def rows(self, path: OnGrid) -> PathRows:
        """Rows of the limit on a path at the points of `grid`."""
        slope, curvature = self._by_joints(*path)
        size = np.linalg.norm(slope, axis=1)
        way = slope / np.maximum(size, LEAST_SLOPE)[:, None]
        along = (curvature * way).sum(axis=1)
        across = np.linalg.norm(curvature - along[:, None] * way, axis=1)
        found = [(0.0 * size, size**2, self._planned(1) ** 2)] if 1 in self.orders else []
        for one, other in DIRECTIONS if 2 in self.orders else ():
            found.append((one * size, one * along + other * across, INSCRIBED * self._planned(2)))
        a, b, c = (np.stack(each, axis=1) for each in zip(*found, strict=True))
        return PathRows(a, b, c)

    def _planned(self, order: int) -> Array:
        """The most that is planned for at the points of `grid`: the least of all parts there."""
        u, found = grid(), np.full(len(grid()), GREATEST_RATE)
        for part in self.parts:
            here = (part.planned[0] <= u) & (u <= part.planned[1])
            found[here] = np.minimum(found[here], part.most(order))
        return found

    def stretch(self, curve: Curve) -> float:
        """Compute it from samples at the rows and between them."""
        count = SAMPLES * (len(curve) - 1) + 1
        parameters = np.linspace(0.0, 1.0, count)
        q, v, a = (curve.over_time(order).at_parameter(parameters) for order in range(3))
        values, part = dict(zip(MARGINS, self._by_joints(q, v, a), strict=True)), self._kept(q)
        most = {order: np.array([each.most(order) for each in self.parts])[part] for order in self.orders}
        found = [(np.linalg.norm(values[order], axis=1) / each) ** (1 / order) for order, each in most.items()]
        return float(np.max(found, initial=0.0))

    def _kept(self, q: Array) -> NDArray[np.int64]:
        """Return the number of the part whose limits hold at each of some configurations (k, n) along the path."""
        found, last = np.zeros(len(q), np.int64), 0
        for number, part in enumerate(self.parts):
            if part.begins is not None:
                last += int(np.linalg.norm(q[last:] - part.begins, axis=1).argmin())
            found[last:] = number
        return found

    def _by_joints(self, q: Array, slope: Array, curvature: Array) -> tuple[Array, Array]:
        """Return the first and second derivative of p (k, 3) from those of q (k, n)."""
        ahead, behind = (self._jacobian(q + sign * DIFFERENCE_STEP * slope) for sign in (1.0, -1.0))
        jacobian = self._jacobian(q)
        turned = np.einsum("kcn,kn->kc", (ahead - behind) / (2.0 * DIFFERENCE_STEP), slope)
        return np.einsum("kcn,kn->kc", jacobian, slope), np.einsum("kcn,kn->kc", jacobian, curvature) + turned

    def _jacobian(self, q: Array) -> Array:
        """Return ∂p/∂q (k, 3, n)."""
        state = self.arm.evaluate(self.robot.expand(q))
        origin = state.rotations[:, self.joint] @ self.point + state.translations[:, self.joint]
        moved = (state.linear + np.cross(state.angular, origin[:, None])) * self.arm.supports[self.joint][:, None]
        return np.asarray(self.robot.fold(moved.transpose(0, 2, 1)))
