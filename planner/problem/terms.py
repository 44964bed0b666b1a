"""The interface of a term of the cost: a penalty at the samples of a motion, or on the motion as a whole.

In: the kinematics of samples, or waypoints. Out: a cost, its exact gradient and a positive semidefinite curvature
(Gauss-Newton); on its own, what the exact Hessian has beyond that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hdplan.planner.kinematics.forward import Kinematics, KinematicsBatch
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

if TYPE_CHECKING:
    import casadi as ca

    from hdplan.distance.symbolic.closed import ClosedForm
    from hdplan.planner.problem.samples import Samples
    from hdplan.planner.problem.symbolic_place import SymbolicMotion, SymbolicPlace


@dataclass(frozen=True)
class Penalty:
    """A penalty at B samples."""

    cost: float
    gradient: Array  # (B, n) with respect to the samples' configurations
    curvature: Array  # (B, n, n) Gauss-Newton
    depth: Array  # (B,) how far the worst pair may be inside its margin [m], 0 if none is

    def __add__(self, other: Penalty) -> Penalty:
        """Both, at the same samples."""
        return Penalty(
            self.cost + other.cost,
            self.gradient + other.gradient,
            self.curvature + other.curvature,
            np.maximum(self.depth, other.depth),
        )


def nowhere(batch: int, n: int) -> Penalty:
    """No penalty at B samples of n coordinates."""
    return Penalty(0.0, np.zeros((batch, n)), np.zeros((batch, n, n)), np.zeros(batch))


@dataclass(frozen=True)
class MotionPenalty:
    """A penalty on a whole motion of N waypoints."""

    cost: float
    gradient: Array  # (N, n)
    diagonal: Array  # (N, n, n) Gauss-Newton curvature of each waypoint
    coupling: Array  # (N − 1, n, n) of q_{k+1} (rows) with q_k
    depth: Array  # (N − 1,) how far the worst pair may be inside its margin on the interval [m], 0 if none is


class Term:
    """A penalty on a motion. A term overrides `at_samples`, `over_motion` or both."""

    name: str  # as the user sees it

    def at_samples(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty | None:
        """The penalty at the samples of a motion, with their weights; None for a term that has nothing there."""
        return None

    def over_motion(self, positions: Array, kinematics: Kinematics) -> MotionPenalty | None:
        """The penalty on a motion through waypoints (N, n) of a robot; None for a term that has nothing there."""
        return None

    def second_order(self, kinematics: KinematicsBatch, samples: Samples) -> Array | None:
        """Second-order part of the Hessian (B, n, n) at the samples; None for 0. Raises InputError where it
        is not known, as by default."""
        raise InputError(f"hessian: no second derivatives are known of the term '{self.name}'; allowed: gauss_newton")

    def second_order_over_motion(self, positions: Array, kinematics: Kinematics) -> tuple[Array, Array] | None:
        """The second-order residual of the penalty on the motion as a whole, as the blocks (N, n, n) and (N − 1, n, n)
        of `MotionPenalty`."""
        return None

    def written_at_sample(self, place: SymbolicPlace) -> ClosedForm | None:
        """`at_samples` in symbols: the penalty of one configuration, without its weight, with its derivatives by the
        place's q, and by its frames if these move. A class that has the one and
        not the other is refused where all of a problem is required in symbols."""
        return None

    def written_over_motion(self, motion: SymbolicMotion) -> ca.MX | None:
        """`over_motion` in symbols, as `written_at_sample`."""
        return None

    def depth(self, kinematics: KinematicsBatch, parameter: Array | None = None) -> Array:
        """Depth that each of B configurations may have inside the margin (B,) [m], 0 if it is not: at no particular
        point of the motion, or at path parameters (B,)."""
        return np.zeros(len(kinematics.placements))

    @property
    def functions(self) -> Mapping[str, Any]:
        """The CasADi functions that it evaluates, by purpose."""
        return {}
