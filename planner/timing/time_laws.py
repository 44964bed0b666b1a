"""Time laws: the path parameter u, from 0 to 1, as a function of time.

*Minimum jerk* from rest to rest (Flash & Hogan, "The coordination of arm movements", 1985), x = t/T:

    u = 10 x³ − 15 x⁴ + 6 x⁵

*Averaged* over a window τ, a law whose acceleration may jump gets a finite jerk, and the motion begins and ends without
acceleration:

    ũ(t) = 1/τ ∫_{t−τ}^{t} u(s) ds,   dũ/dt = (u(t) − u(t − τ))/τ,   …
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from hdplan.scenes.array_types import Array


class TimeLaw(Protocol):
    """A time law u(t) from 0 to 1."""

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        ...

    def __call__(self, times: Array) -> Array:
        """Return u and its first three derivatives (4, k) at times (k,)."""
        ...


@dataclass(frozen=True)
class MinimumJerk:
    """From rest to rest in a given time, with the least integral of squared jerk."""

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

    def time_at(self, parameter: Array) -> Array:
        """Return the times (k,) [s] at path parameters (k,)."""
        share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 2001))  # denser near both ends, where it is slow
        times = share * self.duration
        return np.asarray(np.interp(parameter, self(times)[0], times))


@dataclass(frozen=True, eq=False)
class Stepwise:
    """A law with constant acceleration between knots, at rest before 0 and after the last of them."""

    knots: Array  # (m,) [s], from 0
    values: Array  # (m,) u there
    path_speeds: Array  # (m,) du/dt there [1/s]

    def __call__(self, times: Array) -> Array:
        """Return ∫u, u, du/dt and d²u/dt² (4, k) at times (k,)."""
        change, before = self._pieces
        row = np.clip(np.searchsorted(self.knots, times, side="right") - 1, 0, len(change) - 1)
        t = np.clip(times, 0.0, self.knots[-1]) - self.knots[row]
        u, path_speed, bend = self.values[row], self.path_speeds[row], change[row]
        late = np.maximum(times - self.knots[-1], 0.0)
        moving = (times > 0.0) & (late == 0.0)
        return np.stack(
            [
                before[row] + t * (u + t * (path_speed / 2 + t * bend / 6)) + late,
                u + t * (path_speed + t * bend / 2),
                np.where(moving, path_speed + t * bend, 0.0),
                np.where(moving, bend, 0.0),
            ]
        )

    @cached_property
    def _pieces(self) -> tuple[Array, Array]:
        """The acceleration between knots (m − 1,), and ∫u up to each of them (m,)."""
        widths = np.diff(self.knots)
        change = np.diff(self.path_speeds) / widths
        area = widths * (self.values[:-1] + widths * (self.path_speeds[:-1] / 2 + widths * change / 6))
        return change, np.concatenate([[0.0], np.cumsum(area)])


@dataclass(frozen=True, eq=False)
class Averaged:
    """A stepwise law, averaged over a window."""

    law: Stepwise
    window: float  # τ [s]

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.law.knots[-1]) + self.window

    def __call__(self, times: Array) -> Array:
        """Return ũ and its first three derivatives (4, k) at times (k,)."""
        now, then = np.split(self.law(np.concatenate([times, times - self.window])), 2, axis=1)
        difference: Array = (now - then) / self.window
        return difference
