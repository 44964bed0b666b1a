"""Damped least squares from many configurations in one loop of C: `inverse` and `search.inverse_kinematics`, equal but
for rounding."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.scenes.array_types import Array, Mask


class Loops:
    """The loops for one goal: poses of links on an arm with n coordinates."""

    def __init__(self, functions: ModuleType, goal: Record, links: int, n: int) -> None:
        """Take the loops, the struct `goal` and its sizes."""
        self.functions, self.goal, self.rows, self.n = functions, goal, 6 * links, n

    def linearized(self, q: Array) -> tuple[Array, Array]:
        """Errors (B, m) and Jacobians (B, m, n) at q (B, n), m = 6 links."""
        found = np.empty((len(q), self.rows)), np.empty((len(q), self.rows, self.n))
        self.functions.linearized(self.goal.struct, np.ascontiguousarray(q), *found)
        return found

    def approach(self, q: Array, steps: int, many: int, left: float, aim: float, enough: float) -> Array:
        """Configurations to which q (B, n) lead, in `steps` or fewer."""
        q = np.array(q, order="C")
        self.functions.approach(self.goal.struct, q, steps, many, left, aim, enough)
        return q

    def centre(self, q: Array, steps: int) -> Array:
        """Configurations closer to the centre of the tolerances than q (B, n)."""
        q = np.array(q, order="C")
        self.functions.centre(self.goal.struct, q, steps)
        return q

    def draw_near(self, q: Array, start: Array, steps: int, back: int, enough: float) -> Array:
        """Configurations closer to `start` (n,) than q (B, n), as near to the goal."""
        q = np.array(q, order="C")
        self.functions.draw_near(self.goal.struct, q, np.ascontiguousarray(start), steps, back, enough)
        return q


def distinct(functions: ModuleType, q: Array, circling: Mask, apart: float) -> Array:
    """The rows of q (B, n) that are `apart` from all before them in some joint, apart from whole turns of joints that
    circle (n,)."""
    kept = np.empty(len(q), np.int64)
    count = functions.distinct(np.ascontiguousarray(q), circling.astype(np.int64), apart, kept)
    return np.asarray(q[kept[:count]])
