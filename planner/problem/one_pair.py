"""One pair of bodies in symbols: ½ min(D, 0)² and its derivatives.

Each is a Function of three steps that are real branches in generated code. A ball around the link body that does not
reach the enlarged box of the other; a plane of the enlarged body that separates them; the distance. The first two prove
D > 0, as they do in the broad phase of the loops (`broad_phase`).

With S_j the joints' screws in the world, m_j = 1, −1 or 0 as joint j moves A only, B only or both (or neither), c_j the
number of the two bodies that it carries, w and H the derivatives of D by a motion of A, η the motion of B's frame:

    ∂²D/∂q_j∂q_k = m_j m_k S_j·H S_k + ½ m_j c_k w·[S_j, S_k],   j nearer the base than k
    ∂²D/∂q_j∂η = m_j S_j·(−H η + ½ [w·[·, η]])        ∂²D/∂η² = H

Of a body swept from one placement to another w and H are by both, and so are the joints: those at either end.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import casadi as ca

from hdplan.distance.symbolic.graph_distance import bracket
from hdplan.distance.symbolic.halfspaces import halfspace_distance, swept_halfspace_distance

UNBRANCHED = {"never_inline": True}  # a Function that stays one, so that it can be a branch


@functools.cache
def near(widest: float, ends: int) -> ca.Function:
    """Whether the ball around A, at all of its placements, reaches B's box: 1, or 0 where D is sure to be positive."""
    placed = [ca.SX.sym(f"placement_{k}", 12) for k in range(ends + 1)]
    ball_and_box = (("centre", 3), ("radius", 1), ("box", 12), ("half", 3))
    centre, radius, box, half = (ca.SX.sym(name, size) for name, size in ball_and_box)
    places = [_rotation(each) @ centre + each[9:] for each in placed[:-1]]
    middle = (places[0] + places[-1]) / 2
    reach = widest * (radius + ca.norm_2(places[-1] - places[0]) / 2 * (ends == 2))
    local = _rotation(placed[-1]).T @ (middle - placed[-1][9:])
    outside = ca.fmax(ca.fabs(_rotation(box).T @ (local - box[9:])) - half, 0)
    return ca.Function("near", [*placed, centre, radius, box, half], [ca.sumsqr(outside) < reach**2])


def _kernel(vertices: int, planes: int, gamma: int, shaping_length: float, ends: int, order: int) -> ca.Function:
    build = halfspace_distance if ends == 1 else swept_halfspace_distance
    return build(vertices, planes, gamma, shaping_length, order)


@functools.cache
def pair(vertices: int, planes: int, gamma: int, shaping_length: float, ends: int) -> ca.Function:
    """One pair's ½ min(D, 0)², given whether it is near, and its derivative by A's motions, as wrenches (6 e)."""
    kernel = _kernel(vertices, planes, gamma, shaping_length, ends, 1)
    given = kernel.mx_in()
    value, *wrenches = kernel(*given)[: ends + 1]
    depth = ca.fmin(value, 0)
    return _where_near("pair", given, [depth * depth / 2, depth * ca.vertcat(*wrenches)], vertices, planes, ends)


@functools.cache
def pair_bend(
    vertices: int, planes: int, gamma: int, shaping_length: float, ends: int, n: int, exact: bool
) -> ca.Function:
    """One pair's second derivatives: by the joints (n² of them, those at both ends for two), by the joints and the
    motion of B's frame (6 n), by the latter (36), and the derivative by it (6)."""
    kernel = _kernel(vertices, planes, gamma, shaping_length, ends, 2)
    given = kernel.mx_in()
    screws = [ca.MX.sym(f"screws{k}", 6, n) for k in range(ends)]
    moves, carried = ca.MX.sym("moves", n), ca.MX.sym("carried", n)
    value, *wrenches = (found := kernel(*given))[: ends + 1]
    results = _chained(ends, n, exact)(value, ca.vertcat(*wrenches), found[-1], ca.vertcat(*screws), moves, carried)
    return _where_near("pair_bend", [*given, *screws, moves, carried], list(results), vertices, planes, ends)


