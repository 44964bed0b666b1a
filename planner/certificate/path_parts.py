"""Parts of a motion, and what a path constraint must provide on them."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from hdplan.planner.motion.motion_bounds import Chain, Motion, cross
from hdplan.scenes.array_types import Array, Mask, Rows


class Part(NamedTuple):
    """k parts of a motion."""

    chain: Chain
    rotations: Array  # (k, joints, 3, 3) at their midpoints
    origins: Array  # (k, joints, 3)
    delta: Array  # (k, n) δ
    off: Array  # (k, n) ε
    travel: Array  # (n, 2) the range of each coordinate over the whole motion

    @property
    def axes(self) -> Array:
        """The joints' axes (k, n, 3) in the world."""
        return np.asarray(np.einsum("knij,nj->kni", self.rotations[:, 1:], self.chain.axes))

    def reach(self, joint: int, point: Array) -> tuple[Array, Array]:
        """Return the positions (k, 3) of a point (3,) of a joint's frame, and ρ (k, n)."""
        place = self.rotations[:, joint] @ point + self.origins[:, joint]
        everywhere = self.chain.reach(joint, point[None], 0.0, self.travel)
        where = self.axes, self.origins[:, 1:], np.abs(self.delta) + self.off
        joints, radii = np.array([joint]), np.zeros(1)
        return place, self.chain.local_reach(everywhere[None], joints, place[:, None], radii, *where)[:, 0]

    def moved(self, joint: int, point: Array, moves: Mask) -> tuple[Array, Motion]:
        """Return the positions (k, 3) of a point (3,) of a joint's frame, and its motion by the joints `moves` (n,)."""
        place, reach = self.reach(joint, point)
        delta, off = self.delta * moves, self.off * moves
        return place, Motion.of(self.chain, delta, off, self.axes, self.origins[:, 1:], reach)


class Stated(Protocol):
    """A constraint in the scene's words."""

    @property
    def field(self) -> str:
        """Name of the scene's field."""

    @property
    def link(self) -> str:
        """The link of the constraint."""

    @property
    def allowed(self) -> float:
        """Greatest value allowed [rad], [m], [m/s] or [m/s²]."""

    @property
    def scale(self) -> float:
        """The scale of its values, in their unit, of which a share is accepted as slack."""

    def broken(self, found: float) -> str:
        """Return a message on a value where it is violated."""

    def kept(self, worst: float) -> str:
        """Return a message on the upper bound proven over the whole motion."""


class Valued(Protocol):
    """Values of a constraint on parts of a motion."""

    def found(self, rotations: Array, origins: Array) -> Array:
        """Return its value (k,) at k configurations, exact up to rounding."""

    def bound(self, part: Part, found: Array) -> Array:
        """Return an upper bound (k,) of its value on parts of the motion; at their midpoints it is `found` (k,)."""


class Held(Stated, Valued, Protocol):
    """A constraint that is the same at every instant."""


class HeldAlong(Stated, Protocol):
    """A constraint that changes with time along one motion."""

    @property
    def spans(self) -> tuple[Rows, Array, Array]:
        """Parts of the motion to begin with, which cover it in order: interval, start and width (k,)."""

    def on(self, interval: Rows, start: Array, width: Array) -> Valued:
        """Return its form on parts of the motion."""


def between_rows(intervals: int) -> tuple[Rows, Array, Array]:
    """Return all intervals between rows as parts of a motion: interval, start and width (k,)."""
    return np.arange(intervals), np.zeros(intervals), np.ones(intervals)


class WithTolerance:
    """A constraint whose values are measured against its tolerance."""

    allowed: float

    @property
    def scale(self) -> float:
        """The tolerance."""
        return self.allowed


def angles_between(one: Array, other: Array) -> Array:
    """Return the angles (k,) between rotations (k, 3, 3), exact near 0 and π too."""
    between = one.transpose(0, 2, 1) @ other
    sine = 0.5 * np.linalg.norm([between[:, i, j] - between[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=0)
    return np.asarray(np.arctan2(sine, 0.5 * (np.trace(between, axis1=1, axis2=2) - 1.0)))


def spun(omega: Array, rotations: Array) -> Array:
    """Return [ω]× R (k, 3, 3)."""
    return cross(omega[:, None], rotations.transpose(0, 2, 1)).transpose(0, 2, 1)


def no_greater_angle(chord: Array, coarse: Array) -> Array:
    """The smaller of two bounds (k,) of angles: of a chord of the unit circle that is no longer, and a coarse one."""
    return np.asarray(np.minimum(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)), coarse))
