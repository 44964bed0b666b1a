"""The end of a run of Ipopt or fatrop, neither of which Python can interrupt, and what is kept of it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable

import pytest

from hdplan.planner.build import build
from hdplan.planner.kinematics.forward import Kinematics
from hdplan.planner.plan import plan
from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.terms import MotionPenalty, Term
from hdplan.planner.solvers import solve
from hdplan.planner.solvers.interior_point import RUN_STEPS
from hdplan.planner.solvers.solution import FIRST_WEIGHT, Budget, Solution, SolverStatus
from hdplan.scenes.array_types import Array
from hdplan.scenes.yaml_format.reader import load_scene

each = pytest.mark.parametrize("solver", ["ipopt", "fatrop"])


class Watched(Term):
    """A term that costs nothing and sees every evaluation."""

    name = "watched"

    def __init__(self, seen: Callable[[int], None]) -> None:
        self.seen, self.count = seen, 0

    def over_motion(self, positions: Array, kinematics: Kinematics) -> MotionPenalty | None:
        self.count += 1
        self.seen(self.count)
        return None


def nothing(count: int) -> None:
    pass


@pytest.fixture(scope="module")
def cage() -> Problem:
    return build(load_scene("panda_cage"))


def better(problem: Problem, solution: Solution) -> bool:
    """True if a motion beats the straight line that it began with, at the weight of its one step."""
    weight = solution.steps[0].weight
    found = problem.evaluate(solution.trajectory.positions, weight).cost
    return found < problem.evaluate(problem.polyline(), weight).cost


@each
@pytest.mark.usefixtures("ctrl_c_is_heard")
@pytest.mark.parametrize("how", ["stop", "deadline", "Ctrl-C"])
def test_an_end_within_the_first_run_keeps_what_was_found(cage: Problem, solver: str, how: str) -> None:
    """After it nothing is evaluated for the run any more: one evaluation judges the motion."""
    at = 5
    ended: list[float] = []

    def seen(count: int) -> None:
        if count == at and how == "Ctrl-C":
            os.kill(os.getpid(), signal.SIGINT)
        if count == at and how == "deadline":
            time.sleep(max(0.0, ended[0] - time.perf_counter()))

    watched = Watched(seen)
    problem = cage.with_term(watched)
    ended.append(time.perf_counter() + 0.5 if how == "deadline" else float("inf"))
    stop = (lambda: watched.count >= at) if how == "stop" else (lambda: False)
    solution = solve(problem, solver=solver, budget=Budget(deadline=ended[0], stop=stop))
    assert watched.count <= at + 2, "the run goes on at most for the evaluation under way"
    assert solution.status is (SolverStatus.TIME if how == "deadline" else SolverStatus.INTERRUPTED)
    assert len(solution.steps) == 1
    assert better(cage, solution)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@each
def test_an_error_in_a_term_is_raised_as_it_is(cage: Problem, solver: str) -> None:
    """CasADi takes it for a point where the function is not defined; nothing is made of such a run."""

    def seen(count: int) -> None:
        if count >= 4:
            raise ZeroDivisionError("the term's own words")

    with pytest.raises(ZeroDivisionError, match="the term's own words"):
        solve(cage.with_term(Watched(seen)), solver=solver)


@each
def test_a_run_takes_few_evaluations(cage: Problem, solver: str) -> None:
    """One for each step and each try of the line search: cost, gradient and Hessian share it."""
    watched = Watched(nothing)
    solution = solve(cage.with_term(watched), solver=solver, budget=Budget(iterations=1, first_weight=FIRST_WEIGHT))
    assert len(solution.steps) == 1
    assert RUN_STEPS <= watched.count <= 3 * RUN_STEPS


@pytest.mark.sampled(3)
@each
@pytest.mark.parametrize("name", ["planar_arm", "panda_corridor", "panda_cup", "panda_conveyor", "panda_heavy"])
def test_scenes_with_every_kind_of_term_are_certified(name: str, solver: str) -> None:
    result = plan(load_scene(name), solver=solver, time_limit=60.0)
    assert result.certified, result.certificate.text
