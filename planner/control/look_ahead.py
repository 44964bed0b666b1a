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

from hdplan.planner.control.program_rows import COMING
from hdplan.planner.control.quadratic_program import SoftConstraints, best_velocity
from hdplan.planner.control.sight import Seen, Sight
from hdplan.planner.control.window import Window
from hdplan.scenes.array_types import Array, Mask

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
    """What a command of this period is checked against."""

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
            over, gradient, coming = self._lowest(velocity)
            fallen = over < -ROUNDING
            braking = check == CHECKS
            if not fallen.any():
                return velocity, Mode.STOPPED if braking else Mode.CORRECTED if check else Mode.MOVING, True
            yielding = not (fallen & ~coming).any()  # only what moves comes too close: braking is no better
            if yielding and (best is None or over.min() > best[0]):
                best = float(over.min()), velocity
            if braking or (yielding and check == CHECKS - 3):
                break
            if check == CHECKS - 1:
                velocity = base
                continue
            gradient, coming = gradient[fallen], coming[fallen]
            if check == CHECKS - 2:  # a crest, from where every way leads down: hold the joints that move these pairs
                moving = (gradient != 0.0).any(axis=0)
                box, constraints = (np.where(moving, base, box[0]), np.where(moving, base, box[1])), asked
            target = gradient @ velocity + (SPARE - over[fallen]) / self.window.rates.period
            floor = np.where(coming, -np.inf, np.minimum(target, gradient @ base))
            constraints = constraints.with_rows(SoftConstraints(gradient, target, floor, np.full(len(target), COMING)))
            corrected = best_velocity(hessian, linear, *box, constraints)
            velocity = base if corrected is None else corrected
        return (base, Mode.STOPPED, False) if best is None else (best[1], Mode.CORRECTED, False)

    def _lowest(self, velocity: Array) -> tuple[Array, Array, Mask]:
        """Return of each pair that may fall (m,): by how much it is above its floor where it is lowest on the way [m],
        its derivative by the command there, by T (m, n), and whether it is a pair with a moving obstacle."""
        barriers, period = self.sight.barriers, self.window.rates.period
        floors, inside, near = self.seen.floors, self.seen.inside, self.seen.near
        path = self.window.way(velocity)
        times = self.time + period * np.arange(1, len(path) + 1, dtype=np.float64)
        sample, pair = barriers.doubtful(path, times, self.sight.needed)
        # what comes may reach a robot at rest, too: so only the next place
        soon = (sample == 0) | ~barriers.coming[pair]
        sample, pair = sample[soon], pair[soon]
        found = self.sight.straight(barriers.along(path, times, sample, pair), pair, inside)
        close, row = (
            each.ravel() for each in np.meshgrid(np.flatnonzero(self.sight.closely(path)), np.arange(len(near)))
        )
        soon = (close == 0) | ~barriers.coming[inside[row]]
        close, row = close[soon], row[soon]
        exact = barriers.nearness(path, times, close, inside[row])
        over = np.concatenate([found.value - floors[pair], exact.value - near[row]])
        gradient = np.concatenate([found.gradient, exact.gradient])
        sample = np.concatenate([sample, close])
        key = np.concatenate([pair, len(floors) + row])
        order = np.lexsort((over, key))
        lowest = order[np.flatnonzero(np.diff(key[order], prepend=-1))]
        gains = self.window.gains[np.minimum(sample[lowest], len(self.window.gains) - 1)]
        pairs = np.concatenate([pair, inside[row]])[lowest]
        return over[lowest], gradient[lowest] * gains, barriers.coming[pairs]
