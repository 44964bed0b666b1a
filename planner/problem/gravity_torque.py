"""Gravity torques, and a penalty that keeps a motion away from configurations in which they overload a joint.

As a motion slows down, its torques tend to those of gravity, g(q) = ∂U/∂q with U = −Σ_b m_b γ·c_b, γ the gravity and
c_b the bodies' centres of mass. Where they exceed a limit no timing helps, and the path has to change. With a_j and l_j
the angular velocity and the velocity of the world's origin per unit of joint j's speed,

    g_j = −γ·w_j,   w_j = Σ_{b after j} m_b (l_j + a_j × c_b),   ∂g_j/∂q_k = −(γ × a_k)·w_j  for k at or before j,

since joint k turns all that comes after it about a_k; the rest by symmetry (exact); so with the second derivatives,
∂²g_j/∂q_k∂q_l = −(γ × a_k)·(a_l × w_j) for k at or before l, and l at or before j. World frame, [m, rad, kg, Nm or N].
Joints that gravity can never load that much, by a bound over all configurations, are left out.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
import pinocchio as pin

from hdplan.distance.compiled.loops import C, Record, twin_of
from hdplan.distance.symbolic.closed import ClosedForm
from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.motion.motion_bounds import Chain, cross
from hdplan.planner.problem.hinge import BAND, Hinge, band_below
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.symbolic_place import SymbolicPlace
from hdplan.planner.problem.terms import Penalty
from hdplan.planner.robot.loads import with_loads
from hdplan.planner.robot.robot import Robot
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Mask, Rows
from hdplan.scenes.attached import Attached, Payload
from hdplan.scenes.errors import naming
from hdplan.scenes.once import ReadOnly, made_once, read_only

ARM = 0.1  # [m] stands for a torque at its limit: with the hinge's band, the penalty sets in at 80 % of it


@dataclass(frozen=True, eq=False)
class GravityTorques(ReadOnly):
    """Gravity torques of one model with its loads, and their derivatives, from the kinematics alone."""

    gravity: Array  # (3,) γ, in the world [m/s²]
    masses: Array  # (nj,) of the bodies
    centres: Array  # (nj, 3) in their joints' frames [m]
    supports: Mask  # (nj, n) whether a body moves with a coordinate

    @cached_property
    def before(self) -> Mask:
        """True if coordinate k is at or before j in the chain (n, n) [j, k]: joint j + 1 of the model has coordinate
        j."""
        return self.supports[1:]

    @classmethod
    def of(cls, model: pin.Model) -> GravityTorques:
        """Read a model whose joint i + 1 moves coordinate i."""
        return cls(
            gravity=np.asarray(model.gravity.linear, dtype=np.float64).copy(),
            masses=np.array([0.0, *(float(body.mass) for body in itertools.islice(model.inertias, 1, None))]),
            centres=np.array(
                [np.zeros(3), *(np.asarray(body.lever) for body in itertools.islice(model.inertias, 1, None))]
            ),
            supports=Chain.of(model).carried_by,
        )

    def torque(self, kinematics: KinematicsBatch) -> Array:
        """Return g (B, n) at B configurations: γ·w_j = (γ·l_j) Σ m_b + (γ × a_j)·Σ m_b c_b, in few products."""
        along = kinematics.columns @ self._pull
        moments = self._moments_of(kinematics)
        result: Array = -(self._carried * along[..., 0] + np.einsum("bjx,bjx->bj", along[..., 1:], moments))
        return result

    def slope(self, kinematics: KinematicsBatch) -> Array:
        """Return ∂g/∂q (B, n, n) at B configurations."""
        turned = cross(np.broadcast_to(self.gravity, kinematics.angular.shape), kinematics.angular)
        slope = -(self._moved(kinematics) @ turned.transpose(0, 2, 1))  # [j, k]
        return np.where(self.before, slope, np.where(self.before.T, slope.transpose(0, 2, 1), 0.0))

    def _moved(self, kinematics: KinematicsBatch) -> Array:
        """w (B, n, 3)."""
        moments = self._moments_of(kinematics)
        moved: Array = self._carried[:, None] * kinematics.linear + cross(kinematics.angular, moments)
        return moved

    def _moments_of(self, kinematics: KinematicsBatch) -> Array:
        """Σ_{b after j} m_b c_b (B, n, 3)."""
        count, joints = kinematics.placements.shape[:2]
        moments: Array = kinematics.placements.reshape(count, 12 * joints) @ self._moments
        return moments.reshape(kinematics.linear.shape)

    @cached_property
    def _carried(self) -> Array:
        """Σ_{b after j} m_b (n,)."""
        result: Array = self.masses @ self.supports
        return result

    @cached_property
    def _pull(self) -> Array:
        """Matrix (6, 4) that makes γ·l and γ × a of a column (l, a)."""
        result = np.zeros((6, 4))
        result[:3, 0], result[3:, 1:] = self.gravity, np.cross(self.gravity, np.eye(3))
        return result

    @cached_property
    def _moments(self) -> Array:
        """Matrix for Σ_{b after j} m_b c_b (3 n) of the entries of all placements (12 nj): one product for all."""
        entries = np.concatenate([self.centres, np.ones((len(self.masses), 1))], axis=1) * self.masses[:, None]
        weights = np.einsum("bc,bj->bcj", entries, self.supports)
        result = np.zeros((len(self.masses), 12, self.supports.shape[1], 3))
        for axis in range(3):
            result[..., axis][:, [3 * axis, 3 * axis + 1, 3 * axis + 2, 9 + axis]] = weights
        return result.reshape(12 * len(self.masses), -1)

    def second_order(self, kinematics: KinematicsBatch) -> Array:
        """Return ∂²g/∂q² (B, n, n, n) at B configurations."""
        turned = cross(np.broadcast_to(self.gravity, kinematics.angular.shape), kinematics.angular)
        lifted = cross(kinematics.angular[:, :, None], self._moved(kinematics)[:, None])  # (B, n, n, 3) [l, j]
        ordered = -np.einsum("bkx,bljx->bklj", turned, lifted)
        ordered = ordered * (self.before.T[:, :, None] & self.before.T)  # k at or before l, l at or before j
        first, second, third = np.sort(np.indices(ordered.shape[1:]), axis=0)
        result: Array = ordered[:, first, second, third]
        return result

    def written(self) -> ca.Function:
        """g (n,), ∂g/∂q (n, n) and the n columns of ∂²g/∂q² (n² each) in symbols, of a `SymbolicPlace`'s placements
        (12, nj) and columns (6, n)."""
        bodies, n = len(self.masses), self.supports.shape[1]
        placements, columns = ca.SX.sym("placements", 12, bodies), ca.SX.sym("columns", 6, n)
        centres = [
            ca.reshape(placements[:9, b], 3, 3).T @ ca.DM(self.centres[b]) + placements[9:, b] for b in range(bodies)
        ]
        after, gravity = ca.DM(self.supports * self.masses[:, None]), ca.SX(ca.DM(self.gravity))
        moments, masses = ca.horzcat(*centres) @ after, ca.sum1(after)
        axes = ca.horzsplit(columns[3:, :])
        moved = [masses[j] * columns[:3, j] + ca.cross(axes[j], moments[:, j]) for j in range(n)]
        turned = [ca.cross(gravity, axis) for axis in axes]
        slope, bent = ca.SX.zeros(n, n), [ca.SX.zeros(n, n) for _ in range(n)]
        for j, k in zip(*np.nonzero(self.before), strict=True):
            slope[j, k] = slope[k, j] = -ca.dot(moved[j], turned[k])
            for i in np.flatnonzero(self.before[k]).tolist():
                lifted = -ca.dot(turned[i], ca.cross(axes[k], moved[j]))
                for first, second, third in itertools.permutations((i, k, j)):
                    bent[first][second, third] = lifted
        flat = ca.horzcat(*(ca.vec(each) for each in bent))
        return ca.Function("gravity", [placements, columns], [-ca.horzcat(*moved).T @ gravity, slope, ca.densify(flat)])

    def most(self, model: pin.Model, travel: Array) -> Array:
        """Return bounds (n,) on |g_j| over all configurations; `travel` (n, 2) is the range of each coordinate.

        A body's centre stays within a cylinder about each joint before it (`motion_bounds`); only the part of gravity
        across an axis has a moment about it, and it is known for an axis that is fixed in the world.
        """
        chain = Chain.of(model)
        levers = np.array([chain.reach(b, self.centres[b : b + 1], 0.0, travel) for b in range(len(self.masses))])
        across = np.full(len(travel), np.linalg.norm(self.gravity))
        for joint, axis in enumerate(chain.axes):
            if model.parents[joint + 1] == 0:
                along = model.jointPlacements[joint + 1].rotation @ axis @ self.gravity
                across[joint] = (
                    np.sqrt(max(across[joint] ** 2 - along**2, 0.0)) if chain.revolute[joint] else abs(along)
                )
        result: Array = across * (self.masses @ levers)
        return result


@dataclass(frozen=True, eq=False)
class GravityMeasure:
    """Gravity torques as shares of their limits, times ARM."""

    torques: GravityTorques
    joints: Rows  # (m,) that gravity may overload
    limits: Array  # (m,) of these

    @property
    def bound(self) -> Array:
        """The limits, as lengths (m,) [m]."""
        return np.full(len(self.joints), ARM)

    def value(self, kinematics: KinematicsBatch) -> Array:
        """The shares."""
        torque = self.torques.torque(kinematics)[:, self.joints]
        return (ARM / self.limits * torque)[..., None]

    def slope(self, kinematics: KinematicsBatch) -> Array:
        """Derivatives of the torques."""
        slope = self.torques.slope(kinematics)[:, self.joints]
        return ((ARM / self.limits)[:, None] * slope)[..., None, :]

    def second_order(self, kinematics: KinematicsBatch) -> Array:
        """Derivatives of the torques."""
        torque = self.torques.torque(kinematics)
        scale = ARM / self.limits * np.sign(torque[:, self.joints])
        bent: Array = scale[..., None, None] * self.torques.second_order(kinematics)[:, self.joints]
        return bent


def _penalty(term: StaticTorque, kinematics: KinematicsBatch, weight: Array | None) -> Penalty:
    """The penalty at samples; without weights (B,) only the depth."""
    batch, n = kinematics.columns.shape[:2]
    count = 0 if weight is None else batch
    found = np.zeros((count, n)), np.zeros((count, n, n)), np.zeros(batch)
    given = kinematics.placements, kinematics.columns, weight
    return Penalty(C.gravity_hinge(term.record.struct, *given, *found), *found)


def _depth(term: StaticTorque, kinematics: KinematicsBatch, parameter: Array | None = None) -> Array:
    return _penalty(term, kinematics, None).depth


def _at_samples(term: StaticTorque, kinematics: KinematicsBatch, samples: Samples) -> Penalty | None:
    found = _penalty(term, kinematics, samples.weight)
    return found if found.depth.any() else None


class StaticTorque(Hinge):
    """Keeps a motion away from configurations in which gravity alone overloads a joint."""

    measure: GravityMeasure
    depth = twin_of(_depth)(Hinge.depth)
    at_samples = twin_of(_at_samples)(Hinge.at_samples)

    @cached_property
    def record(self) -> Record:
        """The C struct `gravity`."""
        measure, torques, band = self.measure, self.measure.torques, float(band_below(np.array(ARM)))
        supports, scale = torques.supports.astype(np.int64), ARM / measure.limits
        bodies = torques.gravity, torques.masses, torques.centres, supports
        return Record("gravity", *bodies, measure.joints, scale, ARM - band, band, self.activation)

    def written_at_sample(self, place: SymbolicPlace) -> ClosedForm:
        """Σ ½ max(|v| − (t − b), 0)², with the torques' closed derivatives."""
        n, measure = place.kinematics.n, self.measure
        torque, slopes, bent = measure.torques.written()(place.placements[:, : place.kinematics.nj], place.columns)
        rows, scale = measure.joints.tolist(), ca.DM(ARM / measure.limits)
        value, by_q = scale * torque[rows], ca.diag(scale) @ slopes[rows, :]
        beyond = ca.fmax(ca.fabs(value) - ca.DM(measure.bound - band_below(measure.bound)), 0)
        push = beyond * ca.sign(value)
        curvature = by_q.T @ ca.diag(beyond > 0) @ by_q
        if place.exact:
            curvature += ca.reshape(bent[:, rows] @ (push * scale), n, n)
        return ClosedForm(ca.sumsqr(beyond) / 2, [push.T @ by_q], [[curvature]])


@made_once(8)
def _loaded(robot: Robot, payload: Payload | None, attached: tuple[Attached, ...]) -> tuple[GravityTorques, Array]:
    """Gravity's torques of a robot with loads, and bounds on them: the same for all goals, and closer to obstacles."""
    model = with_loads(robot, payload, attached)
    torques = GravityTorques.of(model)
    return torques, read_only(torques.most(model, np.stack([robot.lower, robot.upper], axis=1)))


def static_torque(setup: Setup) -> StaticTorque | None:
    """Return the term where the scene limits torques and gravity may come near a limit; else None.

    Raises InputError for loads or limits that do not fit the robot.
    """
    robot, limits = setup.robot, setup.limits.get("torque")
    if limits is None:
        return None
    with naming(setup.scene.source):
        torques, bound = _loaded(robot, setup.scene.payload, setup.scene.attached)
    joints = np.flatnonzero(~(bound <= (1 - BAND / ARM) * limits))  # a bound that is NaN proves nothing
    if not len(joints):
        return None
    measure = GravityMeasure(torques, joints, limits[joints])
    return StaticTorque("static torque", measure, setup.scene.planner.activation)
