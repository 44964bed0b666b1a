"""A penalty that keeps quantities below a bound along a motion: m measures in [m], each with a bound t.

The penalty is a squared hinge that sets in a band b below the bound, as an obstacle's does within its activation:

    Σ_samples w_s Σ ½ max(g − (t − b), 0)²,    b = min(t/2, BAND)

A measure is the length g = ‖v‖ of a vector v(q), most often of one number. Its residual is what is too much of the
vector, r = (1 − (t − b)/g) v, with dr = u (u · dv) + (1 − (t − b)/g) (dv − u (u · dv)), u = v/g: so a step sees every
direction in which the vector is too long, not that along it alone.

The depth is the share of the band that is used up times `planner.activation`, plus any excess over t. A motion thus
counts as clear while half of the band is left, as room for what happens between the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.terms import Penalty, Term
from hdplan.scenes.array_types import Array

BAND = 0.02  # [m] largest width of the band below the bound in which the penalty acts


@dataclass(frozen=True)
class Measures:
    """m measures at B configurations."""

    value: Array  # (B, m, k) v [m]
    slope: Array  # (B, m, k, n) dv/dq


class Measure(Protocol):
    """Quantities that must stay below a bound."""

    @property
    def bound(self) -> Array:
        """The bound of each of the m measures (m,) [m]."""
        ...

    def __call__(self, kinematics: KinematicsBatch) -> Measures:
        """Evaluate."""
        ...

    def bend(self, kinematics: KinematicsBatch) -> Array:
        """The second derivatives of the lengths g (B, m, n, n)."""
        ...


class Hinge(Term):
    """A squared hinge on measures of a configuration."""

    def __init__(self, name: str, measure: Measure, activation: float) -> None:
        """Take the measures, and the depth at which a used-up band counts [m]."""
        self.name, self.measure, self.activation = name, measure, activation

    def inside(self, kinematics: KinematicsBatch) -> tuple[Array, Array]:
        """The residuals (B, m k) [m], as long as each measure has entered its band, and their derivative (B, m k, n); 0
        where it has not."""
        found = self.measure(kinematics)
        bound = self.measure.bound
        length = np.linalg.norm(found.value, axis=2)
        inside = np.maximum(length - (bound - band_below(bound)), 0.0)
        entered = (inside > 0.0)[..., None]
        divisor = np.where(entered, length[..., None], 1.0)
        unit = np.where(entered, found.value / divisor, 0.0)
        along = unit[..., None] * (unit[..., None, :] @ found.slope)
        across = (inside[..., None] / divisor)[..., None] * (found.slope - along)
        count = len(inside), unit.shape[1] * unit.shape[2]
        return (inside[..., None] * unit).reshape(count), (along + across).reshape(*count, found.slope.shape[-1])

    def depth(self, kinematics: KinematicsBatch, parameter: Array | None = None) -> Array:
        """How much of the band is used up, as a depth (B,) [m], the same all along the motion."""
        inside, _ = self.inside(kinematics)
        return self._depth(inside)

    def at_samples(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty:
        """The penalty at the samples of a motion."""
        inside, slope = self.inside(kinematics)
        weight = samples.weight[:, None]
        gradient = ((weight * inside)[:, None] @ slope)[:, 0]
        curvature = weight[..., None] * (slope.transpose(0, 2, 1) @ slope)
        return Penalty(float(0.5 * np.sum(weight * inside**2)), gradient, curvature, self._depth(inside))

    def bend(self, kinematics: KinematicsBatch, samples: Samples) -> Array:
        """With e = max(g − (t − b), 0) and J = dv/dq, what e²/2 has beyond dr ᵀdr: e ∇²g − (e/g)² Jᵀ(I − u uᵀ) J."""
        found = self.measure(kinematics)
        length = np.linalg.norm(found.value, axis=2)
        inside = np.maximum(length - (self.measure.bound - band_below(self.measure.bound)), 0.0)
        entered = inside > 0.0
        scale = samples.weight[:, None] * inside
        if not entered.any():
            return np.zeros((len(inside), *found.slope.shape[-1:] * 2))
        divisor = np.where(entered, length, 1.0)
        along = ((found.value / divisor[..., None])[..., None, :] @ found.slope)[..., 0, :]
        across = found.slope.swapaxes(-1, -2) @ found.slope - along[..., :, None] * along[..., None, :]
        bent = self.measure.bend(kinematics) - (inside / divisor**2)[..., None, None] * across
        result: Array = np.einsum("bm,bmij->bij", scale, bent)
        return result

    def _depth(self, inside: Array) -> Array:
        band = band_below(self.measure.bound)
        inside = np.linalg.norm(inside.reshape(len(inside), len(band), inside.shape[1] // len(band)), axis=2)
        depth: Array = (self.activation * inside / band + np.maximum(inside - band, 0.0)).max(axis=1)
        return depth


def band_below(bound: Array) -> Array:
    """Return the widths of the bands below bounds (m,) in which the penalty acts."""
    return np.minimum(0.5 * bound, BAND)
