"""Ways with fewer corners, and as waypoints."""

from __future__ import annotations

import itertools

import numpy as np

from hdplan.distance.compiled.loops import Record
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.free_space import is_free
from hdplan.scenes.array_types import Array, Rows

SHORTCUTS = 24  # lines that are tried between two places of a way


def shortened(space: Record, way: Array, rng: np.random.Generator) -> Array:
    """Return a way (C, n) with fewer corners: past as many as a free straight line leads, and by such lines between
    random places of it."""
    way = past_corners(space, way)
    for _ in range(SHORTCUTS):
        length = lengths(way)
        places = np.sort(rng.uniform(0.0, length[-1], 2))
        first, last = (np.searchsorted(length, places, side="right") - 1).tolist()
        ends = at(way, length, places)
        if first < last and is_free(space, *ends):
            way = np.vstack([way[: first + 1], ends, way[last + 1 :]])
    return past_corners(space, way)


def past_corners(space: Record, way: Array) -> Array:
    """Return a way that goes from each corner to one far ahead, by half as many each time that the line is not free."""
    kept, ahead = [0], len(way) - 1
    while kept[-1] < len(way) - 1:
        ahead = min(ahead, len(way) - 1 - kept[-1])
        while ahead > 1 and not is_free(space, way[kept[-1]], way[kept[-1] + ahead]):
            ahead //= 2
        kept.append(kept[-1] + ahead)
        ahead = 4 * ahead
    return way[kept]


def lengths(way: Array) -> Array:
    """Length along a way (C, n) to each of its corners (C,)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1)))


def at(way: Array, length: Array, places: Array) -> Array:
    """The configurations (P, n) at places (P,) along a way (C, n) whose corners are so far along it (C,)."""
    return np.stack([np.interp(places, length, column) for column in way.T], axis=1)


def through(problem: Problem, way: Array) -> Array:
    """Return a way (C, n) as waypoints (N, n), its corners among them, the more on a line the longer it is; at equal
    steps where there are more corners than waypoints."""
    spare = problem.waypoints - len(way)
    if spare < 0:
        return problem.polyline(way[1:-1])
    length = np.linalg.norm(np.diff(way, axis=0), axis=1)
    ends = np.round(np.cumsum(length) / length.sum() * spare).astype(np.int64)
    return problem.clip(cut(way, 1 + np.diff(ends, prepend=0)))


def cut(way: Array, parts: Rows) -> Array:
    """Return a way (C, n) whose lines are cut into so many equal parts (C − 1,)."""
    lines = zip(itertools.pairwise(way), parts.tolist(), strict=True)
    rows = [first + np.arange(count)[:, None] / count * (last - first) for (first, last), count in lines]
    return np.vstack([*rows, way[-1:]])
