"""Whether a motion keeps what its scene asks of the whole way, proven between the rows too: the certificate's word.

Each constraint says what it is at a configuration, and no more than what on a part of the motion (`path_bounds`). A
part whose bound does not suffice is halved; what is found at a midpoint is a fact. Angles in [rad], distances in [m].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate.path_bounds import Held, Part, held_by
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Array, Chain
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.deadline import seconds_left

GRANTED = 1e-9  # [rad] or [m] beyond what is allowed that rounding may cost
ROUNDING = 1e-9  # [rad] or [m] put on every bound
SLACK = 0.02  # share of what is allowed by which a proven worst value may lie above the worst that was met
SHORTEST = 2.0**-17  # of an interval: below it, the answer is "not proven"


@dataclass(frozen=True)
class Departure:
    """A place where a constraint is not kept, or not proven to be: the worst that was met in its interval."""

    field: str  # such as "path.upright"
    link: str
    words: str  # what was found, such as "path.upright: panda_hand is tilted by 0.2 rad, 0.1 are allowed"
    interval: int  # between rows `interval` and `interval` + 1
    fraction: float  # of that interval, 0 to 1
    parameter: float  # of the whole motion, 0 to 1
    found: float  # there: an angle [rad], a distance, or how far beyond the box [m]
    allowed: float  # [rad] or [m]

    @property
    def excess(self) -> float:
        """By how much it is more than allowed [rad] or [m]; negative where it only could not be proven."""
        return self.found - self.allowed

    @property
    def violated(self) -> bool:
        """Whether the constraint is broken there; else it only could not be proven."""
        return self.found > self.allowed + GRANTED


@dataclass(frozen=True)
class Kept:
    """How well one constraint is kept."""

    field: str
    link: str
    words: str  # what is proven, such as "panda_hand upright within 0.083 of 0.1 rad"
    worst: float  # proven for the whole motion: no more than that [rad] or [m]
    met: float  # the worst that was met
    allowed: float


@dataclass(frozen=True)
class PathProof:
    """What was found out about a motion."""

    kept: tuple[Kept, ...]  # one for each constraint of the scene
    departures: tuple[Departure, ...]  # for every constraint and interval without proof
    configurations: int  # looked at


class PathCheck:
    """The path constraints of one scene, made ready for many motions."""

    def __init__(self, setup: Setup, chain: Chain) -> None:
        """Look up the links. Raises InputError as `held_by`."""
        self.robot, self.chain = setup.robot, chain
        self.constraints = held_by(setup)

    def at(self, q: Array) -> tuple[Departure, ...]:
        """Return the constraints that configuration q (n,) breaks; exact to rounding."""
        frames = self.chain.frames(self.robot.pin_q(q[None]))
        found = [(each, float(each.found(*frames)[0])) for each in self.constraints]
        departures = (_departure(each, 0, 0.0, 0.0, value) for each, value in found)
        return tuple(departure for departure in departures if departure.violated)

    def prove(self, curve: Curve) -> PathProof:
        """Prove every constraint over the whole motion, or find where it cannot be proven."""
        proofs = [self._prove(constraint, curve) for constraint in self.constraints]
        return PathProof(
            tuple(kept for kept, _, _ in proofs),
            tuple(departure for _, departures, _ in proofs for departure in departures),
            sum(count for _, _, count in proofs),
        )

    def _prove(self, held: Held, curve: Curve) -> tuple[Kept, list[Departure], int]:
        intervals, configurations = len(curve) - 1, 0
        interval, start, width = np.arange(intervals), np.zeros(intervals), np.ones(intervals)
        travel = _travel(*curve.part(interval, start, width))
        failed, broken = np.zeros(intervals, dtype=bool), np.zeros(intervals, dtype=bool)
        worst, place = np.full(intervals, -np.inf), np.zeros(intervals)  # met on each interval, and where
        proven, slack = -np.inf, max(SLACK * held.scale, GRANTED)
        while len(interval):
            middle, delta, off = curve.part(interval, start, width)
            frames = self.chain.frames(self.robot.pin_q(middle))
            found = held.found(*frames)
            bound = held.bound(Part(self.chain, *frames, delta, off, travel), found)
            bound = np.maximum(bound, found) + ROUNDING
            configurations += len(interval)
            for i in np.flatnonzero(found > worst[interval]).tolist():
                if found[i] > worst[interval[i]]:
                    worst[interval[i]], place[interval[i]] = found[i], start[i] + 0.5 * width[i]
            broken |= worst > held.allowed + GRANTED
            settled = (bound <= held.allowed + GRANTED) | broken[interval]
            closed = settled & (bound <= worst.max() + slack)
            closed |= (width <= SHORTEST) | (seconds_left() == 0.0)
            failed[interval[closed & ~settled]] = True
            proven = max(proven, float(bound[closed].max(initial=-np.inf)))
            width = np.repeat(0.5 * width[~closed], 2)
            start = np.repeat(start[~closed], 2) + width * np.tile([0.0, 1.0], len(width) // 2)
            interval = np.repeat(interval[~closed], 2)
        departures = [
            _departure(held, i, float(place[i]), float((i + place[i]) / intervals), float(worst[i]))
            for i in np.flatnonzero(failed | broken).tolist()
        ]
        kept = Kept(held.field, held.link, held.kept(proven), proven, float(worst.max()), held.allowed)
        return kept, departures, configurations


def _departure(held: Held, interval: int, fraction: float, parameter: float, found: float) -> Departure:
    words = f"{held.field}: {held.broken(found)}"
    return Departure(held.field, held.link, words, interval, fraction, parameter, found, held.allowed)


def _travel(middle: Array, delta: Array, off: Array) -> Array:
    """The range (n, 2) of each coordinate over all parts."""
    reach = np.abs(delta) + off
    return np.stack([(middle - reach).min(axis=0), (middle + reach).max(axis=0)], axis=1)
