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

from typing import Protocol

import numpy as np

from hdplan.planner.kinematics.forward import KinematicsBatch
from hdplan.planner.problem.samples import Samples
from hdplan.planner.problem.terms import Penalty, Term
from hdplan.scenes.array_types import Array, Rows

BAND = 0.02  # [m] largest width of the band below the bound in which the penalty acts


class Measure(Protocol):
    """Quantities that must stay below a bound."""

    @property
    def bound(self) -> Array:
        """The bound of each of the m measures (m,) [m]."""
        ...

    def value(self, kinematics: KinematicsBatch) -> Array:
        """The vectors v (B, m, k) [m]."""
        ...

    def slope(self, kinematics: KinematicsBatch) -> Array:
        """Their derivatives dv/dq (B, m, k, n)."""
        ...

    def second_order(self, kinematics: KinematicsBatch) -> Array:
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
        value = self.measure.value(kinematics)
        at, residual, slope = self._entered(kinematics, value, self._beyond(value))
        count = len(value), value.shape[1] * value.shape[2]
        return scattered(count, at, residual), scattered((*count, kinematics.columns.shape[1]), at, slope)

    def _beyond(self, value: Array) -> Array:
        """Excess of each measure over the begin of its band (B, m) [m]."""
        bound = self.measure.bound
        beyond: Array = np.maximum(np.linalg.norm(value, axis=2) - (bound - band_below(bound)), 0.0)
        return beyond

    def _entered(self, kinematics: KinematicsBatch, value: Array, beyond: Array) -> tuple[Rows, Array, Array]:
        """The configurations (r,) in which a measure has entered its band, the residuals there (r, m k) and their
        derivative (r, m k, n): most often they are few."""
        at = np.flatnonzero(beyond.any(axis=1))
        value, beyond = value[at], beyond[at]
        slope = self.measure.slope(KinematicsBatch(kinematics.placements[at], kinematics.columns[at]))
        entered = (beyond > 0.0)[..., None]
        divisor = np.where(entered, np.linalg.norm(value, axis=2, keepdims=True), 1.0)
        unit = np.where(entered, value / divisor, 0.0)
        along = unit[..., None] * (unit[..., None, :] @ slope)
        across = (beyond[..., None] / divisor)[..., None] * (slope - along)
        count = len(at), value.shape[1] * value.shape[2]
        return at, (beyond[..., None] * unit).reshape(count), (along + across).reshape(*count, slope.shape[-1])

    def depth(self, kinematics: KinematicsBatch, parameter: Array | None = None) -> Array:
        """Depth to which the band is used up (B,) [m], the same all along the motion."""
        return self._depth(self._beyond(self.measure.value(kinematics)))

    def at_samples(self, kinematics: KinematicsBatch, samples: Samples) -> Penalty | None:
        """The penalty at the samples of a motion; None where no measure enters its band."""
        value = self.measure.value(kinematics)
        beyond = self._beyond(value)
        if not beyond.any():
            return None
        at, residual, slope = self._entered(kinematics, value, beyond)
        (batch, n), weight = kinematics.columns.shape[:2], samples.weight[at][:, None]
        gradient = ((weight * residual)[:, None] @ slope)[:, 0]
        curvature = weight[..., None] * (slope.transpose(0, 2, 1) @ slope)
        return Penalty(
            float(0.5 * np.sum(weight * residual**2)),
            scattered((batch, n), at, gradient),
            scattered((batch, n, n), at, curvature),
            self._depth(beyond),
        )

    def second_order(self, kinematics: KinematicsBatch, samples: Samples) -> Array:
        """With e = max(g − (t − b), 0) and J = dv/dq, what e²/2 has beyond dr ᵀdr: e ∇²g − (e/g)² Jᵀ(I − u uᵀ) J."""
        value, slope = self.measure.value(kinematics), self.measure.slope(kinematics)
        beyond, length = self._beyond(value), np.linalg.norm(value, axis=2)
        entered = beyond > 0.0
        scale = samples.weight[:, None] * beyond
        if not entered.any():
            return np.zeros((len(beyond), *slope.shape[-1:] * 2))
        divisor = np.where(entered, length, 1.0)
        along = ((value / divisor[..., None])[..., None, :] @ slope)[..., 0, :]
        across = slope.swapaxes(-1, -2) @ slope - along[..., :, None] * along[..., None, :]
        bent = self.measure.second_order(kinematics) - (beyond / divisor**2)[..., None, None] * across
        result: Array = np.einsum("bm,bmij->bij", scale, bent)
        return result

    def _depth(self, beyond: Array) -> Array:
        band = band_below(self.measure.bound)
        depth: Array = (self.activation * beyond / band + np.maximum(beyond - band, 0.0)).max(axis=1)
        return depth


def scattered(shape: tuple[int, ...], at: Rows, values: Array) -> Array:
    """Values (r, ...) at rows (r,) of an array of zeros."""
    result = np.zeros(shape)
    result[at] = values
    return result


def band_below(bound: Array) -> Array:
    """Return the widths of the bands below bounds (m,) in which the penalty acts."""
    return np.minimum(0.5 * bound, BAND)
