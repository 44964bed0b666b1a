"""Two curves blended into one another, as Pilz' industrial motion planner does it (its transition window).

Within a radius r of where the first curve ends and the second begins, x = (1 − α) x₁ + α x₂ with x₁ on the first, x₂ on
the second, and α = 6 s⁵ − 15 s⁴ + 10 s³ for the share s of the time that the blend takes; so is the rotation, along the
shortest turn from that of x₁ to that of x₂. There x₁ comes to rest at the end of its curve, and x₂ starts from rest.

Where both curves have a speed v and an acceleration a of their tool, both move by trapezoids of these, from end to end.
If x₁ takes T₁ from where it enters the ball, and x₂ T₂ until it leaves it, the blend takes the longer one of them, and
x₂ starts T₁ − T₂ later where that is positive: Pilz' definition. Where they have not, x₁ brakes evenly, x₂ accelerates
evenly, and T₁ = T₂.

α is flat at both ends, so that directions and curvatures go over from one curve into the blend, and into the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hdplan.planner.geometry.rotations import matrices_of
from hdplan.planner.job.following import lengths_of, turns_between
from hdplan.scenes.array_types import Array

CHORD_SHARE = 0.02  # share of a tolerance that the chords of a blend take
LEAST_CHORDS, MOST_CHORDS = 8, 2048  # chords of half of a blend


class UnblendedError(Exception):
    """Two stages that cannot be blended, and why."""

    number = 0  # of the first of them, among those that are driven as one


@dataclass(frozen=True, eq=False)
class Leg:
    """A curve of poses (N, 4, 4), straight from each to the next, and how its tool moves along it, if that is given."""

    poses: Array
    free: str  # the axis about which the link may turn as it likes
    speed: float | None = None  # [m/s]
    acceleration: float | None = None  # [m/s²]

    @cached_property
    def places(self) -> Array:
        """Arc length along the curve to its poses, as shares of the whole (N,)."""
        along = np.concatenate([[0.0], np.cumsum(lengths_of(self.poses, self.free)[0])])
        return np.asarray(along / along[-1])

    def at(self, share: Array) -> Array:
        """Return poses (k, 4, 4) at shares (k,) of the curve."""
        turns = turns_between(self.poses, self.free)
        segment = np.clip(np.searchsorted(self.places, share, side="right") - 1, 0, len(turns) - 1)
        wide = np.maximum(np.diff(self.places)[segment], 1e-300)
        inner = np.clip((share - self.places[segment]) / wide, 0.0, 1.0)[:, None]
        found = self.poses[segment].copy()
        turned = matrices_of(inner * turns[segment])
        found[:, :3, :3] = turned @ found[:, :3, :3]
        found[:, :3, 3] += inner * (self.poses[segment + 1, :3, 3] - self.poses[segment, :3, 3])
        return found

    @cached_property
    def backwards(self) -> Leg:
        """This curve from its end to its beginning."""
        return Leg(self.poses[::-1], self.free, self.speed, self.acceleration)

    def leaves(self, radius: float) -> float:
        """Return the share of the curve at which it first is so far from its beginning. Raises UnblendedError."""
        off = self.poses[:, :3, 3] - self.poses[0, :3, 3]
        beyond = np.flatnonzero(np.linalg.norm(off, axis=1) > radius)
        if not len(beyond):
            far = float(np.linalg.norm(off, axis=1).max())
            raise UnblendedError(f"it is nowhere farther than {far:.4g} m from there")
        k = int(beyond[0])
        one, way = off[k - 1], off[k] - off[k - 1]
        a, b, c = way @ way, one @ way, one @ one - radius**2  # a x² + 2 b x + c = 0
        inner = (-b + np.sqrt(max(b * b - a * c, 0.0))) / a
        return float(self.places[k - 1] + inner * (self.places[k] - self.places[k - 1]))

    @cached_property
    def law(self) -> Trapezoid | None:
        """Time law of the tool along it; None if none is given."""
        length = float(np.linalg.norm(np.diff(self.poses[:, :3, 3], axis=0), axis=1).sum())
        if self.speed is None or self.acceleration is None or length == 0.0:
            return None
        return Trapezoid(self.speed / length, self.acceleration / length)


@dataclass(frozen=True)
class Trapezoid:
    """A motion from rest to rest along a curve, in shares of it, with a greatest speed and one acceleration."""

    speed: float  # [1/s]
    acceleration: float  # [1/s²]

    @property
    def ramp(self) -> float:
        """Duration of the acceleration [s]."""
        return min(self.speed / self.acceleration, float(np.sqrt(1.0 / self.acceleration)))

    @property
    def duration(self) -> float:
        """Duration of the whole [s]."""
        return self.ramp + 1.0 / (self.acceleration * self.ramp)

    def at(self, time: Array) -> Array:
        """Return shares of the way (k,) at times (k,); before, it is at the beginning, afterwards at the end."""
        ramp, whole = self.ramp, self.duration
        t = np.clip(time, 0.0, whole)
        up, down = 0.5 * self.acceleration * t**2, 1.0 - 0.5 * self.acceleration * (whole - t) ** 2
        even = self.acceleration * ramp * (t - 0.5 * ramp)
        return np.asarray(np.where(t <= ramp, up, np.where(t >= whole - ramp, down, even)))

    def until(self, share: float) -> float:
        """Return the time [s] at a share of the way."""
        bend = 0.5 * self.acceleration * self.ramp**2
        if share <= bend:
            return float(np.sqrt(2.0 * share / self.acceleration))
        if share >= 1.0 - bend:
            return self.duration - float(np.sqrt(2.0 * (1.0 - share) / self.acceleration))
        return 0.5 * self.ramp + share / (self.acceleration * self.ramp)


@dataclass(frozen=True, eq=False)
class Blend:
    """A curve, blended into another one that begins where it ends."""

    first: Leg
    second: Leg
    enters: float  # the share of the first at which the blend begins
    leaves: float  # the share of the second at which it ends

    @classmethod
    def of(cls, first: Leg, second: Leg, radius: float) -> Blend:
        """Look for where they are within a radius. Raises UnblendedError for a curve that is shorter."""
        try:
            enters = 1.0 - first.backwards.leaves(radius)
        except UnblendedError as error:
            raise UnblendedError(f"{radius:g} m is larger than the stage itself: {error}") from None
        try:
            leaves = second.leaves(radius)
        except UnblendedError as error:
            raise UnblendedError(f"{radius:g} m is larger than the stage that follows: {error}") from None
        return cls(first, second, enters, leaves)

    def shares(self, s: Array) -> tuple[Array, Array]:
        """Return the places of x₁ and x₂ on their curves at shares s (k,) of the blend's time."""
        one, other = self.first.law, self.second.law
        if one is None or other is None:
            return eased(self.enters, self.leaves, s)
        enters, leaves = one.until(self.enters), other.until(self.leaves)
        remains = one.duration - enters
        time = s * max(remains, leaves)
        return one.at(enters + time), other.at(time - max(remains - leaves, 0.0))

    def at(self, s: Array) -> Array:
        """Return poses (k, 4, 4) at shares s (k,) of the blend's time."""
        first, second = self.shares(s)
        one, other, alpha = self.first.at(first), self.second.at(second), quintic(s)[:, None]
        between = turns_between(np.stack([one, other], axis=1).reshape(-1, 4, 4), self.first.free)[::2]
        found = one.copy()
        turned = matrices_of(alpha * between)
        found[:, :3, :3] = turned @ one[:, :3, :3]
        found[:, :3, 3] += alpha * (other[:, :3, 3] - one[:, :3, 3])
        return found

    def chords(self, distance: float, angle: float, half: int) -> Array:
        """Return poses (k, 4, 4) along its first (0) or second (1) half, whose chords leave it by no more than
        CHORD_SHARE of these tolerances [m] and [rad]. Raises UnblendedError for too many."""
        count = LEAST_CHORDS
        while True:
            s = 0.5 * (half + np.linspace(0.0, 1.0, 2 * count + 1))
            fine = self.at(s)
            ends, middle = fine[::2], fine[1::2]
            off = np.linalg.norm(0.5 * (ends[:-1] + ends[1:])[:, :3, 3] - middle[:, :3, 3], axis=1).max()
            there = 0.5 * (ends[:-1] + ends[1:])[:, :3, :3] - middle[:, :3, :3]
            turned = np.linalg.norm(there, axis=(1, 2)).max() / np.sqrt(2.0)
            if off <= 0.5 * CHORD_SHARE * distance and turned <= 0.5 * CHORD_SHARE * angle:
                return ends
            if count >= MOST_CHORDS:
                raise UnblendedError(
                    f"{distance:g} m and {angle:g} rad take more than {MOST_CHORDS} chords: allow more"
                )
            count *= 2


def eased(enters: float, leaves: float, s: Array) -> tuple[Array, Array]:
    """Return the shares (k,) of two ways, of which one brakes evenly to its end, and the other accelerates evenly."""
    return 1.0 - (1.0 - enters) * (1.0 - s) ** 2, leaves * s**2


def quintic(s: Array) -> Array:
    """Return α (k,) at shares s (k,) of a blend's time."""
    return np.asarray(s**3 * (10.0 + s * (6.0 * s - 15.0)))
