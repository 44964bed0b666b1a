"""One pair of bodies in symbols: ½ min(D, 0)² and its derivatives.

Each is a Function of three steps that are real branches in generated code. A ball around the link body that does not
reach the enlarged box of the other; a plane of the enlarged body that separates them; the distance. The first two prove
D > 0, as they do in the broad phase of the loops (`broad_phase`).

With S_j the joints' screws in the world, m_j = 1, −1 or 0 as joint j moves A only, B only or both (or neither), w and H
the derivatives of D by a motion of A, η the motion of B's frame:

    ∂²D/∂q_j∂q_k = m_j m_k S_j·H S_k + ½ m_j |m_k| w·[S_j, S_k],   j nearer the base than k
    ∂²D/∂q_j∂η = m_j S_j·(−H η + ½ [w·[·, η]])        ∂²D/∂η² = H

Of a body swept from one placement to another w and H are by both, and so are the joints: those at either end. Where B
grows, D and its derivatives are by its sizes too, which no joint moves.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca

from hdplan.distance.symbolic.all_planes import MOST_SIZES, inside, projections
from hdplan.distance.symbolic.halfspaces import as_wrenches, in_the_world, points_seen
from hdplan.distance.symbolic.rigid_motions import bracket

UNBRANCHED = {"never_inline": True}  # a Function that stays one, so that it can be a branch


class PairKind(NamedTuple):
    """Key of the Functions of a pair."""

    vertices: int
    planes: int
    gamma: int
    shaping_length: float
    ends: int  # placements of A: one, or two of a swept body
    grows: bool  # whether there are derivatives by the sizes of B


@functools.cache
def ball(ends: int) -> ca.Function:
    """The ball (3, and its radius) around a body at all of its placements, of its own."""
    placed = [ca.SX.sym(f"placement_{k}", 12) for k in range(ends)]
    centre, radius = ca.SX.sym("centre", 3), ca.SX.sym("radius")
    places = [_rotation(each) @ centre + each[9:] for each in placed]
    reach = radius + ca.norm_2(places[-1] - places[0]) / 2 * (ends == 2)
    return ca.Function("ball", [*placed, centre, radius], [(places[0] + places[-1]) / 2, reach])


@functools.cache
def box_seen() -> ca.Function:
    """For a box on a frame the three functions (4) of a point [y, 1] in the world whose values are its places along the
    box's axes."""
    frame, box = ca.SX.sym("frame", 12), ca.SX.sym("box", 12)
    turn, origin = _rotation(frame) @ _rotation(box), _rotation(frame) @ box[9:] + frame[9:]
    axes = [ca.vertcat(axis, -ca.dot(axis, origin)) for axis in ca.horzsplit(turn)]
    return ca.Function("box_seen", [frame, box], [ca.densify(axis) for axis in axes])


@functools.cache
def pair(kind: PairKind) -> ca.Function:
    """One pair's ½ min(D, 0)², given whether it is near, the placements of A and that of B, A, and B's normals (K, 3)
    and supports (K), with the derivatives of these (K, 3) where it grows; and its derivative by A's motions, as
    wrenches (6 e), and by B's sizes (3) where it grows."""

    def results(value: ca.MX, slopes: list[ca.MX], _: ca.MX) -> list[ca.MX]:
        return [value * value / 2, *(value * each for each in slopes)]

    return _where_near("pair", kind, [], results, 1)


@functools.cache
def pair_second_order(kind: PairKind, n: int, exact: bool, movable: bool) -> ca.Function:
    """One pair's second derivatives by the joints (n² of them, those at both ends for two); with B's frame `movable`
    also by the joints and its motion (6 n), by the latter (36), and the derivative by it (6); where B grows, then by
    sizes and joints (3 n), by sizes and motion (18), and by sizes (9)."""
    more = [*(ca.MX.sym(f"screws{k}", 6, n) for k in range(kind.ends)), ca.MX.sym("moves", n)]
    chained = _chained(kind.ends, n, exact, movable, kind.grows)

    def results(value: ca.MX, slopes: list[ca.MX], hessian: ca.MX) -> list[ca.MX]:
        return list(chained.call([value, *slopes, hessian, ca.vertcat(*more[:-1]), more[-1]]))

    return _where_near("pair_second_order", kind, more, results, 2)


