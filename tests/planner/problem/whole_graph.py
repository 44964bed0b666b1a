"""The problem in symbols as a function of its waypoints alone, for laws about it."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from hdplan.planner.problem.problem import Problem
from hdplan.planner.problem.symbolic_penalty import SymbolicPenalty


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
