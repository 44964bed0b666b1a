"""The last touches to a path, before its certificate: the first round of `polish` where smoothness is the objective.

A first motion keeps more distance than it needs, and its solver stops early. To solve on from it, with a penalty that
sets in closer to obstacles, takes half as long as the certificate; so what comes of it is certified in its place, and
the first motion only if that fails. A warm start has had this already, so it begins there. Where a path costs far more
than the straight line, the solver may have jumped into a wide detour at its first steps: CHOMP's small steps from the
straight line are a second opinion, once in a search, the more of them the more the path costs; not in narrow places,
where more guesses failed: in five of seven cages they found nothing, in as much time as all the rest took. What they
lead to is solved on from, too; where they get stuck, it may be free nonetheless, as the bodies are larger than the
links.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from hdplan.planner.problem.assemble import closer
from hdplan.planner.solvers.methods import chomp
from hdplan.planner.solvers.solution import DETOUR_WEIGHT, FIRST_WEIGHT, RAISE, Solution, Solver, SolverStatus
from hdplan.scenes.array_types import Array

if TYPE_CHECKING:
    from hdplan.planner.search.search import Search

CLOSER_ACTIVATION = 0.7  # of the activation: at 0.3 a motion costs 0.5 to 5 % less, and passes 4 to 8 mm closer
CLOSEST_SHARE = 0.2  # of it, where time counts, as at the end of `polish`: with more, the last motion would be slower
CONVERGED = 2e-3  # relative decrease of the cost by a step
NOTHING_LEFT = 0.02  # of the objective to be gained: a motion so close to the least possible is good enough
DETOUR_COST_SHARE = 0.3  # of the least cost: what costs more than it by this share may be a detour
RELAXED_WEIGHT = (
    RAISE * FIRST_WEIGHT
)  # of the penalty, first, for what is no detour: with more it keeps farther away [1/m²]
OPEN_GUESSES = 2  # guesses within which a place that is not narrow leads to a motion
GENTLE_STEPS, MOST_STEPS = 60, 400  # of the second opinion, for each time that a path costs the least; at most


def touched(search: Search, solution: Solution) -> Sequence[Solution] | None:
    """Return the motions that cost less than an attempt's solution, the smoothest first: solutions all of whose
    samples keep their distance, and the results of CHOMP's steps. None if there is more to gain, but not found."""
    problem, cost = search.problem, search.objective.least_along
    least, before = search.objective.least(problem), cost(solution.trajectory.positions)
    if solution.status is not SolverStatus.CLEAR or before <= (1.0 + NOTHING_LEFT) * least:
        return None
    near, wide = (
        closer(problem, CLOSER_ACTIVATION * problem.scene.planner.activation, quick=False),
        (1.0 + DETOUR_COST_SHARE) * least,
    )

    def nearer(begin: Solution) -> Solution | None:
        path = begin.trajectory.positions
        return search.clear(near, path, FIRST_WEIGHT if cost(path) > wide else RELAXED_WEIGHT, CONVERGED)

    first = nearer(solution)
    found, best = [first], cost((first or solution).trajectory.positions)
    if min(before, best) > wide and not search.reconsidered and search.attempts <= OPEN_GUESSES:
        search.reconsidered = True
        times = min(before, best) / least if least > 0.0 else 1.0
        gently = search.tried(problem, problem.polyline(), FIRST_WEIGHT, solver=gentle(times * GENTLE_STEPS))
        if gently.status in (SolverStatus.CLEAR, SolverStatus.ITERATIONS):
            found.append(nearer(gently))
        if gently.status in (SolverStatus.CLEAR, SolverStatus.STALLED):
            found.append(gently)
    better = [each for each in found if each and cost(each.trajectory.positions) < before]
    if not better and (first is None or before > wide):
        return None
    return sorted(better, key=lambda each: cost(each.trajectory.positions))


def once_more(search: Search, path: Array) -> Solution | None:
    """Return the result of the last motion (N, n), already improved, in a scene that changed a little; None if it is
    not clear."""
    problem, quick = search.problem, search.objective.name == "time"
    near = closer(problem, (CLOSEST_SHARE if quick else CLOSER_ACTIVATION) * problem.scene.planner.activation, quick)
    return search.clear(near, path, DETOUR_WEIGHT, CONVERGED)


def gentle(steps: float) -> Solver:
    """CHOMP, for so many steps, but MOST_STEPS at most."""
    most = round(min(steps, MOST_STEPS))  # of what costs nothing along the straight line, without end
    return Solver(lambda problem, guess, budget: chomp.solve(problem, guess, replace(budget, iterations=most)))
