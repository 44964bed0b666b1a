"""The problem in symbols as a function of its waypoints, and the same by the loops, for laws about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.symbolic_penalty import SymbolicPenalty
from hdplan.scenes.array_types import Array

ROUNDING = 1e-9  # relative to the largest number: the same sums in another order


@dataclass(frozen=True)
class WholeGraph:
    """Cost of x = the interior waypoints one after another (M n), and derivatives by CasADi."""

    x: ca.MX
    weight: ca.MX  # of the penalty, a parameter [1/m²]
    cost: ca.MX
    gradient: ca.MX  # (M n)
    hessian: ca.MX  # (M n, M n), banded


def whole_graph(problem: Problem) -> WholeGraph:
    """Write the smoothness and the penalty, with obstacles where they are."""
    n, count, penalty = len(problem.start), problem.waypoints - 2, SymbolicPenalty(problem, exact=True)
    x, weight = ca.MX.sym("x", n * count), ca.MX.sym("weight")
    waypoints = ca.horzcat(ca.DM(problem.start), ca.reshape(x, n, count), ca.DM(problem.goal))  # (n, N)
    smooth = ca.sum1(ca.sum2(waypoints * (waypoints @ ca.DM(problem.smoothness.matrix)))) / 2
    first, step = waypoints[:, :-1], waypoints[:, 1:] - waypoints[:, :-1]
    cost = smooth + weight * penalty(first, step, ca.MX(ca.DM(penalty.values({}))))
    hessian, gradient = ca.hessian(cost, x)
    return WholeGraph(x, weight, cost, gradient, hessian)


def motion(problem: Problem, rng: np.random.Generator, spread: float = 0.3) -> Array:
    line = np.linspace(problem.start, problem.goal, problem.waypoints)
    return np.clip(line + spread * rng.normal(size=line.shape), *problem.robot.inner)


def close(found: object, expected: Array, tolerance: float = ROUNDING) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(1e-9, float(np.abs(expected).max())))


def graph_of(problem: Problem, exact: bool = True, movable: bool = True) -> ca.Function:
    """The penalty of waypoints (n, N) and poses, its gradient and Hessian by all waypoints."""
    penalty = SymbolicPenalty(problem, exact, movable)
    n, count = len(problem.start), problem.waypoints
    x, poses = ca.MX.sym("x", n * count), ca.MX.sym("poses", penalty.size)
    waypoints = ca.reshape(x, n, count)
    value = penalty(waypoints[:, :-1], waypoints[:, 1:] - waypoints[:, :-1], poses)
    hessian, gradient = ca.hessian(value, x)
    return ca.Function("graph", [x, poses], [value, gradient, hessian])


def loops_at(problem: Problem, positions: Array, exact: bool = True) -> tuple[float, Array, Array]:
    """The same by the loops."""
    found = problem.penalty(positions)
    diagonal, coupling = found.diagonal, found.coupling
    if exact:
        second_order = problem.second_order(positions)
        diagonal, coupling = diagonal + second_order[0], coupling + second_order[1]
    return found.cost, found.gradient.ravel(), whole_matrix(diagonal, coupling)


def whole_matrix(diagonal: Array, coupling: Array) -> Array:
    """Symmetric matrix (N n, N n) with blocks (N, n, n) on its diagonal and (N − 1, n, n) below them."""
    count, n = diagonal.shape[:2]
    whole, k = np.zeros((count, n, count, n)), np.arange(count)
    whole[k, :, k] = diagonal
    whole[k[1:], :, k[:-1]], whole[k[:-1], :, k[1:]] = coupling, coupling.swapaxes(1, 2)
    return whole.reshape(count * n, count * n)


def agreed(found: Sequence[ca.DM], expected: tuple[float, Array, Array]) -> None:
    """Hold a graph's value, gradient and Hessian to the loops'."""
    value, gradient, hessian = (np.array(part) for part in found)
    assert float(value[0, 0]) == pytest.approx(expected[0], rel=ROUNDING, abs=1e-18)
    close(gradient.ravel(), expected[1])
    close(hessian, expected[2])
