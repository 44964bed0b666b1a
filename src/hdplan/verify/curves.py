"""The curves of a job's stages by the checker's own definition: lines, arcs, poses one after the other, and two of them
blended within a radius.

Plain numbers, by which a curve is known to ROUNDED. Arcs and blends become chords, so short that both are FINE of the
tolerance away from one another at most: of a curve whose second derivative is no longer than M they are M h^2 / 8 away
over a share h of it, at equal shares, and its rotation, which turns by at most W, by at most W h.

A blend is x = (1 - a) x1 + a x2 with a = 6 s^5 - 15 s^4 + 10 s^3 over the share s of its time, a' at most 15/8 and
|a''| at most 10 / sqrt(3); rotations likewise, along the shortest turn. On a sphere the point at a share between two
moves no faster than both of them together, and a' times their distance, if that is at most a quarter of the way round.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .balls import need
from .turns import turned, turns_between

ROUNDED = 1e-9  # [m], and of the numbers of rotations
FINE = 0.02, 0.05  # shares of the tolerances of position and turn that chords take
RADIAN = 0.3  # [m] as which a turn counts where poses are passed evenly
MOST_CHORDS = 20_000
FARTHEST_TURN = 1.5  # [rad] between two curves that are blended
SLOPE, BEND = 15 / 8, 5.7736  # of a, at most
SHORTEST = 1e-9  # [m] or of rotations' numbers


@dataclass(frozen=True, eq=False)
class Leg:
    """A curve from its beginning to its end: straight between poses, or one arc."""

    at: Any  # (N, 3)
    rotations: Any  # (N, 3, 3)
    free: str  # axis about which the link may turn as it likes
    law: tuple[float | None, float | None] = (None, None)  # speed and acceleration of the tool
    arc: tuple[Any, Any, Any, float] | None = None  # centre, two arms at right angles, the angle from the first one

    @cached_property
    def turns(self) -> Any:
        """The turns (N - 1, 3) from each pose to the next."""
        return turns_between(self.rotations[:-1], self.rotations[1:], self.free)

    @cached_property
    def widths(self) -> Any:
        """The lengths (N - 1,) from each pose to the next, turns counted as lengths."""
        return np.hypot(lengths(np.diff(self.at, axis=0)), RADIAN * lengths(self.turns))

    @cached_property
    def shares(self) -> Any:
        """Arc length along the curve to its poses (N,), of the whole."""
        along = np.append(0.0, np.cumsum(self.widths))
        need(along[-1] > SHORTEST, "the curve has no length")
        return along / along[-1]

    @cached_property
    def length(self) -> float:
        """Length of the origin's way [m]."""
        if self.arc is not None:
            return float(self.arc[3] * lengths(self.arc[1]))
        return float(lengths(np.diff(self.at, axis=0)).sum())

    @cached_property
    def rates(self) -> tuple[float, float, float]:
        """Upper bounds of the first and second derivative of the place, and of the turn, over the share."""
        if self.arc is not None:
            return self.length, self.length * self.arc[3], float(lengths(self.turns[0]))
        wide = np.maximum(np.diff(self.shares), 1e-300)
        steps = lengths(np.diff(self.at, axis=0)) / wide, lengths(self.turns) / wide
        return float(steps[0].max()), 0.0, float(steps[1].max())

    def poses(self, share: Any) -> tuple[Any, Any]:
        """Places (k, 3) and rotations (k, 3, 3) at shares (k,)."""
        k = np.clip(np.searchsorted(self.shares, share, side="right") - 1, 0, len(self.turns) - 1)
        inner = ((share - self.shares[k]) / np.maximum(np.diff(self.shares)[k], 1e-300))[:, None]
        rotations = turned(inner * self.turns[k]) @ self.rotations[k]
        if self.arc is None:
            return self.at[k] + inner * (self.at[k + 1] - self.at[k]), rotations
        centre, one, two, angle = self.arc
        return centre + np.cos(inner * angle) * one + np.sin(inner * angle) * two, rotations

    @cached_property
    def backwards(self) -> Leg:
        """This curve from its end to its beginning."""
        arc = self.arc
        if arc is not None:
            centre, one, two, angle = arc
            cos, sin = np.cos(angle), np.sin(angle)
            arc = centre, cos * one + sin * two, sin * one - cos * two, angle
        return Leg(self.at[::-1], self.rotations[::-1], self.free, self.law, arc)

    def leaves(self, radius: float) -> float:
        """The share at which it first is so far from its beginning."""
        if self.arc is not None:
            _, one, _, angle = self.arc
            half = radius / (2 * float(lengths(one)))
            need(half < np.sin(min(angle, np.pi) / 2), f"blend: {radius:g} m is larger than the curve")
            return float(2 * np.arcsin(half) / angle)
        off = self.at - self.at[0]
        beyond = np.flatnonzero(lengths(off) > radius)
        need(len(beyond), f"blend: {radius:g} m is larger than the curve")
        k = int(beyond[0])
        one, way = off[k - 1], off[k] - off[k - 1]
        a, b, c = way @ way, one @ way, one @ one - radius**2  # a x^2 + 2 b x + c = 0
        inner = (np.sqrt(max(b * b - a * c, 0.0)) - b) / a
        return float(self.shares[k - 1] + inner * (self.shares[k] - self.shares[k - 1]))

    def chords(self, first: float, last: float, far: float) -> tuple[Any, float]:
        """Shares from one to another between which it is replaced by chords, and how far it is from these [m]."""
        if self.arc is None:
            inner = self.shares[(self.shares > first) & (self.shares < last)]
            return np.array([first, *inner, last]), 0.0
        bend = self.rates[1] * (last - first) ** 2 / 8
        count = chord_count(np.sqrt(bend / (FINE[0] * far)))
        return np.linspace(first, last, count + 1), bend / count**2


