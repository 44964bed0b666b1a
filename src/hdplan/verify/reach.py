"""Reach: the links that are to hold an object are near it where it is taken.

The distance of two convex pieces is bounded from above by the length of a difference of their points, which is made
smaller as Gilbert, Johnson and Keerthi (1988) do. A mesh counts with what its hull adds, unless it is divided.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from .balls import need
from .kernel import INSTANT, Motion
from .world import Piece, World

REACH = 5e-3 + 1e-6  # [m] of docs/jobs.md, and what two programs' roundings may add
ROUNDS = 100
Placed = tuple[Any, Any, Piece]  # a piece's rotation and place, and the piece


def check_reach(world: World, name: str, holding: tuple[str, ...]) -> None:
    """Reject unless each of the links that are to hold an object is close to it at the end of the motion."""
    count = float(len(world.control.mid))
    motion = Motion(world, np.array([[count - INSTANT, count]]))
    pieces = [x for x in world.pieces if x.name == name and x.kind != "link"]
    for link in holding:
        own = [x for x in world.pieces if x.name == link and x.kind == "link"]
        placed = ([_placed(motion, x) for x in each] for each in (own, pieces))
        near = min((between(a, b) for a, b in itertools.product(*placed)), default=np.inf)
        need(near <= REACH, f"'{link}' is to hold '{name}', and is not within {1e3 * REACH:.3g} mm of it")


def between(one: Placed, other: Placed) -> float:
    """A distance [m] that two pieces do not exceed: nearly theirs, and 0 if they meet."""

    def farthest(way: Any) -> Any:
        ends = []
        for (turn, at, piece), sign in zip((one, other), (1.0, -1.0), strict=True):
            local = turn.T @ (sign * way)
            size = np.sqrt(((piece.sweep * local) ** 2).sum())
            swept = piece.sweep**2 * local / size if size else np.zeros(3)
            ends.append(turn @ (piece.corners[np.argmax(piece.corners @ local)] + swept) + at)
        return ends[0] - ends[1]

    points = [farthest(np.array([1.0, 0.0, 0.0]))]
    best = points[0]
    for _ in range(ROUNDS):
        length = np.sqrt(best @ best)
        point = farthest(-best)
        if length < 1e-9 or best @ (best - point) <= 1e-9 * length:
            break
        points, best = _nearest([*points, point])
    return float(np.sqrt(best @ best))


def _placed(motion: Motion, piece: Piece) -> Placed:
    turn, at = motion.turn.mid[0, piece.joint], motion.at.mid[0, piece.joint]
    return turn @ piece.pose[0].mid, turn @ piece.pose[1].mid + at, piece


def _nearest(points: list[Any]) -> tuple[list[Any], Any]:
    """The points, of a few, between which the nearest to the origin lies, and that one: their mean with weights that
    are not negative."""
    found, best, least = points[:1], points[0], np.inf
    for count in range(1, min(len(points), 4) + 1):
        for some in itertools.combinations(points, count):
            rows = np.array(some)
            sides = rows[1:] - rows[0]
            weights = np.linalg.lstsq(sides.T, -rows[0], rcond=None)[0] if count > 1 else np.zeros(0)
            every = np.append(1.0 - weights.sum(), weights)
            if every.min() >= 0.0 and (length := float(((every @ rows) ** 2).sum())) < least:
                found, best, least = list(some), every @ rows, length
    return found, best
