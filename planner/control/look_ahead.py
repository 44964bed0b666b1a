"""The check of a command before it is sent: the robot can brake from it without coming too close.

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

from hdplan.planner.control.lows import Floors, Lows, lows_near, lows_of_hulls
from hdplan.planner.control.program_rows import MOVING_WEIGHT
from hdplan.planner.control.quadratic_program import SoftConstraints, best_velocity
from hdplan.planner.control.sight import Seen, Sight
from hdplan.planner.control.window import Window
from hdplan.scenes.array_types import Array, Mask

MOST_CHECKS = 6  # of commands, including the first, and one whose joints are held
DISTANCE_ROUNDING = 1e-12  # [m] by which a distance that must not fall may do so
SPARE_DISTANCE = 1e-7  # [m] by which a corrected command should end above that: more than the program's tolerance


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
        base, box, given = self.window.brake[0], self.window.box, constraints
        best: tuple[float, Array] | None = None
        for check in range(MOST_CHECKS + 1):
            over, gradient, coming = self._fallen(velocity)
            braking = check == MOST_CHECKS
            if not len(over):
                return velocity, Mode.STOPPED if braking else Mode.CORRECTED if check else Mode.MOVING, True
            yielding = coming.all()  # only what moves comes too close: braking is no better
            if yielding and (best is None or over.min() > best[0]):
                best = float(over.min()), velocity
            if braking or (yielding and check == MOST_CHECKS - 3):
                break
            if check == MOST_CHECKS - 1:
                velocity = base
                continue
            if (
                check == MOST_CHECKS - 2
            ):  # a crest, from where every way leads down: hold the joints that move these pairs
                moving = (gradient != 0.0).any(axis=0)
                box, constraints = (np.where(moving, base, box[0]), np.where(moving, base, box[1])), given
            target = gradient @ velocity + (SPARE_DISTANCE - over) / self.window.rates.period
            floor = np.where(coming, -np.inf, np.minimum(target, gradient @ base))
            constraints = constraints.with_rows(
                SoftConstraints(gradient, target, floor, np.full(len(target), MOVING_WEIGHT))
            )
            corrected = best_velocity(hessian, linear, *box, constraints)
            velocity = base if corrected is None else corrected
        return (base, Mode.STOPPED, False) if best is None else (best[1], Mode.CORRECTED, False)

    def _fallen(self, velocity: Array) -> tuple[Array, Array, Mask]:
        """Return of each pair that falls below its floor (m,): by how much it is above it where it is lowest on the way
        [m], its derivative by the command there, by T (m, n), and whether it is a pair with a moving obstacle."""
        sight, seen, window = self.sight, self.seen, self.window
        path = window.way(velocity)
        times = self.time + window.rates.period * np.arange(1, len(path) + 1, dtype=np.float64)
        moment = sight.barriers.at(path, times)
        # what comes may reach a robot at rest, too: so of that only the next place
        floors = Floors(seen.floors, sight.next, seen.inside, -DISTANCE_ROUNDING)
        found = [lows_near(moment, sight.needed, sight.shaping, floors)]
        if len(seen.inside):
            floors = floors._replace(values=seen.near)
            found.append(lows_of_hulls(moment, sight.closely(path), seen.inside, floors))
        low = Lows(*map(np.concatenate, zip(*found, strict=True)))
        gains = window.gains[np.minimum(low.sample, len(window.gains) - 1)]
        return low.over, low.gradient * gains, sight.barriers.coming[low.pair]
