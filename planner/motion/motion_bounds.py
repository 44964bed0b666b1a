"""Ways of a link's points while the joints run along a curve: bounds of first and second order, rigorous.

For an interval of the motion, q(s) = q_m + s δ + e(s) with s ∈ [−1, 1], |e_j| ≤ ε_j (0 on a straight line), and a point
v of a link, in the frame of a body that carries the moving joints J (revolute or prismatic), all evaluated at the
midpoint q_m:

    v(s) = v + s v' + r(s),    v' = Ω × v + U,    ‖r(s)‖ ≤ R

with Ω = Σ_rev δ_j z_j,  U = Σ_rev δ_j o_j × z_j + Σ_pris δ_j z_j,  z_j and o_j the axis of joint j and a point of it.

*First order.* ‖v(s) − v‖ ≤ Σ_j (|δ_j| + ε_j) ρ_j: joint j alone moves v by its travel times ρ_j at most, ρ_j the
greatest distance of the link from axis j (1 for a prismatic joint).

*Second order.* ∂²v/∂q_i∂q_j for i at or before j in the chain is z_i × ∂v/∂q_j if i is revolute, of length ≤ ρ_j, and 0
if i is prismatic. So ½ max‖v''‖ ≤ ½ Σ_j |δ_j| ρ_j (|δ_j|[j revolute] + 2 Σ_{i<j revolute} |δ_i|) along the straight
line; the deviation e moves v by at most another Σ_j ε_j ρ_j. R is the sum of both.

*ρ_j.* The smaller of two bounds. (a) For all configurations: in the frame of joint j, the link stays in a cylinder
around axis j. For the joint that carries the link it is computed from the points; one joint closer to the base, the
cylinder of radius ρ and axial range [l, u] around an axis of direction a through t is enclosed by one with radius
max_{e ∈ {l, u}} ‖(t + e a)⊥‖ + ρ (a norm of something linear in e is greatest at an end) and axial range (t + e a)·z ±
ρ √(1 − (a·z)²); a prismatic joint extends the range by its travel. (b) For the interval: the distance from axis j to
the far side of the link's bounding ball at q_m, plus what the joints after j, which alone move the link relative to
axis j, can add: Σ_{k>j} (|δ_k| + ε_k) ρ_k.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hdplan.distance.compiled.loops import Record, twin_of
from hdplan.planner.motion import reach_loop
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.errors import HdplanError
from hdplan.scenes.once import ReadOnly


def cross(a: Array, b: Array) -> Array:
    """Return a × b along the last axis; NumPy's own takes four times as long."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of bodies on intervals, one row each: Ω, U and the two bounds of the module's docstring."""

    omega: Array  # (i, 3)
    velocity: Array  # (i, 3) U
    first: Array  # (i,) Σ (|δ_j| + ε_j) ρ_j [m]
    second: Array  # (i,) R [m]

    @classmethod
    def of(cls, chain: Chain, delta: Array, deviation: Array, axes: Array, points: Array, reach: Array) -> Motion:
        """Compute it from δ and ε (i, n), 0 for joints that do not count, axes and points on them (i, n, 3) and ρ (i,
        n)."""
        turning = delta * chain.revolute
        speed, turn = np.abs(delta) * reach, np.abs(turning)
        leaving = (deviation * reach).sum(axis=1)
        before = np.cumsum(turn, axis=1) - turn
        return cls(
            np.einsum("in,inc->ic", turning, axes),
            np.einsum("in,inc->ic", turning, cross(points, axes)) + np.einsum("in,inc->ic", delta - turning, axes),
            speed.sum(axis=1) + leaving,
            0.5 * (speed * (turn + 2.0 * before)).sum(axis=1) + leaving,
        )

    @property
    def parts(self) -> tuple[Array, Array, Array, Array]:
        """The arrays."""
        return self.omega, self.velocity, self.first, self.second

    def __add__(self, other: Motion) -> Motion:
        """Return the sum of two motions of the same bodies, one of which is rest."""
        return Motion(*map(np.add, self.parts, other.parts))

    def __getitem__(self, rows: Mask | NDArray[np.int64] | tuple[NDArray[np.int64], NDArray[np.int64]]) -> Motion:
        """Return some of the rows."""
        return Motion(*(part[rows] for part in self.parts))


@dataclass(frozen=True, eq=False)
class Chain(ReadOnly):
    """The joints of a Pinocchio model, one coordinate each; joint j of the model moves coordinate j − 1."""

    model: Any
    axes: Array  # (n, 3) unit, in each joint's frame
    revolute: Mask  # (n,) the others are prismatic
    carried_by: Mask  # (joints, n) whether a body on joint i of the model (0: the world) is moved by coordinate j

    @classmethod
    def of(cls, model: Any) -> Chain:
        """Read the joints. Raises HdplanError for a joint that is neither revolute nor prismatic."""
        axes, revolute = [], []
        for joint, name in zip(
            itertools.islice(model.joints, 1, None), itertools.islice(model.names, 1, None), strict=True
        ):
            data = joint.createData()
            joint.calc(data, pin.neutral(model))
            motion = np.array(data.S).reshape(6, -1)  # linear part above, angular below
            if motion.shape[1] != 1 or (np.any(motion[:3]) and np.any(motion[3:])):
                raise HdplanError(f"joint '{name}': {joint.shortname()} is not supported by the certificate")
            revolute.append(bool(np.any(motion[3:])))
            axes.append(motion[3:, 0] if revolute[-1] else motion[:3, 0])
        carried_by = np.zeros((model.njoints, model.njoints - 1), dtype=bool)
        for joint in range(model.njoints):
            carried_by[joint, [support - 1 for support in model.supports[joint] if support > 0]] = True
        return cls(model, np.array(axes), np.array(revolute), carried_by)

    def reach(self, joint: int, points: Array, radius: float, travel: Array) -> Array:
        """Return ρ (n,), bound (a) of the module's docstring, for `points` (m, 3) in the frame of `joint`, swept by a
        ball of `radius`.

        `travel` (n, 2) is the range of each coordinate; only those of prismatic joints are used. ρ is 0 for joints that
        do not carry the body.
        """
        cylinder = np.array([self.around(joint, points, radius)])
        rho: Array = self.reach_around(np.array([joint]), cylinder, travel)[0]
        return rho

    def around(self, joint: int, points: Array, radius: float) -> tuple[float, float, float]:
        """Return a cylinder about the axis of `joint` around `points`: its radius, and from where to where it goes
        along the axis [m]."""
        axis = self.axes[joint - 1]
        along = points @ axis
        wide = float(np.linalg.norm(points - along[:, None] * axis, axis=1).max()) + radius
        return wide, float(along.min()) - radius, float(along.max()) + radius

    @twin_of(reach_loop.reach_around)
    def reach_around(self, joints: NDArray[np.int64], cylinders: Array, travel: Array) -> Array:
        """Return ρ (g, n) as `reach` does, for bodies on `joints` (g,) within cylinders (g, 3)."""
        rho = np.zeros((len(joints), len(self.axes)))
        for row, joint, cylinder in zip(rho, joints.tolist(), cylinders.tolist(), strict=True):
            for index, (wide, _, _) in self.inward(joint, cylinder, travel):
                row[index] = wide if self.revolute[index] else 1.0
        return rho

    def inward(
        self, joint: int, cylinder: tuple[float, float, float], travel: Array
    ) -> Iterator[tuple[int, tuple[float, float, float]]]:
        """Yield the coordinates that move a body within a cylinder about the axis of `joint`, each with a cylinder
        about its own axis in which the body stays, as `around` gives it; the last one's axis stands."""
        wide, low, high = cylinder
        while joint > 0:
            index = joint - 1
            if not self.revolute[index]:
                low, high = low + float(travel[index, 0]), high + float(travel[index, 1])
            yield index, (wide, low, high)
            offset, slope, *sides, tilt = self._inward[joint].tolist()
            joint = int(self.model.parents[joint])
            far = max(math.hypot(*(sides[i] + place * sides[3 + i] for i in range(3))) for place in (low, high))
            tilt, ends = tilt * wide, (offset + slope * low, offset + slope * high)
            wide, low, high = wide + far, min(ends) - tilt, max(ends) + tilt

    @cached_property
    def _inward(self) -> Array:
        """For each joint (joints, 9): a point `place` along its axis lies at offset + slope place along the parent's
        axis, beside (3) + out (3) place beside it; and the sine of the angle between the two axes."""
        steps = np.zeros((self.model.njoints, 9))
        for joint in range(1, self.model.njoints):
            parent, placement = int(self.model.parents[joint]), self.model.jointPlacements[joint]
            inner = placement.rotation @ self.axes[joint - 1]
            axis, origin = self.axes[parent - 1], placement.translation
            offset, slope = float(origin @ axis), float(inner @ axis)
            beside, out = origin - offset * axis, inner - slope * axis
            steps[joint] = [offset, slope, *beside, *out, math.sqrt(max(0.0, 1.0 - slope**2))]
        return steps

    @cached_property
    def record(self) -> Record:
        """For the loops in C: their struct `chain`."""
        parents = np.array(list(self.model.parents), np.int64)
        revolute, carried = self.revolute.astype(np.int64), self.carried_by.astype(np.int64)
        return Record("chain", revolute, parents, carried, self._inward)

    def frames(self, configurations: Array) -> tuple[Array, Array]:
        """Return rotations (k, joints, 3, 3) and origins (k, joints, 3) of all joints of the model, by Pinocchio.

        `configurations` (k, nq) are Pinocchio's.
        """
        data, shape = self.model.createData(), (len(configurations), self.model.njoints, 3)
        rotations, origins = np.empty((*shape, 3)), np.empty(shape)
        placements = [data.oMi[joint] for joint in range(self.model.njoints)]  # these and their parts are Pinocchio's
        turned, moved = [each.rotation for each in placements], [each.translation for each in placements]  # own memory
        for row, configuration in enumerate(configurations):
            pin.forwardKinematics(self.model, data, configuration)
            rotations[row], origins[row] = turned, moved
        return rotations, origins

    @twin_of(reach_loop.local_reach)
    def local_reach(
        self, rho: Array, joints: Rows, centers: Array, radii: Array, axes: Array, origins: Array, half: Array
    ) -> Array:
        """Return ρ (k, g, n) for k intervals and g bodies: the smaller of bound (a), given as `rho`, and bound (b).

        rho (g, n); joints (g,) that carry the bodies; centers (k, g, 3) and radii (g,) of their bounding balls; axes
        and origins (k, n, 3) of the joints, all at the midpoints; half (k, n) = |δ| + ε.
        """
        local = np.zeros((len(centers), *rho.shape))
        after = np.zeros(local.shape[:2])  # Σ_{k>j} (|δ_k| + ε_k) ρ_k
        for j in reversed(range(rho.shape[1])):
            carried = self.carried_by[joints, j]
            if self.revolute[j]:
                away = np.linalg.norm(cross(centers - origins[:, j, None], axes[:, None, j]), axis=2)
                local[:, :, j] = np.where(carried, np.minimum(rho[:, j], away + radii + after), 0.0)
            else:
                local[:, :, j] = np.where(carried, 1.0, 0.0)
            after += half[:, j, None] * local[:, :, j]
        return local
