"""The whole problem as one CasADi graph: for general solvers, and as a second witness of the fast evaluation.

The same kinematics, the same distance functions, the same pairs and samples as `Problem.evaluate`, but every pair at
every sample is there, without a broad phase. The gradient is the distance's hand-written wrench chained through the
geometric Jacobian; the Hessian is CasADi's exact derivative of that gradient.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hdplan.planner.hdsdf_pairs import HdsdfPairs
from hdplan.planner.problem import Problem
from hdplan.planner.swept_clearance import SweptClearance
from hdplan.planner.terms import Clearance
from hdplan.scenes.errors import InputError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Nlp:
    """Cost of x = the interior waypoints one after another (M n), bounds, and derivatives. No constraints beside the
    bounds."""

    x: ca.MX
    weight: ca.MX  # of the penalty, a parameter [1/m²]
    cost: ca.MX
    gradient: ca.MX  # (M n)
    hessian: ca.MX  # (M n, M n), banded
    lower: Floats  # (M n)
    upper: Floats  # (M n)


def nlp(problem: Problem) -> Nlp:
    """Write the problem as CasADi expressions."""
    n, count = len(problem.start), problem.waypoints - 2
    samples = problem.samples
    x, weight = ca.MX.sym("x", n * count), ca.MX.sym("weight")
    waypoints = ca.horzcat(ca.DM(problem.start), ca.reshape(x, n, count), ca.DM(problem.goal))  # (n, N)
    spread = _interpolation(problem)  # (N, B)
    looks = waypoints @ spread  # (n, B)
    matrix = ca.DM(problem.smoothness.matrix)
    cost: ca.MX = 0.5 * ca.sum1(ca.sum2(waypoints * (waypoints @ matrix)))
    gradient = waypoints @ matrix
    hessian = ca.MX(ca.kron(matrix[1:-1, 1:-1], ca.DM.eye(n)))
    to_interior = ca.kron(spread[1:-1, :], ca.DM.eye(n))  # (M n, B n)
    for term in problem.pair_terms:
        value, slope, curvature = (function.map(len(samples.weight)) for function in _sample_functions(problem, term))
        scale = weight * ca.DM(samples.weight)
        cost += ca.dot(scale, value(looks).T)
        gradient += (slope(looks) @ ca.diag(scale)) @ spread.T
        blocks = ca.horzsplit(curvature(looks), n)
        hessian += to_interior @ ca.diagcat(*(scale[s] * block for s, block in enumerate(blocks))) @ to_interior.T
    lower, upper = np.tile(problem.robot.lower, count), np.tile(problem.robot.upper, count)
    return Nlp(x, weight, cost, ca.vec(gradient[:, 1:-1]), hessian, lower, upper)


def _interpolation(problem: Problem) -> ca.DM:
    """The matrix (N, B) that takes waypoints to samples."""
    samples = problem.samples
    columns = np.arange(len(samples.weight))
    dense = np.zeros((problem.waypoints, len(columns)))
    dense[samples.interval, columns] = 1 - samples.fraction
    dense[samples.interval + 1, columns] += samples.fraction
    return ca.sparsify(ca.DM(dense))


def _sample_functions(problem: Problem, term: Clearance) -> tuple[ca.Function, ca.Function, ca.Function]:
    """One sample's penalty ½ Σ_pairs min(D, 0)² as functions of its configuration: value, gradient (n, 1), Hessian
    (n, n)."""
    n, pairs, nj = len(problem.start), term.pairs, problem.kinematics.nj
    q = ca.MX.sym("q", n)
    state = problem.kinematics.state(q)
    placements, columns = ca.reshape(state[: 12 * nj], 12, nj), ca.reshape(state[12 * nj :], 6, n)
    value, gradient = ca.MX(0), ca.MX.zeros(n)
    if isinstance(term, SweptClearance):
        raise InputError("solver ipopt: needs exact second derivatives, which planner.swept: true does not have")
    if not isinstance(term.distance, HdsdfPairs):
        raise InputError(f"solver ipopt: needs exact second derivatives, which {term.distance.how} does not have")
    for slots, kernel in term.distance.kernels.items():
        chosen = np.flatnonzero(pairs.plane_slots == slots)
        if len(chosen) == 0:
            continue
        # straight-line code: the interpreter differentiates it faster than loops
        distance, wrench, _ = kernel.function.expand().map(len(chosen))(
            placements[:, pairs.joint_a[chosen].tolist()],
            placements[:, pairs.joint_b[chosen].tolist()],
            ca.DM(pairs.body_table[pairs.body[chosen]].T),
            ca.DM(pairs.plane_tables[slots][pairs.plane_row[chosen]].T),
        )
        depth = ca.fmin(distance, 0)
        value += 0.5 * ca.dot(depth, depth)
        gradient += ca.sum2((columns.T @ wrench) * ca.DM(pairs.moves[chosen].T) * ca.repmat(depth, n, 1))
    return (
        ca.Function("penalty", [q], [value]),
        ca.Function("penalty_gradient", [q], [gradient]),
        ca.Function("penalty_hessian", [q], [ca.jacobian(gradient, q)]),
    )