@dataclass(frozen=True, eq=False)
class Blend:
    """A curve that goes over into another one within a radius around its end."""

    first: Leg
    second: Leg
    radius: float

    @cached_property
    def enters(self) -> float:
        """The share of the first curve at which the blend begins."""
        return 1.0 - self.first.backwards.leaves(self.radius)

    @cached_property
    def leaves(self) -> float:
        """The share of the second curve at which it ends."""
        return self.second.leaves(self.radius)

    @cached_property
    def laws(self) -> tuple[Trapezoid, Trapezoid] | None:
        """Time laws of the tool along both, where both say so."""
        made = [
            Trapezoid(speed / x.length, acceleration / x.length)
            for x in (self.first, self.second)
            for speed, acceleration in [x.law]
            if speed is not None and acceleration is not None and x.length > 0
        ]
        return (made[0], made[1]) if len(made) == 2 else None

    @cached_property
    def times(self) -> tuple[float, float, float]:
        """By the laws: when the blend begins on the first curve, how long it takes, when the second begins in it."""
        assert self.laws is not None
        begins = self.laws[0].until(self.enters)
        remains, passes = self.laws[0].duration - begins, self.laws[1].until(self.leaves)
        return begins, max(remains, passes), max(remains - passes, 0.0)

    def shares(self, s: Any) -> tuple[Any, Any]:
        """Shares of x1 and x2 on their curves: x1 brakes to the end of its curve, x2 accelerates from rest."""
        if self.laws is None:
            return 1.0 - (1.0 - self.enters) * (1.0 - s) ** 2, self.leaves * s**2
        begins, whole, later = self.times
        return self.laws[0].at(begins + s * whole), self.laws[1].at(s * whole - later)

    def poses(self, s: Any) -> tuple[Any, Any]:
        """Places (k, 3) and rotations (k, 3, 3) at shares (k,) of its time."""
        (one, turn), (two, other) = (x.poses(y) for x, y in zip((self.first, self.second), self.shares(s), strict=True))
        a = (s**3 * (10.0 + s * (6.0 * s - 15.0)))[:, None]
        return one + a * (two - one), turned(a * turns_between(turn, other, self.first.free)) @ turn

    @cached_property
    def rates(self) -> tuple[float, float]:
        """Upper bounds of the second derivative of the place over s, and of how fast it turns."""
        if self.laws is None:
            paces = [(2 * (1 - self.enters),) * 2, (2 * self.leaves,) * 2]
        else:
            whole = self.times[1]
            paces = [(x.speed * whole, x.acceleration * whole**2) for x in self.laws]
        ways = [x.rates for x in (self.first, self.second)]
        passed = 1 - self.enters, self.leaves
        gap = float(lengths(self.first.at[-1] - self.second.at[0]))
        split = turns_between(self.first.rotations[-1:], self.second.rotations[:1], self.first.free)
        angle = float(lengths(split[0])) + sum(way[2] * x for way, x in zip(ways, passed, strict=True))
        need(angle <= FARTHEST_TURN, f"blend: the two turn by more than {FARTHEST_TURN:g} rad within the radius")
        speed = sum(way[0] * pace[0] for way, pace in zip(ways, paces, strict=True))
        bent = sum(way[0] * pace[1] + way[1] * pace[0] ** 2 for way, pace in zip(ways, paces, strict=True))
        spin = SLOPE * angle + sum(way[2] * pace[0] for way, pace in zip(ways, paces, strict=True))
        return bent + 2 * SLOPE * speed + BEND * (2 * self.radius + gap), spin

    def chords(self, half: int, far: float, angle: float) -> tuple[Any, float, float]:
        """Shares over its first (0) or second (1) half between which it is replaced by chords, and how far it is from
        these [m] and [rad]. At a corner of either curve, where that changes its direction, there is one."""
        bent, spin = self.rates
        count = chord_count(max(np.sqrt(bent / (32 * FINE[0] * far)), spin / (2 * FINE[1] * angle)))
        s, step = 0.5 * (half + np.linspace(0.0, 1.0, count + 1)), 0.5 / count
        corners = [self.passes(i, x) for i, leg in enumerate((self.first, self.second)) for x in leg.shares[1:-1]]
        inner = [x for x in corners if s[0] < x < s[-1]]
        return np.union1d(s, inner), bent * step**2 / 8, spin * step

    def passes(self, which: int, share: float) -> float:
        """The share of its time at which one of its two curves is at a share, by halving."""
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            before = float(self.shares(np.array([middle]))[which][0]) < share
            low, high = (middle, high) if before else (low, middle)
        return high