@functools.cache
def _chained(ends: int, n: int, exact: bool) -> ca.Function:
    """From D's derivatives by A's motions to those of ½ min(D, 0)² by joints and by B's motion."""
    value, wrench, hessian = (
        ca.MX.sym(*size) for size in (("value", 1), ("wrench", 6 * ends), ("hessian", 6 * ends, 6 * ends))
    )
    screws, moves, carried = ca.MX.sym("screws", 6 * ends, n), ca.MX.sym("moves", n), ca.MX.sym("carried", n)
    depth, inside = ca.fmin(value, 0), value < 0
    moved = [part * ca.repmat(moves.T, 6, 1) for part in ca.vertsplit(screws, 6)]
    parts = ca.vertsplit(wrench, 6)
    slope = ca.vertcat(*(part.T @ by for part, by in zip(moved, parts, strict=True)))
    push = -_sum(parts)
    results = [(inside * slope) @ slope.T, (inside * slope) @ push.T, (inside * push) @ push.T, depth * push]
    if exact:
        turns = [-bracket(part) for part in parts]
        blocks = [ca.horzsplit(row, 6) for row in ca.vertsplit(hessian, 6)]
        rows = [_sum(row) for row in blocks]  # by B's motion, but for its sign
        curved = [
            [one.T @ block @ other for block, other in zip(row, moved, strict=True)]
            for row, one in zip(blocks, moved, strict=True)
        ]
        for i, (part, turn, whole) in enumerate(zip(moved, turns, ca.vertsplit(screws, 6), strict=True)):
            upper = ca.triu(
                part.T @ (turn @ (whole * ca.repmat(carried.T, 6, 1))), False
            )  # joints are in the tree's order
            curved[i][i] += ca.densify(upper + upper.T)
        results[0] += depth * ca.blockcat(curved)
        results[1] += depth * ca.vertcat(
            *(part.T @ (turn - row) for part, turn, row in zip(moved, turns, rows, strict=True))
        )
        results[2] += depth * _sum(rows)
    flat = [ca.vec(ca.densify(part)) for part in results]
    return ca.Function("chained", [value, wrench, hessian, screws, moves, carried], flat)


def _where_near(
    name: str, given: list[ca.MX], results: list[ca.MX], vertices: int, planes: int, ends: int
) -> ca.Function:
    """The Function (near, given …) -> results, 0 where the bodies are not near or a plane separates them."""
    nothing = ca.Function("apart", given, [ca.MX.zeros(*part.shape) for part in results], UNBRANCHED)
    deep = ca.Function(name, given, results, UNBRANCHED)
    chosen = ca.Function.conditional("unless_separated", [deep], nothing)
    separated = _separated(vertices, planes, ends)(*given[: ends + 3])
    close = ca.Function(f"{name}_near", given, chosen.call([separated, *given]), UNBRANCHED)
    return ca.Function.conditional("where_near", [nothing], close)


@functools.cache
def _separated(vertices: int, planes: int, ends: int) -> ca.Function:
    """Whether one of B's planes separates it from A at all of its placements: then D > 0."""
    placed = [ca.SX.sym(f"placement_{k}", 12) for k in range(ends + 1)]
    body, body_planes = ca.SX.sym("body", 4 * vertices + 1), ca.SX.sym("body_planes", 4 * planes)
    corners, origin = ca.reshape(body[: 3 * vertices], 3, vertices), placed[-1][9:]
    world = [_rotation(each) @ corners + ca.repmat(each[9:] - origin, 1, vertices) for each in placed[:-1]]
    points = _rotation(placed[-1]).T @ ca.horzcat(*world)
    along = ca.reshape(body_planes[: 3 * planes], 3, planes).T @ points  # (planes, points)
    least = ca.vertcat(*(ca.mmin(row) for row in ca.vertsplit(along)))
    gap = ca.mmax(least - body_planes[3 * planes :]) - body[-1]
    return ca.Function("separated", [*placed, body, body_planes], [gap > 0])


def _sum(parts: Sequence[ca.MX]) -> ca.MX:
    return functools.reduce(lambda one, other: one + other, parts)


def _rotation(placement: ca.SX) -> ca.SX:
    return ca.reshape(placement[:9], 3, 3).T
