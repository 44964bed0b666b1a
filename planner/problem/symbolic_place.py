"""The robot and the obstacles in symbols: at one configuration of a motion, and along all of it.

Terms write themselves as expressions of these. Placements are those of the joints, then those of the frames that carry
obstacles, which are parameters; a body of an obstacle is carried by one of them as a link's is by a joint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca

from hdplan.distance.symbolic.closed import ClosedForm
from hdplan.distance.symbolic.rigid_motions import bracket
from hdplan.planner.kinematics.forward import Kinematics


class JointPlaces(Protocol):
    """Placements of joints."""

    def rotation(self, joint: int) -> ca.MX:
        """World from joint (3, 3)."""
        ...

    def origin(self, joint: int) -> ca.MX:
        """Origin of a joint (3,) [m]."""
        ...


@dataclass(frozen=True, eq=False)
class SymbolicPlace:
    """One configuration of all joints of the model."""

    kinematics: Kinematics
    q: ca.MX  # (n,)
    frames: ca.MX  # (15, F) world from frame: the rotation row by row, then the origin [m]; change of sizes [m]
    exact: bool  # whether the penalties' second derivatives are, or are those of their residuals' squares alone
    movable: bool = True  # whether there are derivatives by the frames

    @cached_property
    def _state(self) -> list[ca.MX]:
        found = self.kinematics.state(self.q)
        placements, columns = ca.vertsplit(found, [0, 12 * self.kinematics.nj, found.numel()])
        return [ca.reshape(placements, 12, self.kinematics.nj), ca.reshape(columns, 6, self.kinematics.n)]

    @property
    def placements(self) -> ca.MX:
        """Placements of the joints and the frames (12, nj + F)."""
        return ca.horzcat(self._state[0], self.frames[:12, :])

    @property
    def columns(self) -> ca.MX:
        """Per unit of each joint's speed (6, n): velocity of the world's origin, angular velocity."""
        return self._state[1]

    def rotation(self, joint: int) -> ca.MX:
        """World from joint (3, 3)."""
        return ca.reshape(self._state[0][:9, joint], 3, 3).T

    def origin(self, joint: int) -> ca.MX:
        """Origin of a joint (3,) [m]."""
        return self._state[0][9:, joint]

    def half_square(self, residual: Callable[[JointPlaces], ca.MX], carriers: tuple[int, ...]) -> ClosedForm:
        """½ |r|² of residuals r, an expression of the places of `carriers`, joints. By these joints' motions it is
        differentiated, and by q with their screws: CasADi's own derivatives, through the whole tree, are many times as
        long."""
        joints, n = sorted(set(carriers)), self.kinematics.n
        kernel = _by_motions(residual, joints, self.exact)
        value, wrench, curved = kernel(ca.DM.zeros(6 * len(joints)), *(self.placements[:, joint] for joint in joints))
        moves = [ca.DM(self.kinematics.supports[joint].astype(float)[None]) for joint in joints]
        screws = [self.columns * ca.repmat(carried, 6, 1) for carried in moves]
        wrenches = ca.vertsplit(wrench, 6)
        blocks = [ca.horzsplit(row, 6) for row in ca.vertsplit(curved, 6)]
        slope, hessian = ca.MX.zeros(1, n), ca.MX.zeros(n, n)
        for one, by, row in zip(screws, wrenches, blocks, strict=True):
            slope += by.T @ one
            for block, other in zip(row, screws, strict=True):
                hessian += one.T @ block @ other
            if self.exact:
                upper = ca.triu(-one.T @ bracket(by) @ one, False)  # joints come in the order of the tree
                hessian += upper + upper.T
        return ClosedForm(value, [slope], [[hessian]])


@dataclass(frozen=True, eq=False)
class _Moved:
    """Joints that are moved from where they are by exp(ξ), to second order in their motions ξ."""

    placements: dict[int, ca.MX]  # (12,) of each joint
    motions: dict[int, ca.MX]  # (6,) [v, ω] in the world

    def rotation(self, joint: int) -> ca.MX:
        turn = ca.skew(self.motions[joint][3:])
        return (ca.MX.eye(3) + turn + turn @ turn / 2) @ ca.reshape(self.placements[joint][:9], 3, 3).T

    def origin(self, joint: int) -> ca.MX:
        motion, origin = self.motions[joint], self.placements[joint][9:]
        step = motion[:3] + ca.cross(motion[3:], origin)
        return origin + step + ca.cross(motion[3:], step) / 2


def _by_motions(residual: Callable[[JointPlaces], ca.MX], joints: list[int], exact: bool) -> ca.Function:
    """Function from motions (0) and placements of joints to ½ |r|², and its derivatives by the motions."""
    placements = {joint: ca.MX.sym(f"placement{joint}", 12) for joint in joints}
    motion = ca.MX.sym("motion", 6 * len(joints))
    found = residual(_Moved(placements, dict(zip(joints, ca.vertsplit(motion, 6), strict=True))))
    by_motion = ca.jacobian(found, motion)
    wrench = by_motion.T @ found
    curved = ca.jacobian(wrench, motion) if exact else by_motion.T @ by_motion
    results = [ca.densify(part) for part in (ca.sumsqr(found) / 2, wrench, curved)]
    return ca.Function("moved", [motion, *placements.values()], results).expand()


@dataclass(frozen=True, eq=False)
class SymbolicMotion:
    """All intervals of a motion (K of them), for penalties that are not of single configurations."""

    kinematics: Kinematics
    first: ca.MX  # (n, K) values of all joints at the beginning of each interval
    step: ca.MX  # (n, K) to its end
    frames: ca.MX  # (15, F) of obstacles that stand; those of others are unused
    exact: bool
    movable: bool

    def ends(self) -> tuple[SymbolicPlace, SymbolicPlace]:
        """Both ends of one interval, as symbols."""
        frames, n = ca.MX.sym("frames", *self.frames.shape), self.kinematics.n
        one, other = (
            SymbolicPlace(self.kinematics, ca.MX.sym(name, n), frames, self.exact, self.movable)
            for name in ("first", "second")
        )
        return one, other
