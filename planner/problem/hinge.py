"""What is to stay below a bound along a motion, as a penalty: m measures g(q) in [m], one bound t each.

The penalty is a squared hinge that sets in a band b below the bound, as an obstacle's does within its activation:

    Σ_samples w_s Σ ½ max(g − (t − b), 0)²,    b = min(t/2, BAND)

Depth is the share of the band that is used up, times `planner.activation`, plus what is beyond t: so a motion counts as
clear with half of the band left as room for what happens between the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.terms import Penalty, Term
from hdplan.scenes.array_types import Array

BAND = 0.02  # [m] widest band below the bound in which the penalty sets in


@dataclass(frozen=True)
class Measures:
    """m measures at B configurations."""

    value: Array  # (B, m) g, never negative [m]
    slope: Array  # (B, m, n) dg/dq


class Measure(Protocol):
    """What is to stay below a bound."""

    @property
    def bound(self) -> Array:
        """What each of the m measures is to stay below (m,) [m]."""
        ...

    def __call__(self, kinematics: KinematicsBatch) -> Measures:
        """Evaluate."""
        ...


class Hinge(Term):
    """A squared hinge on measures of a configuration."""

    def __init__(self, name: str, measure: Measure, activation: float) -> None:
        """Take what is measured, and how much of `depth` a used-up band counts [m]."""
        self.name, self.measure, self.activation = name, measure, activation

    def inside(self, kinematics: KinematicsBatch) -> tuple[Array, Array]:
        """How far each measure is within its band or beyond (B, m) [m], 0 where it is not, and the slope (B, m, n) of
        that."""
        found = self.measure(kinematics)
        bound = self.measure.bound
        inside = np.maximum(found.value - (bound - _band(bound)), 0.0)
        return inside, found.slope * (inside > 0.0)[..., None]

    def depth(self, kinematics: KinematicsBatch, parameter: Array | None = None) -> Array:
        """How much of the band is used up, as a depth (B,) [m], the same anywhere on the motion."""
        inside, _ = self.inside(kinematics)
        return self._depth(inside)

    def at_samples(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty:
        """The penalty at the samples of a motion."""
        inside, slope = self.inside(kinematics)
        weight = samples.weight[:, None]
        gradient = ((weight * inside)[:, None] @ slope)[:, 0]
        curvature = weight[..., None] * (slope.transpose(0, 2, 1) @ slope)
        return Penalty(float(0.5 * np.sum(weight * inside**2)), gradient, curvature, self._depth(inside))

    def _depth(self, inside: Array) -> Array:
        band = _band(self.measure.bound)
        depth: Array = (self.activation * inside / band + np.maximum(inside - band, 0.0)).max(axis=1)
        return depth


def _band(bound: Array) -> Array:
    return np.minimum(0.5 * bound, BAND)
