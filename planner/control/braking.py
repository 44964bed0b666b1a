"""Limits of velocity, acceleration and jerk of every joint, in periods of T, and how it brakes within them.

In period k a joint moves with the velocity u_k. Its acceleration is a_k = (u_k − u_{k−1})/T, |a_k| ≤ A, its jerk
(a_k − a_{k−1})/T, |a_k − a_{k−1}| ≤ s = T J. The motion that joints then execute (`rollout.Run.executed`) has exactly
these as its greatest accelerations and jerks.

Bringing an acceleration back to zero at the greatest jerk still changes the velocity, with m = ⌊|a|/s⌋, by

    e(a) = T (m |a| − s m (m + 1)/2),                         e(a) + T |a| = T s y  ⇔  |a| = s x,
    m = ⌊(√(1 + 8 y) − 1)/2⌋,  x = (y + m (m + 1)/2)/(m + 1)                                            (`_root`)

so that a state stays below a velocity V for ever if u + e(a) ≤ V, a > 0. To brake is, in each period, to take the least
acceleration from which the velocity still does not pass through zero, e(a) ≤ u. That is one rule for each period
(Bellman's): a joint that brakes for one period brakes on as it would have, so that where it comes to rest stays the
same, to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hdplan.distance.compiled.loops import C, twin_of
from hdplan.scenes.array_types import Array
from hdplan.scenes.errors import InputError

REST = 1e-12  # [rad/s or m/s] that a joint at rest may still move, by rounding
USED_SHARE = 1.0 - 1e-6  # share of each limit that is used, so that rounding exceeds none
ROUNDED = {2: 32.0, 3: 128.0}  # times ulp/Tᵏ of the positions: what their rounding adds to accelerations and jerks
FIRST_PERIODS = 64  # for which there is room at first
MOST_PERIODS = 10_000  # in which joints come to rest: a way of more samples takes seconds to check
JERK_TIME = 0.1  # share of the time in which the greatest velocity is reached, for the greatest acceleration


@dataclass(frozen=True, eq=False)
class Command:
    """The joints' last command: (n,) velocity [rad/s or m/s] and acceleration [rad/s² or m/s²]."""

    velocity: Array
    acceleration: Array

    @classmethod
    def rest(cls, n: int) -> Command:
        """Return the state of n joints at rest."""
        return cls(np.zeros(n), np.zeros(n))


def _window(rates: Rates, last: Command) -> tuple[Array, Array]:
    sides = np.empty((2, len(rates.velocity)))
    given = rates.acceleration, rates.jerk, last.velocity, last.acceleration, rates.velocity
    C.braking_window(rates.period, *given, sides)
    return sides[0], sides[1]


def _braked(rates: Rates, velocity: Array, acceleration: Array) -> Array:
    states = velocity.reshape(-1, velocity.shape[-1]), acceleration.reshape(-1, velocity.shape[-1])
    room = FIRST_PERIODS
    while True:
        found = np.empty((room, *states[0].shape))
        count = C.braked(rates.period, rates.acceleration, rates.jerk, *states, found)
        if count <= room:
            return found[:count].reshape(count, *velocity.shape)
        room = _allowed(count)


