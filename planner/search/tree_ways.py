"""Ways through narrow places by two trees of free lines, with fewer corners.

One seeded generator makes all random draws: the same seed gives the same ways. Without a C compiler there are none, and
the roadmap's guesses have to do.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.arms import Arms
from hdplan.planner.search.corners import shortened, through
from hdplan.planner.search.escape import ways_back
from hdplan.planner.search.free_space import free_part, free_space
from hdplan.planner.search.trees import Trees
from hdplan.scenes.array_types import Array

TARGETS_PER_TURN = 128  # targets of the trees, before another guess has its turn


def tree_ways(
    problem: Problem, required: float, seed: int, over: Callable[[], bool] = lambda: False
) -> Iterator[Array | None]:
    """Yield a way (N, n) as waypoints of a problem with exact distances, each time that two trees meet, and None after
    each TARGETS_PER_TURN targets by which they did not, or once it is over. None at all where there is no free space to
    be had, and on path constraints, which have trees of their own (`held_trees`)."""
    space = free_space(problem, required)
    if space is None or problem.terms.path:
        return
    roots = [free_part(space, way) for way in ways_back(problem)]
    for again in itertools.count():
        rng = np.random.default_rng((seed, again))
        arms = Arms(problem, space, rng, roots)
        trees = Trees(problem, space, rng, roots, arms.draw)
        while True:
            arms.grow(TARGETS_PER_TURN, over)
            if (way := trees.grow(TARGETS_PER_TURN, over)) is not None:
                break
            yield None
        yield through(problem, shortened(space, way, rng))
