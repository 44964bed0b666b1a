"""The last touches to a path, before its certificate: the first round of `polish` where smoothness is the objective.

A first motion keeps more distance than it needs, and its solver stops early. To solve on from it, with a penalty that
sets in closer to obstacles, takes half as long as the certificate; so what comes of it is certified in its place, and
the first motion only if that fails. A warm start has had this already, so it begins there. Where a path costs far more
than the straight line, the solver may have jumped into a wide detour at its first steps: CHOMP's small steps from the
straight line are a second opinion. Where the straight line led to none before, neither do they.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from hdplan.planner.problem.assemble import closer
from hdplan.planner.problem.problem import Problem
from hdplan.planner.solvers.methods import chomp
from hdplan.planner.solvers.solution import DETOUR_WEIGHT, FIRST_WEIGHT, Budget, Solution, Solver, SolverStatus
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.search.search import Search

CLOSER = 0.7  # of the activation: at 0.3 a motion costs 0.5 to 5 % less, and passes 4 to 8 mm closer
CLOSEST = 0.2  # of it, where time counts, as at the end of `polish`: with more, the last motion would be slower
CONVERGED = 1e-3  # relative decrease of the cost by a step
NOTHING_LEFT = 0.02  # of the objective to be gained: a motion so close to the least possible is good enough
WIDE = 0.3  # of the least cost: what costs more than it by this share may be a detour
GENTLE_STEPS = 70  # of the second opinion, at most


def touched(search: Search, solution: Solution) -> Solution | None:
    """Return a better solution than the one that an attempt led to, all of whose samples keep their distance; None if
    there is none."""
    problem, cost = search.problem, search.objective.least_along
    least, before = search.objective.least(problem), cost(solution.trajectory.positions)
    if solution.status is not SolverStatus.CLEAR or before <= (1.0 + NOTHING_LEFT) * least:
        return None
    near, wide = closer(problem, CLOSER * problem.scene.planner.activation, quick=False), (1.0 + WIDE) * least

    def nearer(clear: Solution) -> Solution | None:
        weight = DETOUR_WEIGHT if cost(clear.trajectory.positions) <= wide else FIRST_WEIGHT
        return search.clear(near, clear.trajectory.positions, weight, CONVERGED)

    first = nearer(solution)
    found, best = [first], cost((first or solution).trajectory.positions)
    reconsidered = min(before, best) > wide and search.attempts == 1
    if reconsidered and (gently := search.clear(problem, problem.polyline(), FIRST_WEIGHT, solver=GENTLE)):
        found += [gently, nearer(gently)]
    better = min(filter(None, found), key=lambda each: cost(each.trajectory.positions), default=solution)
    return better if cost(better.trajectory.positions) < before else None


def once_more(search: Search, path: Array) -> Solution | None:
    """Return what the last motion (N, n), which was bettered when it was planned, leads to in a scene that changed a
    little; None if it is not clear."""
    problem, quick = search.problem, search.objective.name == "time"
    near = closer(problem, (CLOSEST if quick else CLOSER) * problem.scene.planner.activation, quick)
    return search.clear(near, path, DETOUR_WEIGHT, CONVERGED)


def _gently(problem: Problem, guess: Array, budget: Budget) -> Solution:
    return chomp.solve(problem, guess, replace(budget, iterations=GENTLE_STEPS))


GENTLE = Solver(_gently)