@dataclass(frozen=True)
class Trapezoid:
    """Growth of a share from 0 to 1, from rest to rest, by a greatest rate and one acceleration."""

    speed: float
    acceleration: float

    @property
    def ramp(self) -> float:
        """Duration of the acceleration."""
        return float(min(self.speed / self.acceleration, 1.0 / np.sqrt(self.acceleration)))

    @property
    def duration(self) -> float:
        """Duration of the whole."""
        return self.ramp + 1.0 / (self.acceleration * self.ramp)

    def at(self, time: Any) -> Any:
        """Shares at times; before and after it rests."""
        early = np.clip(time, 0.0, self.ramp)
        late = np.clip(self.duration - time, 0.0, self.ramp)
        between = np.clip(time - self.ramp, 0.0, self.duration - 2 * self.ramp)
        top = self.acceleration * self.ramp
        return 0.5 * self.acceleration * (early**2 + self.ramp**2 - late**2) + top * between

    def until(self, share: float) -> float:
        """The time at which it is at a share, by halving."""
        low, high = 0.0, self.duration
        for _ in range(80):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if float(self.at(middle)) < share else (low, middle)
        return high


def chord_count(least: float) -> int:
    """A number of chords no less than this."""
    need(least < MOST_CHORDS, f"the curve takes more than {MOST_CHORDS} chords within its tolerances")
    return max(1, int(np.ceil(least)))


def lengths(vectors: Any) -> Any:
    """Lengths along the last axis."""
    return np.sqrt((vectors * vectors).sum(axis=-1))


def arc_through(begins: Any, point: Any, ends: Any) -> tuple[Any, Any, Any, float]:
    """The arc from a point through a second to a third."""
    a, b = point - begins, ends - begins
    normal = np.cross(a, b)
    need(lengths(normal) > 1e-6 * max(lengths(a), lengths(b)) ** 2 > 0, "circle.interim: the points lie on a line")
    centre = begins + np.cross((a @ a) * b - (b @ b) * a, normal) / (2 * (normal @ normal))
    return arc_around(begins, centre, ends, normal / lengths(normal))


def arc_about(begins: Any, centre: Any, ends: Any, tolerance: float) -> tuple[Any, Any, Any, float]:
    """The shorter arc about a centre, which is moved so that both ends are equally far from it."""
    way, (first, last) = ends - begins, (lengths(x - centre) for x in (begins, ends))
    need(abs(first - last) <= tolerance and min(lengths(way), first, last) > 1e-6, "circle.center: no circle is there")
    way = way / lengths(way)
    centre = centre + way * (((begins + ends) / 2 - centre) @ way)
    normal = np.cross(begins - centre, ends - centre)
    need(lengths(normal) > 1e-3 * lengths(begins - centre) ** 2, "circle.center: does not say which way")
    return arc_around(begins, centre, ends, normal / lengths(normal))


def arc_around(begins: Any, centre: Any, ends: Any, axis: Any) -> tuple[Any, Any, Any, float]:
    """The arc from a point about a centre and an axis to another one, by more than 0 and less than a whole turn."""
    one, other = begins - centre, ends - centre
    two = np.cross(axis, one)
    return centre, one, two, float(np.arctan2(two @ other, one @ other) % (2 * np.pi))
