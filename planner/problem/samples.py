"""Configurations at which a motion is evaluated: between the waypoints, more of them where an interval needs it.

In: the number of samples of every interval. Out: configurations of a motion, and sums over samples carried back to
waypoints. A sample on interval k at fraction f is (1 − f) q_k + f q_{k+1}, which the trajectory, linear between
waypoints, passes through.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.distance.compiled.loops import twin_of
from hdplan.planner.problem import loops
from hdplan.scenes.array_types import Array, Rows

MOST_SAMPLES = 32  # samples on one interval, at most


@dataclass(frozen=True)
class Samples:
    """Midpoints of equal parts of every interval."""

    counts: tuple[int, ...]  # samples on each of the N − 1 intervals

    @cached_property
    def interval(self) -> Rows:
        """Interval of each sample (B,)."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def fraction(self) -> Array:
        """Place of each sample within its interval (B,), strictly between 0 and 1."""
        return np.concatenate([(np.arange(count) + 0.5) / count for count in self.counts])

    @cached_property
    def parameter(self) -> Array:
        """Path parameter of each sample (B,), from 0 at the first waypoint to 1 at the last."""
        return (self.interval + self.fraction) / len(self.counts)

    @cached_property
    def weight(self) -> Array:
        """Share of the motion's duration that each sample stands for (B,); sums to 1."""
        return np.repeat(1 / (np.array(self.counts) * len(self.counts)), self.counts)

    def configurations(self, positions: Array) -> Array:
        """The sampled configurations (B, n) of waypoints (N, n)."""
        fraction = self.fraction[:, None]
        return (1 - fraction) * positions[self.interval] + fraction * positions[self.interval + 1]

    @twin_of(loops.to_waypoints)
    def to_waypoints(self, gradient: Array, curvature: Array) -> tuple[Array, Array, Array]:
        """Carry derivatives with respect to the samples, first (B, n) and second (B, n, n), back to the waypoints:
        gradient (N, n), diagonal blocks (N, n, n), blocks between k and k+1 (N−1, n, n)."""
        n, fraction = gradient.shape[1], self.fraction[:, None]
        slope, diagonal = np.zeros((len(self.counts) + 1, n)), np.zeros((len(self.counts) + 1, n, n))
        slope[:-1] = self._sums((1 - fraction) * gradient)
        slope[1:] += self._sums(fraction * gradient)
        ahead = fraction[..., None] * curvature
        both = fraction[..., None] * ahead
        diagonal[1:] = self._sums(both)
        diagonal[:-1] += self._sums(curvature - 2 * ahead + both)
        return slope, diagonal, self._sums(ahead - both)

    def _sums(self, values: Array) -> Array:
        """Sum over the samples of each interval (N−1, …)."""
        result: Array = np.add.reduceat(values, np.cumsum((0, *self.counts[:-1])))
        return result

    def raised(self, counts: Rows) -> Samples:
        """At least `counts` (N − 1,) samples on the intervals, at most MOST_SAMPLES; never fewer than now."""
        return Samples(tuple(np.maximum(self.counts, np.minimum(counts, MOST_SAMPLES)).tolist()))
