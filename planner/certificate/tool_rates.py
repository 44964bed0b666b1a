"""Velocity and acceleration of a link's origin: bounds on the whole of a timed motion.

With J_j = ∂p/∂q_j and, for i before j in the chain, ∂²p/∂q_i∂q_j = z_i × J_j (0 if i is prismatic), of length ≤ ρ_j
(`motion_bounds`), derivatives of any order are no longer than ρ of the last joint in them. So at all instants of a part

    v = Σ_j J_j q̇_j,                             ‖v̇‖ ≤ Σ_j ρ_j (|q̈_j| + W_j² − W_{j−1}²)
    a = Σ_j J_j q̈_j + Σ_ij ∂²p/∂q_i∂q_j q̇_i q̇_j,  ‖ȧ‖ ≤ Σ_j ρ_j (|q⃛_j| + 3 (A_j W_j − A_{j−1} W_{j−1})
                                                               + W_j³ − W_{j−1}³)

with W_j = Σ_{i ≤ j} |q̇_i| and A_j = Σ_{i ≤ j} |q̈_i|, bounds over the part. What half a part's duration makes of these
is added to the value in the middle. Velocities that step by no more than rounding from row to row count as slopes, as
in `rate_check`; greater steps the limit of the joints' accelerations refuses, which goes with any limit here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.planner.certificate.limit_checks import ROUNDING_JUMP
from hdplan.planner.certificate.path_parts import Part, Valued, WithTolerance
from hdplan.planner.certificate.rate_check import slope_of_steps
from hdplan.planner.certificate.verdict import at_most
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain, cross
from hdplan.planner.robot.link_frame import link_frame
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.path_constraints import Follow

FIELDS = {1: "speed", 2: "acceleration"}  # of the scene, by the order of the derivative
UNITS = {1: "m/s", 2: "m/s²"}
WORDS = {1: "moves at", 2: "accelerates by"}


@dataclass(frozen=True, eq=False)
class ToolRate(WithTolerance):
    """The speed of a link's origin on a motion, or its acceleration, and the most that is allowed."""

    link: str
    joint: int
    point: Array  # (3,) the origin in the joint's frame
    motion: Curve
    chain: Chain
    order: int  # 1: speed; 2: acceleration
    allowed: float
    field: str
    spans: tuple[Rows, Array, Array]  # the first division of the motion

    @classmethod
    def of(
        cls, robot: Robot, chain: Chain, follow: Follow, motion: Curve, order: int, spans: tuple[Rows, Array, Array]
    ) -> ToolRate:
        """Look up the link; it is limited on these parts of the motion. Raises InputError as `link_frame`."""
        frame = robot.model.frames[link_frame(robot, follow.link, "path.follow")]
        name = FIELDS[order]
        joint, point, allowed = int(frame.parentJoint), frame.placement.translation, getattr(follow, name)
        return cls(follow.link, joint, point, motion, chain, order, allowed, f"path.follow.{name}", spans)

    @cached_property
    def rates(self) -> tuple[Curve, ...]:
        """The motion's derivatives, up to one above its own."""
        return tuple(self.motion.over_time(order) for order in range(1, self.order + 2))

    @cached_property
    def stairs(self) -> Array:
        """Slopes (n,) to be added to the joints' rates of its order, for steps of the one below."""
        if self.order == 1:
            return np.zeros(self.motion.control.shape[2])
        steps = self.rates[self.order - 2].steps()
        times = np.concatenate([[0.0], np.cumsum(self.motion.widths)])
        return slope_of_steps(np.where(np.abs(steps) > ROUNDING_JUMP, 0.0, steps), times)

    def on(self, interval: Rows, start: Array, width: Array) -> Valued:
        """Return the limit on parts of the motion."""
        return _OnParts(self, interval, start, width)

    def broken(self, found: float) -> str:
        """Words such as "tool0 moves at 0.12 m/s, 0.1 are allowed"."""
        return f"{self.link} {WORDS[self.order]} {found:.3g} {UNITS[self.order]}, {self.allowed:g} are allowed"

    def kept(self, worst: float) -> str:
        """Words such as "tool0 moves at most at 0.099 of 0.1 m/s"."""
        return f"{self.link} {WORDS[self.order]} at most {at_most(worst)} of {self.allowed:g} {UNITS[self.order]}"


@dataclass(frozen=True, eq=False)
class _OnParts:
    whole: ToolRate
    interval: Rows
    start: Array
    width: Array

    def found(self, rotations: Array, origins: Array) -> Array:
        """The rate in the middle (k,)."""
        whole, chain = self.whole, self.whole.chain
        moves, middle = chain.carried_by[whole.joint], self.start + 0.5 * self.width
        place = rotations[:, whole.joint] @ whole.point + origins[:, whole.joint]
        axes = np.einsum("knij,nj->kni", rotations[:, 1:], chain.axes)
        arm = cross(axes, place[:, None] - origins[:, 1:])
        slopes = np.where(chain.revolute[:, None], arm, axes) * moves[:, None]  # (k, n, 3) J
        first = whole.rates[0].at(self.interval, middle)
        if whole.order == 1:
            return np.asarray(np.linalg.norm(np.einsum("kn,knc->kc", first, slopes), axis=1))
        second = whole.rates[1].at(self.interval, middle)
        spin = (first * (moves & chain.revolute))[:, :, None] * axes
        before = np.cumsum(spin, axis=1) - spin
        bent = np.einsum("kn,knc->kc", first, cross(2.0 * before + spin, slopes))
        return np.asarray(np.linalg.norm(np.einsum("kn,knc->kc", second, slopes) + bent, axis=1))

    def bound(self, part: Part, found: Array) -> Array:
        """Upper bounds of the rate (k,) on the parts."""
        whole = self.whole
        moves = part.chain.carried_by[whole.joint]
        _, reach = part.reach(whole.joint, whole.point)
        most = [each.largest_on(self.interval, self.start, self.start + self.width) * moves for each in whole.rates]
        turn = np.cumsum(most[0], axis=1)
        if whole.order == 1:
            change = (reach * (most[1] + _steps(turn**2))).sum(axis=1)
        else:
            gain = np.cumsum(most[1], axis=1)
            change = (reach * (most[2] + 3.0 * _steps(gain * turn) + _steps(turn**3))).sum(axis=1)
        _, half = whole.motion.span(self.interval, self.start, self.width)
        return np.asarray(found + half * change + (reach * whole.stairs * moves).sum(axis=1))


def _steps(sums: Array) -> Array:
    """Return by how much running sums (k, n) grow at each joint."""
    return np.diff(sums, axis=1, prepend=0.0)
