"""The guesses of a search, in the order in which they are tried: the straight line, the roadmap's ways, and where these
keep failing by contacts, exact distances, which take longer, and trees of free lines.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from hdplan.planner.problem.assemble import exactly
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.idle_core import IdleCore
from hdplan.planner.search.roadmap import seeds
from hdplan.planner.search.tree_ways import tree_ways
from hdplan.planner.solvers.solution import DETOUR_WEIGHT, FIRST_WEIGHT, ends_overlap
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.search.search import Search

GUESSES = 3  # first guesses for a goal before the next goal's turn
TREES_AFTER_TIGHT = 2  # guesses before the trees' turn where bodies overlap at an end
TREES_AFTER_LOOSE = 4  # guesses before the trees' turn elsewhere
AHEAD_AFTER = 2  # guesses that failed before trees begin to grow on an idle core; one where bodies overlap at an end
EXACT_AFTER = 6  # guesses after these before exact distances have their turn, where bodies are free at both ends


class Guess(NamedTuple):
    """The beginning of an attempt."""

    positions: Array  # (N, n)
    weight: float = DETOUR_WEIGHT  # first weight of the penalty [1/m²]
    as_it_is: bool = False  # whether it may be the motion itself
    last: float = math.inf  # cost of the motion that it continues, if it is a warm start
    way: Array | None = None  # (C, n) what it goes along more finely, which may be the motion itself, timed or not


def search_in_turn(
    searches: Sequence[Search], seed: int, warm: Sequence[Guess | None], failed: Callable[[], None] = lambda: None
) -> None:
    """Give each goal its first guesses, then each its next ones, until one is certified after a whole round or time is
    up. A goal is passed over to which no motion can be better than a certified one to another: none would be chosen.
    `warm` holds a guess per goal, or None, that is tried before all others; where it leads to a motion like the one
    that it comes from, there is no need for any. `failed` is called where guesses led to none."""
    with IdleCore(max(search.deadline for search in searches)) as core:
        lines = [(search, _guesses(search, seed, begin, core)) for search, begin in zip(searches, warm, strict=True)]
        lines.sort(key=lambda line: warm[searches.index(line[0])] is None)
        while not any(search.certified for search in searches):
            for search, guesses in lines:
                value = min((other.value for other in searches if other.certified), default=math.inf)
                if value < search.objective.least(search.problem):
                    continue
                over = any(search.attempt(guess, value) for guess in itertools.islice(guesses, GUESSES))
                if search.settled or (over and not search.certified and not search.passed):
                    return
                if not search.certified:
                    failed()


def _guesses(search: Search, seed: int, warm: Guess | None, core: IdleCore) -> Iterator[Guess]:
    """Yield guesses without end: the given one, if any, the straight line, then the roadmap's. Where they keep failing
    by contacts, or by path constraints, trees of lines that are free by exact distances grow in turn with further
    guesses, and what they find is a motion already. Guesses are solved with exact distances, too, from the straight
    line again: where bodies overlap at an end, these alone, else, as the HD-SDF has no kinks, after EXACT_AFTER more,
    and in turn."""
    if warm is not None:
        yield warm
    problem, ways = search.problem, seeds(search.problem, seed)
    yield Guess(next(ways), FIRST_WEIGHT, as_it_is=True)
    if search.problem is not problem:
        ways = itertools.islice(seeds(search.problem, seed), 1, None)
    loose, overlap = search.problem, ends_overlap(search.problem)
    tightly = functools.cache(lambda: exactly(loose))
    grown = core.ahead(lambda over: _tree_guesses(tightly(), search.required, seed, over), lambda: search.over)
    for turn in range(1, TREES_AFTER_TIGHT if overlap else TREES_AFTER_LOOSE):
        if (overlap or turn >= AHEAD_AFTER) and search.is_tight:
            grown.begin()
        yield Guess(next(ways))
    exact = tightly() if search.is_tight else loose
    if exact is loose:
        yield from map(Guess, ways)
    exactly_so = _exact_guesses(exact, seed)
    for turn in itertools.count():
        search.problem = exact
        if (guess := grown.take()) is not None:
            yield guess
        if overlap or turn >= EXACT_AFTER:
            yield next(exactly_so)
        if not overlap:
            search.problem = loose
            yield Guess(next(ways))


def _tree_guesses(problem: Problem, required: float, seed: int, over: Callable[[], bool]) -> Iterator[Guess | None]:
    """Yield the ways of trees of free lines in a problem with exact distances, and None while they grow."""
    if problem.terms.path:
        from hdplan.planner.search.held_trees import held_ways  # imported here, as few scenes have path constraints

        for way in held_ways(problem, required, seed, over):
            yield None if way is None else Guess(problem.polyline(way[1:-1]), way=way)
    for way in tree_ways(problem, required, seed, over):
        yield None if way is None else Guess(way, as_it_is=True)


def _exact_guesses(problem: Problem, seed: int) -> Iterator[Guess]:
    ways = seeds(problem, seed)
    yield Guess(next(ways), FIRST_WEIGHT)
    yield from map(Guess, ways)
