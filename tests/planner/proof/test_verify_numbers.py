"""Laws of the checker's numbers: rotations by quaternions, reaches and tables."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from hdplan.verify import RejectedError, balls
from hdplan.verify.kernel import Motion
from hdplan.verify.scene import turned_by
from hdplan.verify.world import numbers

from .test_verify_arithmetic import random_motion


def test_rotations_by_quaternions_in_decimals_are_enclosed() -> None:
    """So are the decimals that are as far from their doubles as can be."""
    rng = np.random.default_rng(11)
    for _ in range(200):
        q = rng.normal(size=4) * 10.0 ** rng.uniform(-12, 0, 4)
        q *= rng.uniform(0.99, 1.01) / np.linalg.norm(q)
        found = turned_by(*q.tolist())
        x, y, z, w = (
            Fraction(a) * (1 + Fraction(int(e)) * Fraction(balls.EPS))
            for a, e in zip(q, rng.integers(-1, 2, 4), strict=True)
        )
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=object)
        turn = np.eye(3, dtype=int) + (w * k + k @ k) * (Fraction(2) / (x * x + y * y + z * z + w * w))
        off = [abs(a - Fraction(b)) for a, b in zip(turn.ravel(), found.mid.ravel(), strict=True)]
        assert max(off) <= Fraction(float(found.rad.min())) < Fraction(1, 10**14)


def test_reaches_are_those_of_the_axes(tmp_path: Path) -> None:
    """No point within a piece's ball is farther from a joint's axis than its reach, at the middle of an interval."""
    rng = np.random.default_rng(12)
    world, _, _ = random_motion("panda_carry", "linear", tmp_path)
    motion = Motion(world, np.array([[0.0, 1.0], [1.5, 1.75]]))
    for k in range(2):
        for m, g in enumerate(world.movers.tolist()):
            piece, turn, at = world.pieces[g], motion.turn.mid[k], motion.at.mid[k]
            local = piece.corners[rng.integers(len(piece.corners), size=20)] @ piece.pose[0].mid.T + piece.pose[1].mid
            points = local @ turn[piece.joint].T + at[piece.joint]
            for j in np.flatnonzero(world.carried[piece.joint] & world.turning).tolist():
                away = np.linalg.norm(np.cross(points - at[j], motion.axis.mid[k, j]), axis=1)
                assert away.max() <= motion.reach[k, m, j] <= away.max() + 1.5


def test_tables_are_taken_as_lists_are() -> None:
    """NumPy's other arrays are refused: no words, no truth values, no numbers of other kinds."""
    rows = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    np.testing.assert_array_equal(numbers(np.array(rows), (-1, 3), "x"), numbers(rows, (-1, 3), "x"))
    assert numbers(np.array([[1, 2, 3]]), (-1, 3), "x").dtype == np.float64
    wrong = [np.array(rows, dtype=object), np.array(rows) > 2, np.array([["1", "2", "3"]]), np.array(rows)[:, :2]]
    wrong += [np.array(rows) * np.inf, np.array(rows) * np.nan, np.array(rows) * 1e9]
    for each in (*wrong, [[True, 1.0, 2.0]], [[1.0, 2.0, "3"]], [[1.0, 2.0]], rows[0]):
        with pytest.raises(RejectedError, match="x: "):
            numbers(each, (-1, 3), "x")