def _where_near(
    name: str,
    kind: PairKind,
    more: list[ca.MX],
    results: Callable[[ca.MX, list[ca.MX], ca.MX], list[ca.MX]],
    order: int,
) -> ca.Function:
    """The Function (near, placements, body, planes, more …) -> results of min(D, 0), D's wrench with its derivatives by
    sizes, and its Hessian; 0 where the bodies are not near or a plane separates them at all of A's placements."""
    placements = [ca.MX.sym(f"placement_{k}", 12) for k in range(kind.ends + 1)]
    body, normals = ca.MX.sym("body", 4 * kind.vertices + 1), ca.MX.sym("normals", kind.planes, 3)
    supports, growth = ca.MX.sym("supports", kind.planes), [ca.MX.sym("growth", kind.planes, MOST_SIZES)] * kind.grows
    points, weights, radius = points_seen(placements, body)
    x, least = projections(points, radius, normals, supports)

    inner = inside(points.shape[1], kind.planes, kind.gamma, kind.shaping_length, order, kind.ends, kind.grows)
    seen, frame = inner.mx_in(), ca.MX.sym("frame", 12)
    value, gradient, *second = inner.call(seen)
    wrench, *by_sizes = ca.vertsplit(gradient, [0, 6 * kind.ends, gradient.numel()][: 2 + kind.grows])
    hessian = in_the_world(frame, second[0], kind.ends) if second else ca.MX()
    found = results(ca.fmin(value, 0), [as_wrenches(frame, wrench), *by_sizes], hessian)
    deep = ca.Function(name, [*seen, frame, *more], found, UNBRANCHED)
    chosen = ca.Function.conditional("unless_separated", [deep], nothing(deep))
    separated = ca.mmax(least) > 0
    given = [*placements, body, normals, supports, *growth, *more]
    unless = chosen.call([separated, x, least, points, weights, normals, *growth, placements[-1], *more])
    return where(ca.Function(f"{name}_near", given, unless, UNBRANCHED))


@functools.cache
def _chained(ends: int, n: int, exact: bool, movable: bool, grows: bool) -> ca.Function:
    """Function from min(D, 0) and D's derivatives by A's motions, and by B's sizes, to those of ½ min(D, 0)² by joints,
    by B's motion, and by B's sizes."""
    every = 6 * ends + MOST_SIZES * grows
    sizes = {"value": (1, 1), "wrench": (6 * ends, 1)} | ({"by_sizes": (MOST_SIZES, 1)} if grows else {})
    sizes |= {"hessian": (every, every), "screws": (6 * ends, n), "moves": (n, 1)}
    given = [ca.MX.sym(name, *size) for name, size in sizes.items()]
    value, wrench, *by_sizes, whole_hessian, screws, moves = given
    hessian = whole_hessian[: 6 * ends, : 6 * ends]
    contact = value < 0
    moved = [part * ca.repmat(moves.T, 6, 1) for part in ca.vertsplit(screws, 6)]
    parts = ca.vertsplit(wrench, 6)
    slope = ca.vertcat(*(part.T @ by for part, by in zip(moved, parts, strict=True)))
    push = -total(parts)
    results = [(contact * slope) @ slope.T, (contact * slope) @ push.T, (contact * push) @ push.T, value * push]
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
        results[0] += value * ca.blockcat(curved)
        results[1] += value * ca.vertcat(
            *(part.T @ (turn - row) for part, turn, row in zip(moved, turns, rows, strict=True))
        )
        results[2] += value * total(rows)
    if by_sizes:
        (grown,) = by_sizes
        results += [(contact * slope) @ grown.T, (contact * push) @ grown.T, (contact * grown) @ grown.T]
        if exact:
            mixed = ca.vertsplit(whole_hessian[: 6 * ends, 6 * ends :], 6)
            results[4] += value * ca.vertcat(*(part.T @ by for part, by in zip(moved, mixed, strict=True)))
            results[5] -= value * total(mixed)
            results[6] += value * whole_hessian[6 * ends :, 6 * ends :]
    flat = [ca.vec(ca.densify(part)) for part in (results if movable else results[:1])]
    return ca.Function("chained", given, flat)


def where(function: ca.Function) -> ca.Function:
    """The Function (whether, given …) -> results, 0 where not."""
    return ca.Function.conditional("where", [nothing(function)], function)


def nothing(function: ca.Function) -> ca.Function:
    """A Function of the same inputs whose results are 0."""
    given = function.mx_in()
    zeros = [ca.MX.zeros(*function.size_out(k)) for k in range(function.n_out())]
    return ca.Function("apart", given, zeros, UNBRANCHED)


def total(parts: Sequence[ca.MX]) -> ca.MX:
    """Their sum."""
    return functools.reduce(lambda one, other: one + other, parts)


def _rotation(placement: ca.SX) -> ca.SX:
    return ca.reshape(placement[:9], 3, 3).T
