"""One pair of bodies in symbols: ½ min(D, 0)² and its derivatives.

Each is a Function of three steps that are real branches in generated code. A ball around the link body that does not
reach the enlarged box of the other; a plane of the enlarged body that separates them; the distance. The first two prove
D > 0, as they do in the broad phase of the loops (`broad_phase`).

With S_j the joints' screws in the world, m_j = 1, −1 or 0 as joint j moves A only, B only or both (or neither), w and H
the derivatives of D by a motion of A, η the motion of B's frame:

    ∂²D/∂q_j∂q_k = m_j m_k S_j·H S_k + ½ m_j |m_k| w·[S_j, S_k],   j nearer the base than k
    ∂²D/∂q_j∂η = m_j S_j·(−H η + ½ [w·[·, η]])        ∂²D/∂η² = H

Of a body swept from one placement to another w and H are by both, and so are the joints: those at either end.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

from hdplan.distance.symbolic.halfspaces import halfspace_distance, swept_halfspace_distance
from hdplan.distance.symbolic.rigid_motions import bracket

UNBRANCHED = {"never_inline": True}  # a Function that stays one, so that it can be a branch


class PairKind(NamedTuple):
    """What the Functions of a pair are built for."""

    vertices: int
    planes: int
    gamma: int
    shaping_length: float
    ends: int  # placements of A: one, or two of a swept body


@functools.cache
def ball(ends: int) -> ca.Function:
    """The ball (3, and its radius) around a body at all of its placements, of its own."""
    placed = [ca.SX.sym(f"placement_{k}", 12) for k in range(ends)]
    centre, radius = ca.SX.sym("centre", 3), ca.SX.sym("radius")
    places = [_rotation(each) @ centre + each[9:] for each in placed]
    reach = radius + ca.norm_2(places[-1] - places[0]) / 2 * (ends == 2)
    return ca.Function("ball", [*placed, centre, radius], [(places[0] + places[-1]) / 2, reach])


@functools.cache
def near(bodies: int, widest: float) -> ca.Function:
    """Which balls (1, A) of bodies, of those that are listed, reach the box of a piece: 0 where D is sure to be
    positive."""
    sizes = {"centres": (3, bodies), "radii": (1, bodies), "frame": (12, 1), "box": (12, 1), "half": (3, 1)}
    given = [ca.SX.sym(name, *size) for name, size in {**sizes, "listed": (1, bodies)}.items()]
    centres, radii, frame, box, half, listed = given
    turn = _rotation(frame) @ _rotation(box)
    origin = _rotation(frame) @ box[9:] + frame[9:]
    gaps = turn.T @ (centres - ca.repmat(origin, 1, bodies))
    outside = ca.fmax(ca.fabs(gaps) - ca.repmat(half, 1, bodies), 0)
    return ca.Function("near", given, [listed * (ca.sum1(outside**2) < (widest * radii) ** 2)])


@functools.cache
def pair(kind: PairKind) -> ca.Function:
    """One pair's ½ min(D, 0)², given whether it is near, and its derivative by A's motions, as wrenches (6 e)."""
    kernel = _kernel(kind, 1)
    given = kernel.mx_in()
    value, *wrenches = kernel(*given)[: kind.ends + 1]
    depth = ca.fmin(value, 0)
    return _where_near("pair", given, [depth * depth / 2, depth * ca.vertcat(*wrenches)], kind)


@functools.cache
def pair_bend(kind: PairKind, n: int, exact: bool, movable: bool) -> ca.Function:
    """One pair's second derivatives by the joints (n² of them, those at both ends for two); with B's frame `movable`
    also by the joints and its motion (6 n), by the latter (36), and the derivative by it (6)."""
    kernel = _kernel(kind, 2)
    given = kernel.mx_in()
    screws = [ca.MX.sym(f"screws{k}", 6, n) for k in range(kind.ends)]
    moves = ca.MX.sym("moves", n)
    value, *wrenches = (found := kernel(*given))[: kind.ends + 1]
    chained = _chained(kind.ends, n, exact, movable)
    results = chained.call([value, ca.vertcat(*wrenches), found[-1], ca.vertcat(*screws), moves])
    return _where_near("pair_bend", [*given, *screws, moves], results, kind)


def _kernel(kind: PairKind, order: int) -> ca.Function:
    build = halfspace_distance if kind.ends == 1 else swept_halfspace_distance
    return build(kind.vertices, kind.planes, kind.gamma, kind.shaping_length, order)


@functools.cache
def _chained(ends: int, n: int, exact: bool, movable: bool) -> ca.Function:
    """From D's derivatives by A's motions to those of ½ min(D, 0)² by joints and by B's motion."""
    sizes = {"value": (1, 1), "wrench": (6 * ends, 1), "hessian": (6 * ends, 6 * ends)}
    given = [ca.MX.sym(name, *size) for name, size in {**sizes, "screws": (6 * ends, n), "moves": (n, 1)}.items()]
    value, wrench, hessian, screws, moves = given
    depth, inside = ca.fmin(value, 0), value < 0
    moved = [part * ca.repmat(moves.T, 6, 1) for part in ca.vertsplit(screws, 6)]
    parts = ca.vertsplit(wrench, 6)
    slope = ca.vertcat(*(part.T @ by for part, by in zip(moved, parts, strict=True)))
    push = -total(parts)
    results = [(inside * slope) @ slope.T, (inside * slope) @ push.T, (inside * push) @ push.T, depth * push]
    if exact:
        turns = [-bracket(part) for part in parts]
        blocks = [ca.horzsplit(row, 6) for row in ca.vertsplit(hessian, 6)]
        rows = [total(row) for row in blocks]  # by B's motion, but for its sign
        curved = [
            [one.T @ block @ other for block, other in zip(row, moved, strict=True)]
            for row, one in zip(blocks, moved, strict=True)
        ]
        sizes_of_moves = ca.repmat(ca.fabs(moves).T, 6, 1)
        for i, (part, turn, whole) in enumerate(zip(moved, turns, ca.vertsplit(screws, 6), strict=True)):
            upper = ca.triu(part.T @ (turn @ (whole * sizes_of_moves)), False)  # joints are in the tree's order
            curved[i][i] += ca.densify(upper + upper.T)
        results[0] += depth * ca.blockcat(curved)
        results[1] += depth * ca.vertcat(
            *(part.T @ (turn - row) for part, turn, row in zip(moved, turns, rows, strict=True))
        )
        results[2] += depth * total(rows)
    flat = [ca.vec(ca.densify(part)) for part in results[: 4 if movable else 1]]
    return ca.Function("chained", given, flat)


