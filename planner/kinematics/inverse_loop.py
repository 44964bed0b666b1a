"""Damped least squares from many configurations in one loop of C: `inverse` and `search.inverse_kinematics`, equal but
for rounding."""

from __future__ import annotations

import numpy as np

from hdplan.distance.compiled.loops import C, Record
from hdplan.scenes.array_types import Array, Mask


class Loops:
    """The loops for one goal: poses of links on an arm with n coordinates."""

    def __init__(self, goal: Record, links: int, n: int) -> None:
        """Take the struct `goal` and its sizes."""
        self.goal, self.rows, self.n = goal, 6 * links, n

    def linearized(self, q: Array) -> tuple[Array, Array]:
        """Errors (B, m) and Jacobians (B, m, n) at q (B, n), m = 6 links."""
        found = np.empty((len(q), self.rows)), np.empty((len(q), self.rows, self.n))
        C.linearized(self.goal.struct, np.ascontiguousarray(q), *found)
        return found

    def approach(self, q: Array, steps: int, many: int, left: float, aim: float, enough: float) -> Array:
        """Configurations to which q (B, n) lead, in `steps` or fewer."""
        q = np.array(q, order="C")
        C.approach(self.goal.struct, q, steps, many, left, aim, enough)
        return q

    def centre(self, q: Array, steps: int) -> Array:
        """Configurations closer to the centre of the tolerances than q (B, n)."""
        q = np.array(q, order="C")
        C.centre(self.goal.struct, q, steps)
        return q

    def draw_near(self, q: Array, start: Array, steps: int, back: int, enough: float) -> Array:
        """Configurations closer to `start` (n,) than q (B, n), as near to the goal."""
        q = np.array(q, order="C")
        C.draw_near(self.goal.struct, q, np.ascontiguousarray(start), steps, back, enough)
        return q


def distinct(q: Array, circling: Mask, apart: float) -> Array:
    """The rows of q (B, n) that are `apart` from all before them in some joint."""
    kept = np.empty(len(q), np.int64)
    count = C.distinct(np.ascontiguousarray(q), circling.astype(np.int64), apart, kept)
    return np.asarray(q[kept[:count]])
