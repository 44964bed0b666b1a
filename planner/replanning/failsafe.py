"""Failsafe motions: a piece of the nominal motion until the next step, and then braking along the same way.

    s(t):  ṡ → 1 for `lead` rows,  then  ṡ → 0

Both are the quickest laws within limits of s̈ and s⃛ (`timing.braking`, for a single joint). Of those limits the
strongest pair is taken for which the joints' own limits hold along the whole curve; that curve is then certified.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hdplan.planner.motion.curve import Curve
from hdplan.planner.replanning.nominal import STILL_STEP, Nominal, Rows
from hdplan.planner.robot.joint_limits import DERIVATIVES
from hdplan.planner.timing.braking import brake
from hdplan.scenes.array_types import Array
from hdplan.scenes.once import read_only

BRAKING_RATES = (24.0, 16.0, 11.0, 8.0, 5.6, 4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 0.5)  # [1/s] of s̈
JERK_FACTORS = (4.0, 1.0)  # times s̈², of s⃛ [1/s²]
TARGET_SPEEDS = (1.0, 0.5, 0.2)  # target values of ṡ: slower motions are shorter until they stand
LONGEST_RAMP = 1.0  # [s] in which s̈ has to come to 0: a law that takes longer is no braking
BACKWARD_SPEED = 1e-9  # [–] ṡ below 0, from rounding
UNUSED_SHARE = 1e-7  # [–] of the joints' limits that is left unused


@dataclass(frozen=True, eq=False)
class Failsafe:
    """A motion that ends at standstill."""

    rows: Rows  # on the grid of the clock
    law: Array  # (k, 3) s, ṡ, s̈ at the same rows

    @property
    def moves(self) -> bool:
        """True if it leads anywhere."""
        return len(self.law) > 1


class FailsafeMotions:
    """The failsafe motions of one robot."""

    def __init__(self, limits: Mapping[str, Array], h: float, lead: int) -> None:
        """Take the greatest rates (n,) by name, the width of the grid [s], and after how many rows braking begins."""
        self.limits = {order: limits[name] for name, order in DERIVATIVES.items() if name in limits}
        self.h, self.lead = h, lead
        pairs = [(strong, soft * strong**2) for strong in BRAKING_RATES for soft in JERK_FACTORS]
        self.pairs = sorted(pairs, key=lambda pair: 1.0 / pair[0] + pair[0] / pair[1])
        self._last = dict.fromkeys(TARGET_SPEEDS, 0)  # the pair that held at the last step

    def of(self, nominal: Nominal, progress: Array, hopeful: bool = True) -> Iterator[Failsafe]:
        """Yield motions that continue from s, ṡ, s̈ (3,), the farthest first; unless `hopeful` the shortest alone."""
        free = nominal.rests(float(progress[0]))
        for speed in TARGET_SPEEDS if hopeful else TARGET_SPEEDS[-1:]:
            for at in range(max(self._last[speed] - 1, 0), len(self.pairs)):
                begin = np.array([progress[0], speed, 0.0]) if free else progress
                law = self._law(begin, speed, *self.pairs[at])
                if law is None:
                    continue
                motion = _trimmed(nominal.driven(law), law)
                if self._keeps(motion.rows):
                    self._last[speed] = at
                    yield motion
                    break
            else:
                self._last[speed] = 0

    def _law(self, progress: Array, speed: float, strong: float, soft: float) -> Array | None:
        """Return s, ṡ and s̈ (k, 3) of a law that speeds up, or slows down, and then brakes; None if there is none."""
        s, v, a = progress.tolist()
        found = _law(v, a, speed, strong, soft, self.h, self.lead)
        return None if found is None else found + [s, 0.0, 0.0]

    def _keeps(self, rows: Rows) -> bool:
        """True if a motion keeps the joints' limits of rates."""
        if len(rows[0]) < 2:
            return True
        curve = Curve.through(rows[0], self.h * np.arange(len(rows[0]), dtype=np.float64), rows[1], rows[2])
        within = 1.0 - UNUSED_SHARE
        return all((curve.over_time(order).largest() <= within * most).all() for order, most in self.limits.items())


@lru_cache(maxsize=1024)  # the same again and again while the robot moves on as planned
def _law(v: float, a: float, speed: float, strong: float, soft: float, h: float, lead: int) -> Array | None:
    """Return the law that begins at s = 0 with ṡ and s̈; see `FailsafeMotions`."""
    if abs(a) > LONGEST_RAMP * soft:
        return None
    most = {"acceleration": np.array([strong]), "jerk": np.array([soft])}
    toward = brake(np.array([v - speed]), np.array([a]), most, h)
    if isinstance(toward, int):
        return None
    rows = np.arange(lead + 1)
    there = np.minimum(rows, len(toward))
    gone = toward.away[there, 0] - toward.away[0, 0] + speed * h * rows
    first = np.stack([gone, speed + toward.velocity[there, 0], toward.acceleration[there, 0]], axis=1)
    braking = brake(first[-1:, 1], first[-1:, 2], most, h)
    if isinstance(braking, int):
        return None
    then = [braking.away - braking.away[0] + first[-1, 0], braking.velocity, braking.acceleration]
    law = np.concatenate([first, np.concatenate(then, axis=1)[1:]])
    return read_only(law) if law[:, 1].min() >= -BACKWARD_SPEED else None


def _trimmed(rows: Rows, law: Array) -> Failsafe:
    """Return a motion without rows at its end in which it stands."""
    away = np.max([np.abs(rows[0] - rows[0][-1]), np.abs(rows[1]), np.abs(rows[2])], axis=(0, 2)) > STILL_STEP
    count = int(np.flatnonzero(away)[-1]) + 2 if away.any() else 1
    return Failsafe((rows[0][:count], rows[1][:count], rows[2][:count]), law[:count])