def _where_near(name: str, given: list[ca.MX], results: list[ca.MX], kind: PairKind) -> ca.Function:
    """The Function (near, given …) -> results, 0 where the bodies are not near or a plane separates them."""
    deep = ca.Function(name, given, results, UNBRANCHED)
    chosen = ca.Function.conditional("unless_separated", [deep], nothing(deep))
    separated = _separated(kind.vertices, kind.planes, kind.ends)(*given[: kind.ends + 3])
    close = ca.Function(f"{name}_near", given, chosen.call([separated, *given]), UNBRANCHED)
    return where(close)


def where(function: ca.Function) -> ca.Function:
    """The Function (whether, given …) -> results, 0 where not."""
    return ca.Function.conditional("where", [nothing(function)], function)


def nothing(function: ca.Function) -> ca.Function:
    """A Function of the same inputs whose results are 0."""
    given = function.mx_in()
    zeros = [ca.MX.zeros(*function.size_out(k)) for k in range(function.n_out())]
    return ca.Function("apart", given, zeros, UNBRANCHED)


@functools.cache
def _separated(vertices: int, planes: int, ends: int) -> ca.Function:
    """Whether one of B's planes separates it from A at all of its placements: then D > 0."""
    placed = [ca.MX.sym(f"placement_{k}", 12) for k in range(ends + 1)]
    body, body_planes = ca.MX.sym("body", 4 * vertices + 1), ca.MX.sym("body_planes", 4 * planes)
    corners, origin = ca.reshape(body[: 3 * vertices], 3, vertices), placed[-1][9:]
    world = [_rotation(each) @ corners + ca.repmat(each[9:] - origin, 1, vertices) for each in placed[:-1]]
    points = _rotation(placed[-1]).T @ ca.horzcat(*world)
    along = points.T @ ca.reshape(body_planes[: 3 * planes], 3, planes)  # (points, planes)
    least = functools.reduce(ca.fmin, ca.vertsplit(along))
    gap = ca.mmax(least - body_planes[3 * planes :].T) - body[-1]
    return ca.Function("separated", [*placed, body, body_planes], [gap > 0])


def total(parts: Sequence[ca.MX]) -> ca.MX:
    """Their sum."""
    return functools.reduce(lambda one, other: one + other, parts)


def _rotation(placement: ca.SX | ca.MX) -> ca.SX | ca.MX:
    return ca.reshape(placement[:9], 3, 3).T
