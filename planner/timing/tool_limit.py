"""Limits of the speed and the acceleration of a link's origin p along a path q(u).

With p' and p'' its derivatives by u: its velocity is p' u̇, its acceleration p'' u̇² + p' ü, of which the part t along p'
and the part n across add up to at most a where they are within an octagon that a circle of radius a is drawn around.
Both are sampled here, not bounded; the certificate bounds them.
"""

from __future__ import annotations

import numpy as np

from hdplan.planner.kinematics.forward import kinematics_of
from hdplan.planner.motion.curve import Curve
from hdplan.planner.robot.link_frame import link_frame
from hdplan.planner.robot.setup import Setup
from hdplan.planner.timing.path_spline import PathSpline
from hdplan.planner.timing.time_optimal import PathRows, grid
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import read_only

SAMPLES = 4  # per interval between two rows
MARGINS = {1: 5e-3, 2: 2e-2}  # [–] of speed and acceleration that are left unused, as they are sampled, not bounded
STEP = 1e-4  # of a path's parameter, for differences
INSCRIBED = float(np.cos(np.pi / 8))  # how far the sides of the octagon are from its centre, in radii
# along and across, n ≥ 0
DIRECTIONS = read_only(np.array([[np.cos(k * np.pi / 4), np.sin(k * np.pi / 4)] for k in range(5)]))
STANDS = 1e-9  # [m] of a path's slope, below which it has no direction


class ToolLimit:
    """Speed of the link's origin along a curve that is followed."""

    def __init__(self, setup: Setup) -> None:
        """Look up the link. Raises InputError as `link_frame`."""
        follow = setup.scene.path.follow
        assert follow is not None
        frame = setup.robot.model.frames[link_frame(setup.robot, follow.link, "path.follow")]
        self.robot, self.arm = setup.robot, kinematics_of(setup.robot)
        self.joint, self.point = int(frame.parentJoint), frame.placement.translation
        given = {1: follow.speed, 2: follow.acceleration}
        self.most = {order: (1.0 - MARGINS[order]) * value for order, value in given.items() if value is not None}

    def rows(self, spline: PathSpline) -> PathRows:
        """Rows of the limit on a path at the points of `grid`."""
        slope, bend = self._slopes(spline, grid())
        size = np.linalg.norm(slope, axis=1)
        way = slope / np.maximum(size, STANDS)[:, None]
        along = (bend * way).sum(axis=1)
        across = np.linalg.norm(bend - along[:, None] * way, axis=1)
        found = [(0.0 * size, size**2, self.most[1] ** 2)] if 1 in self.most else []
        for one, other in DIRECTIONS if 2 in self.most else ():
            found.append((one * size, one * along + other * across, INSCRIBED * self.most[2]))
        a, b, c = zip(*found, strict=True)
        return PathRows(np.stack(a, axis=1), np.stack(b, axis=1), np.tile(c, (len(size), 1)))

    def stretch(self, curve: Curve) -> float:
        """Compute it from samples at the rows and between them."""
        count = SAMPLES * (len(curve) - 1) + 1
        parameters = np.linspace(0.0, 1.0, count)
        q, v, a = (curve.over_time(order).at_parameter(parameters) for order in range(3))
        slope, bend = self._by_joints(q, v, a)
        return float(self._stretch(slope, bend).max(initial=0.0))

    def _stretch(self, velocity: Array, acceleration: Array) -> Array:
        values = {1: velocity, 2: acceleration}
        found = [(np.linalg.norm(values[order], axis=1) / most) ** (1 / order) for order, most in self.most.items()]
        return np.asarray(np.max(found, axis=0))

    def _slopes(self, spline: PathSpline, u: Array) -> tuple[Array, Array]:
        """Return p' and p'' (k, 3) on a path."""
        return self._by_joints(*(spline(u, order) for order in range(3)))

    def _by_joints(self, q: Array, slope: Array, bend: Array) -> tuple[Array, Array]:
        """Return the first and second derivative of p (k, 3) from those of q (k, n)."""
        ahead, behind = (self._jacobian(q + sign * STEP * slope) for sign in (1.0, -1.0))
        jacobian = self._jacobian(q)
        turned = np.einsum("kcn,kn->kc", (ahead - behind) / (2.0 * STEP), slope)
        return np.einsum("kcn,kn->kc", jacobian, slope), np.einsum("kcn,kn->kc", jacobian, bend) + turned

    def _jacobian(self, q: Array) -> Array:
        """Return ∂p/∂q (k, 3, n)."""
        state = self.arm.evaluate(self.robot.expand(q))
        origin = state.rotations[:, self.joint] @ self.point + state.translations[:, self.joint]
        moved = (state.linear + np.cross(state.angular, origin[:, None])) * self.arm.supports[self.joint][:, None]
        return np.asarray(self.robot.fold(moved.transpose(0, 2, 1)))
