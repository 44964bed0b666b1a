"""The certificate's check of path constraints: whether a motion keeps them all along, proven between the rows too.

Each constraint gives its value at a configuration, and an upper bound of it on a part of the motion (`path_bounds`);
those on a curve that is followed say something else on every part (`followed_curve`, `tool_rates`). A part whose bound
does not suffice is halved; a violation found at a midpoint is a fact. Angles in [rad], distances in [m].
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from hdplan.planner.certificate import tool_rates
from hdplan.planner.certificate.followed_curve import NODES, Followed, NearEnd, OnCurve, TurnedAlong
from hdplan.planner.certificate.path_bounds import held_by
from hdplan.planner.certificate.path_parts import HeldAlong, Part, Stated, Valued, between_rows
from hdplan.planner.certificate.pose_curve import PoseCurve
from hdplan.planner.motion.curve import Curve
from hdplan.planner.motion.motion_bounds import Chain
from hdplan.planner.robot.setup import Setup
from hdplan.scenes.array_types import Array, Rows
from hdplan.scenes.deadline import seconds_left
from hdplan.scenes.errors import InputError, naming

TOLERANCE_EXCESS = 1e-9  # [rad] or [m] beyond the tolerance that is accepted, for rounding errors
BOUND_ROUNDING = 1e-9  # [rad] or [m] added to every bound
TOLERANCE_SLACK = 0.02  # share of the tolerance by which the proven worst value may exceed the worst one found
SHORTEST_INTERVAL = 2.0**-17  # of an interval: below it, the answer is "not proven"


@dataclass(frozen=True)
class Departure:
    """A place where a constraint is violated or not proven to be kept: the worst one found in its interval."""

    field: str  # such as "path.upright"
    link: str
    words: str  # what was found, such as "path.upright: panda_hand is tilted by 0.2 rad, 0.1 are allowed"
    interval: int  # between rows `interval` and `interval` + 1
    fraction: float  # of that interval, 0 to 1
    parameter: float  # of the whole motion, 0 to 1
    found: float  # an angle [rad], a distance [m], or how far beyond the box [m]
    allowed: float  # the tolerance [rad] or [m]; 0 for a box

    @property
    def excess(self) -> float:
        """The excess over the tolerance [rad] or [m]; negative where it only could not be proven."""
        return self.found - self.allowed

    @property
    def violated(self) -> bool:
        """True if the constraint is violated there; otherwise it only could not be proven."""
        return self.found > self.allowed + TOLERANCE_EXCESS


@dataclass(frozen=True)
class Kept:
    """The margin that a motion leaves to one constraint."""

    field: str
    link: str
    words: str  # what is proven, such as "panda_hand upright within 0.083 of 0.1 rad"
    worst: float  # proven upper bound over the whole motion [rad] or [m]
    met: float  # the worst one found
    allowed: float


@dataclass(frozen=True)
class PathProof:
    """Findings of a check of one motion."""

    kept: tuple[Kept, ...]  # one for each constraint of the scene
    departures: tuple[Departure, ...]  # one for every constraint and interval without proof
    configurations: int  # evaluated

    @property
    def covered(self) -> frozenset[str]:
        """The fields of the scene of which constraints were proven, or found not to hold: "path.upright"."""
        return frozenset(each.field for each in self.kept)


class PathCheck:
    """The path constraints of one scene, prepared for many motions."""

    def __init__(self, setup: Setup, chain: Chain) -> None:
        """Look up the links. Raises InputError as `held_by`."""
        self.robot, self.chain = setup.robot.unfolded, chain
        self.constraints = held_by(setup)
        self.follow = setup.scene.path.follow
        with naming(setup.scene.source):
            self._curve = None if self.follow is None else PoseCurve.of(self.robot, self.follow)
            if self.follow is not None and self.follow.rated and setup.scene.limits.acceleration is None:
                raise InputError("path.follow: speed and acceleration of a tool need limits.acceleration")

    def at(self, q: Array) -> tuple[Departure, ...]:
        """Return the constraints that joint values q (m,) violate; exact up to rounding."""
        frames = self.chain.frames(self.robot.pin_q(q[None]))
        found = [(each, float(each.found(*frames)[0])) for each in self.constraints]
        departures = (_departure(each, 0, 0.0, 0.0, value) for each, value in found)
        return tuple(departure for departure in departures if departure.violated)

    def prove(self, curve: Curve) -> PathProof:
        """Prove every constraint over the whole motion, or find where it cannot be proven."""
        spans = between_rows(len(curve) - 1)
        proofs = [self._prove(held, spans, lambda *_, held=held: held, curve) for held in self.constraints]
        along: list[tuple[Kept, list[Departure], int]] = []
        for nodes in () if self.follow is None else NODES:
            along = [self._prove(held, held.spans, held.on, curve) for held in self._along(curve, nodes)]
            if not any(departures for _, departures, _ in along):
                break
        proofs += along
        return PathProof(
            tuple(kept for kept, _, _ in proofs),
            tuple(departure for _, departures, _ in proofs for departure in departures),
            sum(count for _, _, count in proofs),
        )

    def _along(self, motion: Curve, nodes: int) -> Iterator[HeldAlong]:
        """Yield what following a curve means for one motion, with places at so many nodes of every interval."""
        assert self.follow is not None
        assert self._curve is not None
        followed = Followed.by(motion, self._curve, self.robot, self.chain, nodes)
        yield OnCurve(followed, self.follow.position_tolerance)
        yield TurnedAlong(followed, self.follow.orientation_tolerance)
        for name, at_end in (("begin_tolerance", False), ("end_tolerance", True)):
            if (radius := getattr(self.follow, name)) is not None:
                yield NearEnd(followed, radius, f"path.follow.{name}", at_end)
        for order, name in tool_rates.FIELDS.items():
            if getattr(self.follow, name) is not None:
                yield tool_rates.ToolRate.of(self.robot, self.chain, self.follow, motion, order, followed.rated)

    def _prove(
        self, held: Stated, spans: tuple[Rows, Array, Array], on: Callable[[Rows, Array, Array], Valued], curve: Curve
    ) -> tuple[Kept, list[Departure], int]:
        """Prove one constraint, beginning with these parts of the motion; `on` is its form on parts."""
        intervals, configurations = len(curve) - 1, 0
        interval, start, width = spans
        travel = _travel(*curve.part(interval, start, width))
        failed, broken = np.zeros(intervals, dtype=bool), np.zeros(intervals, dtype=bool)
        worst, place = np.full(intervals, -np.inf), np.zeros(intervals)  # found on each interval, and where
        proven, slack = -np.inf, max(TOLERANCE_SLACK * held.scale, TOLERANCE_EXCESS)
        while len(interval):
            middle, delta, off = curve.part(interval, start, width)
            frames = self.chain.frames(self.robot.pin_q(middle))
            valued = on(interval, start, width)
            found = valued.found(*frames)
            bound = valued.bound(Part(self.chain, *frames, delta, off, travel), found)
            bound = np.maximum(bound, found) + BOUND_ROUNDING
            configurations += len(interval)
            for i in np.flatnonzero(found > worst[interval]).tolist():
                if found[i] > worst[interval[i]]:
                    worst[interval[i]], place[interval[i]] = found[i], start[i] + 0.5 * width[i]
            broken |= worst > held.allowed + TOLERANCE_EXCESS
            settled = (bound <= held.allowed + TOLERANCE_EXCESS) | broken[interval]
            closed = settled & (bound <= worst.max() + slack)
            closed |= (width <= SHORTEST_INTERVAL) | (seconds_left() == 0.0)
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


def _departure(held: Stated, interval: int, fraction: float, parameter: float, found: float) -> Departure:
    words = f"{held.field}: {held.broken(found)}"
    return Departure(held.field, held.link, words, interval, fraction, parameter, found, held.allowed)


def _travel(middle: Array, delta: Array, off: Array) -> Array:
    """Return the range (n, 2) of each joint coordinate over all parts."""
    reach = np.abs(delta) + off
    return np.stack([(middle - reach).min(axis=0), (middle + reach).max(axis=0)], axis=1)
