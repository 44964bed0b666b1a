"""Time laws: the path parameter u, from 0 to 1, as a function of time.

*Minimum jerk* from rest to rest (Flash & Hogan, "The coordination of arm movements", 1985), x = t/T:

    u = 10 x³ − 15 x⁴ + 6 x⁵

*Averaged* over a window τ, a law whose acceleration may jump gets a finite jerk, and the motion begins and ends without
acceleration. Here at rows h apart, τ = m h, with an acceleration that is linear between them, so that the jerk does not
change within a row and a quintic through the rows has no more:

    ü_k = (u̇(t_k) − u̇(t_k − τ))/τ

Summed up by the trapezoidal rule, these give the mean of u̇ over the window, by the same rule: wherever u̇ is even for so
long, to the bit, and no more than its greatest value; so no limit is exceeded that u̇ keeps. Only the way is longer or
shorter than 1 by what the rule errs where u̇ has kinks, of the order of 10⁻⁴, and is scaled by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hdplan.scenes.array_types import Array

FEWEST_ROWS = 3  # rows of a law without its window


class TimeLaw(Protocol):
    """A time law u(t) from 0 to 1."""

    def rows(self, count: int) -> Array:
        """Return u and its first two derivatives by the share of the duration (3, count) at even times, first and last
        included."""


@dataclass(frozen=True)
class MinimumJerk:
    """A motion from rest to rest in a given time, with the least integral of squared jerk."""

    duration: float  # [s]

    def __call__(self, times: Array) -> Array:
        """Return u and its first three derivatives (4, k) at times (k,)."""
        x = times / self.duration
        derivatives = [
            x**3 * (10 - 15 * x + 6 * x**2),
            30 * x**2 * (1 - x) ** 2,
            60 * x * (1 - 3 * x + 2 * x**2),
            60 * (1 - 6 * x + 6 * x**2),
        ]
        return np.stack([value / self.duration**order for order, value in enumerate(derivatives)])

    def rows(self, count: int) -> Array:
        """Return u and its first two derivatives by the share of the duration (3, count) at even times."""
        scale = self.duration ** np.arange(3.0)[:, None]
        return np.asarray(self(self.duration * np.linspace(0.0, 1.0, count))[:3] * scale)

    def time_at(self, parameter: Array) -> Array:
        """Return the times (k,) [s] at path parameters (k,)."""
        share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 2001))  # denser near both ends, where it is slow
        times = share * self.duration
        return np.asarray(np.interp(parameter, self(times)[0], times))


@dataclass(frozen=True, eq=False)
class Stepwise:
    """A law with constant acceleration between knots, at rest before 0 and after the last of them."""

    knots: Array  # (m,) [s], from 0
    path_speeds: Array  # (m,) du/dt there [1/s]

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.knots[-1])

    def path_speeds_at(self, times: Array) -> Array:
        """Return du/dt (k,) at times (k,): even steps of u take steps of time in which it changes evenly."""
        return np.asarray(np.interp(times, self.knots, self.path_speeds))


@dataclass(frozen=True, eq=False)
class Averaged:
    """A stepwise law, averaged over a window: a share of its own duration, the window included."""

    law: Stepwise
    share: float  # of the duration, above 0 and below 1

    def rows(self, count: int) -> Array:
        """Return u and its first two derivatives by the share of the duration (3, count) at even times; the window
        becomes a whole number of steps between them, at least one. Few rows do not see the law: they have minimum
        jerk."""
        window = max(round(self.share * (count - 1)), 1)
        if count - 1 - window < FEWEST_ROWS:
            return MinimumJerk(1.0).rows(count)
        step, width = 1.0 / (count - 1), self.law.duration / (count - 1 - window)
        rate = self.law.path_speeds_at(np.arange(-window, count, dtype=np.float64) * width) * (width / step)
        acceleration = (rate[window:] - rate[:-window]) / (window * step)
        slope = _summed(step / 2 * (acceleration[1:] + acceleration[:-1]))
        u = _summed(step * slope[:-1] + step**2 / 6 * (2 * acceleration[:-1] + acceleration[1:]))
        rows: Array = np.stack([u, slope, acceleration]) / u[-1]
        return rows


def _summed(parts: Array) -> Array:
    return np.append(0.0, np.cumsum(parts))
