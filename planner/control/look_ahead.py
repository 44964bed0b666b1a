"""The check of a command before it is given: that the robot can brake from it without coming too close.

The way of a command is one period with its velocity, and then braking until rest (`window.Window.way`). It is accepted
if on all of that way, at the ends of its periods, every Δ is at least its margin δ, or at least the least on the way on
which the robot brakes from its last command. Otherwise the program is solved again with the rows of the pairs that
fell, linearized where they are lowest,

    Δ(q_k(u₀)) + ∂Δ/∂q · ∂q_k/∂u (u − u₀) ≥ floor,

then with the joints held to braking that move those pairs; and at last the robot brakes. So a robot that could brake
clear of what stands still always can. What moves may reach a robot at rest, too: it counts at the end of the period,
and if only its pairs fall, the best of the commands is taken.

Below its margin Δ is of little use, as outer bodies may overlap where the links do not: there the exact distance of the
links' hulls is also kept from falling below NEAR, at some of these ends.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from hdplan.planner.control.program_rows import COMING, NEAR_DISTANCE
from hdplan.planner.control.quadratic_program import SoftConstraints, best_velocity
from hdplan.planner.control.sight import Seen, Sight, crossed
from hdplan.planner.control.window import Window
from hdplan.scenes.array_types import Array, Mask, Rows

CHECKS = 6  # of commands, including the first, and one whose joints are held
ROUNDING = 1e-12  # [m] by which a distance that must not fall may do so
SPARE = 1e-7  # [m] by which a corrected command should end above that: more than the program's tolerance


class Mode(Enum):
    """The outcome of a period."""

    MOVING = "moving"  # every barrier is met, the command is optimal
    CORRECTED = "corrected"  # the same, in place of a first command whose way to rest came too close
    GIVING_WAY = "giving way"  # not every barrier can be met: the best command; `Step.gave` lists those it violates
    STOPPED = "stopped"  # no command was found that stays far enough from static obstacles: the robot brakes


class LookAhead(NamedTuple):
    """The data against which a command of this period is checked."""

    sight: Sight
    window: Window
    time: float  # [s] of the period's beginning
    seen: Seen

    def checked(
        self, velocity: Array, hessian: Array, linear: Array, constraints: SoftConstraints
    ) -> tuple[Array, Mode, bool]:
        """Return the command after the check, its mode, and whether it passed."""
        base, box, asked = self.window.brake[0], self.window.box, constraints
        best: tuple[float, Array] | None = None
        for check in range(CHECKS + 1):
            over, gradient, coming = self._fallen(velocity)
            braking = check == CHECKS
            if not len(over):
                return velocity, Mode.STOPPED if braking else Mode.CORRECTED if check else Mode.MOVING, True
            yielding = coming.all()  # only what moves comes too close: braking is no better
            if yielding and (best is None or over.min() > best[0]):
                best = float(over.min()), velocity
            if braking or (yielding and check == CHECKS - 3):
                break
            if check == CHECKS - 1:
                velocity = base
                continue
            if check == CHECKS - 2:  # a crest, from where every way leads down: hold the joints that move these pairs
                moving = (gradient != 0.0).any(axis=0)
                box, constraints = (np.where(moving, base, box[0]), np.where(moving, base, box[1])), asked
            target = gradient @ velocity + (SPARE - over) / self.window.rates.period
            floor = np.where(coming, -np.inf, np.minimum(target, gradient @ base))
            constraints = constraints.with_rows(SoftConstraints(gradient, target, floor, np.full(len(target), COMING)))
            corrected = best_velocity(hessian, linear, *box, constraints)
            velocity = base if corrected is None else corrected
        return (base, Mode.STOPPED, False) if best is None else (best[1], Mode.CORRECTED, False)

    def _fallen(self, velocity: Array) -> tuple[Array, Array, Mask]:
        """Return of each pair that falls below its floor (m,): by how much it is above it where it is lowest on the way
        [m], its derivative by the command there, by T (m, n), and whether it is a pair with a moving obstacle."""
        barriers, seen, period = self.sight.barriers, self.seen, self.window.rates.period
        path = self.window.way(velocity)
        moment = barriers.at(path, self.time + period * np.arange(1, len(path) + 1, dtype=np.float64))
        sample, pair = self._soon(*moment.doubtful(self.sight.needed))
        found = self.sight.straight(moment.rows(sample, pair), pair, seen.inside)
        parts = [_Lows(found.value - seen.floors[pair], found.gradient, sample, pair, pair)]
        if len(seen.inside):
            sample, pair = self._soon(*crossed(self.sight.closely(path), seen.inside))
            exact = moment.nearness(sample, pair, NEAR_DISTANCE)
            floors = np.full(barriers.count, NEAR_DISTANCE)
            floors[seen.inside] = seen.near
            parts.append(_Lows(exact.value - floors[pair], exact.gradient, sample, pair, barriers.count + pair))
        parts = [part.chosen(np.flatnonzero(part.over < -ROUNDING)) for part in parts]
        lows = _Lows(*map(np.concatenate, zip(*parts, strict=True)))
        if len(lows.over):
            order = np.lexsort((lows.over, lows.key))
            lows = lows.chosen(order[np.flatnonzero(np.diff(lows.key[order], prepend=-1))])
        gains = self.window.gains[np.minimum(lows.sample, len(self.window.gains) - 1)]
        return lows.over, lows.gradient * gains, barriers.coming[lows.pair]

    def _soon(self, sample: Rows, pair: Rows) -> tuple[Rows, Rows]:
        """Return those of rows (S,) that count: what moves may reach a robot at rest, too, so of that only those at the
        next place."""
        coming = self.sight.barriers.coming
        if not coming.any():
            return sample, pair
        soon = (sample == 0) | ~coming[pair]
        return sample[soon], pair[soon]


class _Lows(NamedTuple):
    """Rows of distances on a way."""

    over: Array  # (m,) by how much each is above its floor [m]
    gradient: Array  # (m, n)
    sample: Rows  # (m,)
    pair: Rows  # (m,)
    key: Rows  # (m,) of the pair, and of which distance

    def chosen(self, rows: Rows) -> _Lows:
        """Return some of the rows."""
        return _Lows(*(each[rows] for each in self))
