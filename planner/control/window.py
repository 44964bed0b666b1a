"""The velocities from which every joint can brake: the box of the controller's program, and where braking leads.

Limits of velocity, acceleration and jerk give a least and a greatest velocity of the next period (`braking`). From each
of the two, and from braking as the joint was last commanded, the way to rest is known. Joint limits are barriers of the
farthest place p on that way, in each direction: with u_b the velocity that begins to brake, and p the same for u_b,

    u ≤ u_b + (u_high − u_b) · min(1, η T (q_max − p) / (p_high − p)),

so that p comes closer to its limit by no more than a share η T of what is left, as p is convex in u. Braking is always
within the box: the program has a solution for ever, and no joint limit, speed or acceleration requires what another
forbids.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.planner.control.braking import Command, Rates
from hdplan.scenes.array_types import Array


@dataclass(frozen=True, eq=False)
class Window:
    """The box of one period, and the ways to rest of its ends."""

    q: Array  # (n,)
    last: Command
    rates: Rates
    lower: Array  # (n,) joint limits
    upper: Array
    rate: float  # η [1/s]

    @cached_property
    def brake(self) -> Array:
        """Velocities (K, n) that brake, starting with the last command: at least one."""
        return self.rates.braked(self.last.velocity, self.last.acceleration)

    @cached_property
    def stopping(self) -> Array:
        """Configurations (K + 1, n) of the robot if it brakes now, first that of now, until the first at rest."""
        offsets = self.rates.period * _moving(self.brake).cumsum(axis=0)
        return np.asarray(self.q + np.concatenate([np.zeros((1, len(self.q))), offsets]))

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """The least and the greatest velocity (2, n), and the ways (K, 2, n) of both to rest."""
        sides = np.stack(self.rates.window(self.last))
        after = self.rates.braked(sides, (sides - self.last.velocity) / self.rates.period)
        return sides, self.rates.period * np.concatenate([sides[None], after]).cumsum(axis=0)

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Least and greatest velocity (n,)."""
        (low, high), ways = self._ends
        first, share = self.brake[0], self.rate * self.rates.period
        least, most = self.stopping.min(axis=0), self.stopping.max(axis=0)
        up = _share(share * (self.upper - most), self.q + ways[:, 1].max(axis=0) - most)
        down = _share(share * (least - self.lower), least - self.q - ways[:, 0].min(axis=0))
        return np.minimum(first + down * (low - first), first), np.maximum(first + up * (high - first), first)

    @cached_property
    def gains(self) -> Array:
        """Ways of each joint by its velocity (K, n) after 1, …, K periods, the last until rest, in periods:
        a mean between the ends of the box, at least 1."""
        (low, high), ways = self._ends
        width = self.rates.period * (high - low)
        gains = np.divide(ways[:, 1] - ways[:, 0], width, out=np.ones_like(ways[:, 0]), where=width > 0.0)
        return np.asarray(np.maximum(gains, 1.0))

    def way(self, velocity: Array) -> Array:
        """Return the configurations (K, n) at the ends of the periods, if the robot moves with a velocity (n,) for one
        period and then brakes, until the first at rest."""
        after = self.rates.braked(velocity, (velocity - self.last.velocity) / self.rates.period)
        return np.asarray(self.q + self.rates.period * np.concatenate([velocity[None], _moving(after)]).cumsum(axis=0))


def _moving(velocities: Array) -> Array:
    """Return the velocities (k, n) until the last that is not zero."""
    return np.asarray(velocities[: 1 + int(np.flatnonzero(velocities.any(axis=1)).max(initial=-1))])


def _share(room: Array, wanted: Array) -> Array:
    """Return the share (n,) of `wanted` for which there is room, from 0 to 1."""
    return np.clip(np.divide(room, wanted, out=np.ones_like(room), where=wanted > np.maximum(room, 0.0)), 0.0, 1.0)
