"""Better motions after the first certified one, in rounds: each changes something, and its motion is kept only if it is
certified and better.

Better is less of what `Scene.objective` asks for (`objective`). Rounds take turns:

* *nearer*: the penalty sets in at half the distance from obstacles, and solving continues from the motion as it is,
  which becomes straighter. After a failure the distance stays.
* *another way*: the next guess of the roadmap, to each goal in turn, at the distance reached so far: perhaps there is a
  better way around an obstacle, or a better goal.

Rounds are counted, not timed, so that the same seed gives the same motion on every machine.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence

from hdplan.planner.problem.lay_out import with_activation
from hdplan.planner.problem.problem import Problem
from hdplan.planner.search.roadmap import seeds
from hdplan.planner.search.search import Guess, Search
from hdplan.planner.solvers.solution import FIRST_WEIGHT

CLOSER = 0.5  # factor on the activation
LEAST = 1e-3  # [m] of the activation


def polish(searches: Sequence[Search], taken: int, rounds: int, seed: int) -> None:
    """Better the certified motion of search `taken`, one of several to different goals: the search with the best motion
    has another one then, or another search a better one."""

    @functools.cache
    def laid_out(i: int, activation: float) -> Problem:
        return with_activation(searches[i].problem, activation)

    activation = searches[taken].problem.scene.planner.activation
    ways, nearer = _ways(searches, seed), True
    for turn in range(rounds):
        best = searches[taken]
        assert best.best is not None
        if best.over:
            break
        if nearer and turn % 2 == 0 and activation * CLOSER >= LEAST:
            motion = best.best.solution.trajectory.positions
            nearer = best.improve(laid_out(taken, activation * CLOSER), Guess(motion), best.value)
            activation *= CLOSER if nearer else 1.0
        else:
            i, guess = next(ways)
            if searches[i].improve(laid_out(i, activation), guess, best.value):
                taken = i


def _ways(searches: Sequence[Search], seed: int) -> Iterator[tuple[int, Guess]]:
    """Yield a search and a guess for it, in turn, without end; the first guesses of untried goals come first."""
    ways = [seeds(search.problem, seed + 1) for search in searches]
    lines = [next(guesses) for guesses in ways]
    yield from ((i, Guess(line, FIRST_WEIGHT)) for i, line in enumerate(lines) if not searches[i].attempts)
    while True:
        yield from ((i, Guess(next(guesses))) for i, guesses in enumerate(ways))
