"""The witness of the fast evaluation: the whole problem as one CasADi graph, with exact Hessians.

It has the same kinematics, distance functions, pairs and samples as `Problem.evaluate`, but every pair at every sample,
without a broad phase, loops of C or sums into a band. Gradient and Hessian are closed forms: the distance's own,
chained through the geometric Jacobian. It knows the clearance terms only, and is far too slow to solve with.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from hdplan.distance.symbolic.graph_distance import CLOSED
from hdplan.distance.symbolic.halfspaces import halfspace_distance
from hdplan.planner.collision.hdsdf import HdsdfPairs
from hdplan.planner.problem.clearance import Clearance, PairTerm
from hdplan.planner.problem.problem import Problem


@dataclass(frozen=True)
class WholeGraph:
    """Cost of x = the interior waypoints one after another (M n), and derivatives."""

    x: ca.MX
    weight: ca.MX  # of the penalty, a parameter [1/m²]
    cost: ca.MX
    gradient: ca.MX  # (M n)
    hessian: ca.MX  # (M n, M n), banded


def whole_graph(problem: Problem) -> WholeGraph:
    """Write the problem as CasADi expressions."""
    assert all(type(term) is Clearance for term in problem.terms), "it knows no other term"
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
    scale, unused = weight * ca.DM(samples.weight), (ca.DM(1, len(samples.weight)), ca.DM(1, n * len(samples.weight)))
    for term in problem.terms.pairs:
        value, slope, curvature = (function.map(len(samples.weight)) for function in _sample_functions(problem, term))
        cost += ca.dot(scale, value(looks).T)
        gradient += (ca.reshape(slope(looks, unused[0]), n, -1) @ ca.diag(scale)) @ spread.T
        blocks = ca.horzsplit(curvature(looks, *unused)[0], n)
        hessian += to_interior @ ca.diagcat(*(scale[s] * block for s, block in enumerate(blocks))) @ to_interior.T
    return WholeGraph(x, weight, cost, ca.vec(gradient[:, 1:-1]), hessian)


def _interpolation(problem: Problem) -> ca.DM:
    """The matrix (N, B) that takes waypoints to samples."""
    samples = problem.samples
    columns = np.arange(len(samples.weight))
    dense = np.zeros((problem.waypoints, len(columns)))
    dense[samples.interval, columns] = 1 - samples.fraction
    dense[samples.interval + 1, columns] += samples.fraction
    return ca.sparsify(ca.DM(dense))


def _sample_functions(problem: Problem, term: PairTerm) -> tuple[ca.Function, ca.Function, ca.Function]:
    """One sample's penalty ½ Σ_pairs min(D, 0)² as functions of its configuration: value, gradient (1, n), Hessian
    (n, n). CasADi too knows each as the derivative of the one before, and refuses a third."""
    settings = term.distance
    assert isinstance(settings, HdsdfPairs)
    n, pairs, kinematics = len(problem.start), term.pairs, problem.kinematics
    q = ca.MX.sym("q", n)
    state = kinematics.state(q)
    moved = 12 * kinematics.nj
    placements, columns = ca.reshape(state[:moved], 12, kinematics.nj), ca.reshape(state[moved:], 6, n)
    value, gradient, hessian = ca.MX(0), ca.MX.zeros(n), ca.MX.zeros(n * n)
    for planes in sorted(set(pairs.plane_slots.tolist())):
        chosen = np.flatnonzero(pairs.plane_slots == planes)
        joint_a, joint_b = pairs.joint_a[chosen], pairs.joint_b[chosen]
        given = (
            placements[:, joint_a.tolist()],
            placements[:, joint_b.tolist()],
            ca.DM(pairs.body_table[pairs.body[chosen]].T),
            ca.DM(pairs.plane_tables[planes][pairs.plane_row[chosen]].T),
            ca.repmat(columns, 1, len(chosen)),
            ca.DM(pairs.moves[chosen].T),
            ca.DM((kinematics.supports[joint_a].astype(float) + kinematics.supports[joint_b]).T),
        )
        first, second = (
            _pair_penalty(
                halfspace_distance(pairs.vertex_slots, planes, settings.gamma, settings.shaping_length, order), n
            ).map(len(chosen))  # each pair in straight-line code
            for order in (1, 2)
        )
        values, gradients = first(*given)
        value += ca.sum2(values)
        gradient += ca.sum2(gradients)
        hessian += ca.sum2(ca.reshape(second(*given)[2], n * n, len(chosen)))
    unused = ca.MX.sym("penalty"), ca.MX.sym("gradient", 1, n)  # CasADi hands a Jacobian the outputs too
    curvature = ca.Function(
        "jac_jac_penalty", [q, *unused], [ca.reshape(hessian, n, n), ca.MX(n, 1)], CLOSED | {"enable_jacobian": False}
    )
    slope = ca.Function("jac_penalty", [q, unused[0]], [gradient.T], CLOSED | {"custom_jacobian": curvature})
    penalty = ca.Function("penalty", [q], [value], CLOSED | {"custom_jacobian": slope})
    return penalty, slope, curvature


def _pair_penalty(distance: ca.Function, n: int) -> ca.Function:
    """One pair's penalty ½ min(D, 0)² with its gradient and, where `distance` gives that of D, its Hessian, in closed
    form: CasADi must not differentiate `halfspace_distance`.

    With the joints' screws S_j in the world, m_j = 1, −1 or 0 as joint j moves A only, B only or both (or neither), c_j
    the number of the two bodies that it carries, and w, H the derivatives of D with respect to a motion of A in the
    world:

        ∂D/∂q_j = m_j w·S_j        ∂²D/∂q_j∂q_k = m_j m_k S_j·H S_k + ½ m_j c_k w·[S_j, S_k],   j nearer the base than k
    """
    inputs = [ca.SX.sym(distance.name_in(i), distance.size1_in(i)) for i in range(4)]
    screws, moves, carried = ca.SX.sym("screws", 6, n), ca.SX.sym("moves", n), ca.SX.sym("carried", n)
    value, wrench, _, *second = distance(*inputs)
    depth, relative = ca.fmin(value, 0), screws * ca.repmat(moves.T, 6, 1)
    slope = relative.T @ wrench
    results = [depth * depth / 2, depth * slope]
    for (
        hessian
    ) in second:  # joints come in the order of the tree; for those of two branches either order gives the same
        force, torque = ca.skew(wrench[:3]), ca.skew(wrench[3:])
        bracket = -ca.blockcat([[ca.SX(3, 3), force], [force, torque]])  # w·[S, S'] = S·bracket S'
        turned = ca.triu(relative.T @ bracket @ (screws * ca.repmat(carried.T, 6, 1)), False) / 2
        curvature = relative.T @ hessian @ relative + turned + turned.T
        results.append(ca.densify((value < 0) * slope @ slope.T + depth * curvature))
    return ca.Function("pair_penalty", [*inputs, screws, moves, carried], [ca.densify(part) for part in results])