@dataclass(frozen=True, eq=False)
class Rates:
    """The greatest velocity, acceleration and jerk of each joint (n,), in periods of T."""

    velocity: Array  # [rad/s or m/s]
    acceleration: Array  # [rad/s² or m/s²]
    jerk: Array  # [rad/s³ or m/s³]
    period: float  # T [s]

    @classmethod
    def of(cls, limits: Mapping[str, Array], period: float, rise: float, farthest: Array) -> Rates:
        """Return the rates that `limits` name, less what the rounding of positions up to `farthest` (n,) adds to them
        (half of them at most), so that the motion in a file keeps them.

        Without a limit of acceleration the greatest velocity is reached in `rise` [s] at the soonest, without one of
        jerk the greatest acceleration in JERK_TIME of the time that the velocity takes; in one period if `rise` is 0.
        """
        velocity = limits["velocity"]
        # what takes the joint from one end to the other in one period is no limit
        acceleration = np.minimum(
            limits.get("acceleration", velocity / max(rise, period / 2.0)), 2.0 * velocity / period
        )
        jerk = np.minimum(limits.get("jerk", acceleration**2 / (JERK_TIME * velocity)), 2.0 * acceleration / period)
        ulp = np.spacing(farthest)

        def used(limit: Array, order: int) -> Array:
            most, lost = USED_SHARE * limit, ROUNDED[order] * ulp / period**order
            return np.maximum(most - lost, 0.5 * most)

        return cls(USED_SHARE * velocity, used(acceleration, 2), used(jerk, 3), period)

    @property
    def step(self) -> Array:
        """The greatest change of acceleration in a period (n,)."""
        return self.period * self.jerk

    @twin_of(_window)
    def window(self, last: Command) -> tuple[Array, Array]:
        """Return the least and greatest velocity (n,) of the next period from which velocity, acceleration and jerk can
        be kept for ever. From a state beyond them: acceleration before jerk, both before velocity."""
        most, step, period = self.acceleration, self.step, self.period
        low, high = (np.clip(last.acceleration + side * step, -most, most) for side in (-1.0, 1.0))
        up, down = (_root((self.velocity - side * last.velocity) / (period * step)) * step for side in (1.0, -1.0))
        low, high = np.clip(-down, low, high), np.clip(up, low, high)
        return last.velocity + period * np.minimum(low, high), last.velocity + period * np.maximum(low, high)

    def toward(self, aim: Array, velocity: Array) -> Array:
        """Return velocities (n,) of the next period that near `aim` (n,) from a velocity (n,) without passing it: from
        them the acceleration can come to zero before. They need not be within reach."""
        left, step = aim - velocity, self.step
        return np.asarray(velocity + np.copysign(self.period * step * _root(np.abs(left) / (self.period * step)), left))

    def scaled(self, share: float) -> Rates:
        """Return a share of the accelerations and jerks, with the same velocities."""
        return replace(self, acceleration=share * self.acceleration, jerk=share * self.jerk)

    @twin_of(_braked)
    def braked(self, velocity: Array, acceleration: Array) -> Array:
        """Return the velocities (K, ..., n) of the K periods in which joints of these velocities and accelerations
        (..., n) come to rest. Raises InputError for more than MOST_PERIODS."""
        most, step, period = self.acceleration, self.step, self.period
        rest = velocity + np.sign(acceleration) * self._coming(acceleration)  # once the acceleration is zero
        side = np.where(rest < 0.0, -1.0, 1.0)
        speed, push = side * velocity, side * acceleration
        k = np.arange(1, self._count(np.abs(rest), acceleration) + 1).reshape(-1, *[1] * velocity.ndim)
        pushed = np.maximum(push - k * step, -most)
        speeds = speed + period * pushed.cumsum(axis=0)
        late = (pushed < 0.0) & (speeds < self._coming(pushed))  # too late to come to rest at zero: back off here
        first = late.argmax(axis=0)[None]
        before = np.where(first > 0, np.take_along_axis(speeds, np.maximum(first - 1, 0), 0), speed)
        back = np.minimum(step * (k - 1 - first - _root(before / (period * step))), 0.0)
        speeds = speed + period * np.where(k - 1 < first, pushed, back).cumsum(axis=0)
        return np.where((k - 1 >= first) & (np.abs(speeds) < REST), 0.0, side * speeds)

    def _coming(self, acceleration: Array) -> Array:
        """Return e(a) of accelerations (..., n)."""
        size = np.abs(acceleration)
        whole = np.floor(size / self.step)
        return np.asarray(self.period * whole * (size - 0.5 * self.step * (whole + 1.0)))

    def _count(self, rest: Array, acceleration: Array) -> int:
        """Return in how many periods joints come to rest, at most: to zero acceleration, then from `rest`."""
        most, jerk = self.acceleration, self.jerk
        seconds = np.where(rest * jerk < most**2, 2.0 * np.sqrt(rest / jerk), rest / most + most / jerk)
        return _allowed(np.ceil((np.abs(acceleration) / jerk + seconds).max() / self.period) + 3)


def _allowed(periods: float) -> int:
    """Return a number of periods as it is. Raises InputError for more than MOST_PERIODS."""
    if not periods <= MOST_PERIODS:
        raise InputError(
            f"last: from its velocity and acceleration joints come to rest in {periods:.3g} periods, at most "
            f"{MOST_PERIODS} are allowed"
        )
    return int(periods)


def _root(shares: Array) -> Array:
    """Return x of the module's second equation for y (n,); y itself below 1."""
    whole = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * np.maximum(shares, 0.0)) - 1.0))
    return np.asarray((shares + 0.5 * whole * (whole + 1.0)) / (whole + 1.0))
